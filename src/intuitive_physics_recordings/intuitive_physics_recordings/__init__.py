"""Bags in and out, observation files, replay."""
