"""Kills, random messages, cancelled searches, faults and a long run, which the nodes must bear."""
