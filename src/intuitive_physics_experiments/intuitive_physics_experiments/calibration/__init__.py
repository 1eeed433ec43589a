"""Are the predicted probabilities true? Coverage, proper scores and baselines on held-out data."""
