"""J against iterations and time: methods of learning, other engines, ways to evaluate J."""
