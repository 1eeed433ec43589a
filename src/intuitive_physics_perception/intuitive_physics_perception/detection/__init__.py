"""Objects in one frame: spheres, boxes and capsules."""
