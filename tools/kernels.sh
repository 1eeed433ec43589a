#!/usr/bin/env bash
# Compiles the kernels into Numba's cache, so that no callback ever waits for a compiler.
set -euo pipefail

.venv/bin/python -m intuitive_physics.kernels.warm_up intuitive_physics.simulation.compile \
    intuitive_physics_perception.compile intuitive_physics_predictor.compile
