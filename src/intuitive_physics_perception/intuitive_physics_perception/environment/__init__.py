"""The environment Ω_e: planes, static boxes and gravity."""
