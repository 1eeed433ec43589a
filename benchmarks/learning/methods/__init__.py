"""J against time: joint estimation, other engines, ways to evaluate J."""
