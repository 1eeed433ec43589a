"""Questions about a predicted distribution."""
