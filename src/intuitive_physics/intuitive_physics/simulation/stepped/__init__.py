"""Bodies that contacts press, in steps: impacts at their time, contact forces by sweeps."""
