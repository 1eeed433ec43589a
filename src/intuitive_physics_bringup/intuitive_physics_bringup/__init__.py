"""The suite put together: which node hears which, how all start, and the demo."""
