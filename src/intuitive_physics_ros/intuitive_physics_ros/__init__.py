"""What all nodes share: message conversions, and the plumbing from start to clean shutdown."""
