"""Further engines, for experiments only."""
