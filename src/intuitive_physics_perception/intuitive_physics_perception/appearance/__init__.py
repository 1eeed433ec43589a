"""What the surface of an object shows: how a ball turns."""
