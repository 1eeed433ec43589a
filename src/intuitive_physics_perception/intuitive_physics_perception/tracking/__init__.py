"""Objects over time: tracks, their filters, and the observations they become."""
