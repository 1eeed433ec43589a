"""Our simulators beside other engines."""
