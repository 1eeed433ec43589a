"""The perception node and its inputs."""
