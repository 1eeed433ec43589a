"""From sensor messages to frames of points."""
