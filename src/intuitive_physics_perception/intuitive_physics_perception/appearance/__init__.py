"""The spin of a ball from its surface."""
