"""The one core of the simulation: its schedule, and the two engines that are settings of it."""
