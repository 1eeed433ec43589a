"""Learning from a part of observations and predicting the rest."""
