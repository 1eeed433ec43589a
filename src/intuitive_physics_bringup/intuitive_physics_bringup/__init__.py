"""The suite put together: which node hears which, and how all start."""
