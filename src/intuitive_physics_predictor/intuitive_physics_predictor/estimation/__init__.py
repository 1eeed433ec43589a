"""The state of an object by all that was seen of it: smoothing with the simulator as the model."""
