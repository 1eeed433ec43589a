"""A camera of eight by six pixels, for bags that are written fast."""

from intuitive_physics_recordings.depth_bag_writer import PinholeCamera

SMALL = PinholeCamera(8, 6, focal_length=(6.0, 6.0), center=(3.5, 2.5))
