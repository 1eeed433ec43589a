"""From depth images or point clouds to environment, object states and observations."""
