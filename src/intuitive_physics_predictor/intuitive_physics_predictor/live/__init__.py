"""Prediction at a steady rate from the newest inputs."""
