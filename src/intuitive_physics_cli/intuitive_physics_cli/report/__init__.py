"""Reports as one page each."""
