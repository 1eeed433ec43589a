"""Frames: where one lies in another, and scenes and observations as another frame has them."""
