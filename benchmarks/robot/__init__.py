"""The suite started and killed as a robot does it, by real `ros2 launch`."""
