"""The predictor node, its services and its parameters."""
