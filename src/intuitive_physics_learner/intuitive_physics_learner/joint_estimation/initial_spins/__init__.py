"""How balls are thrown, and spins that are farther from a guess than slopes reach."""
