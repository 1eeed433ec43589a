"""On-line learning: θ_s improves in the background as observations arrive."""
