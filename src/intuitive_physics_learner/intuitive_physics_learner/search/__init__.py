"""Parameter search (Algorithm 1), its update rules, and which parameters data identify."""
