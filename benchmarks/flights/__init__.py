"""Real flights of spinning balls: our estimate beside the filter of table-tennis robots."""
