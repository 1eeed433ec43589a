"""Our simulators beside ODE, PyBullet and MuJoCo."""
