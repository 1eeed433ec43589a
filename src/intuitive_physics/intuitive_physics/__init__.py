"""Intuitive physics: the library under the nodes. It knows nothing of ROS."""
