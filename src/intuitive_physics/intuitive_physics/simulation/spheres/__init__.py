"""Spheres without air in closed form, from event to event."""
