"""Objects whose poses others measure, such as tags or a motion-capture system."""
