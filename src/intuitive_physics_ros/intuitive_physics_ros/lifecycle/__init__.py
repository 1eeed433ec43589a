"""The life of a node: its start, its states, and its clean end."""
