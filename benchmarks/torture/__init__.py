"""What a robot's months do to the nodes, in minutes: kills, and messages that nobody would send."""
