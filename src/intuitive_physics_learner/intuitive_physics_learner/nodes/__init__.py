"""The learner node, its services and its parameters."""
