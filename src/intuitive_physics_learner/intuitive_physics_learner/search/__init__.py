"""Parameter search (Algorithm 1), its update rules, its space and its task."""
