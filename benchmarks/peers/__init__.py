"""The engines that are compared, all behind one interface."""
