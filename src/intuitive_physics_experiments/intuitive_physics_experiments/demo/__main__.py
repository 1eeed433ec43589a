"""`make demo`: `python -m intuitive_physics_experiments.demo`."""

import sys

from intuitive_physics_experiments.demo.nodes.run_demo import main

sys.exit(main())
