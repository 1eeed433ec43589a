"""The part of the demo that starts the nodes and talks to them."""
