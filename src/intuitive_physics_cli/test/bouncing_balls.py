"""Balls that bounce in a corner, as tests of the command line observe them."""

from __future__ import annotations

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory

CORNER = Environment(
    [
        Plane("floor", "room", (0.0, 0.0, 1.0), 0.0),
        Plane("wall_x", "room", (-1.0, 0.0, 0.0), -1.0),
        Plane("wall_y", "room", (0.0, -1.0, 0.0), -1.0),
    ]
)
"""Floor z = 0 and walls x = 1 m, y = 1 m, unbounded."""

TRUE = StaticParameters.uniform(("rubber", "room"), restitution=0.85)
"""θ_s that the balls obey."""


def bounces(count: int) -> list[Observation]:
    """Balls dropped at different speeds under `TRUE`, seen without noise."""
    times = np.arange(1, 31) / 30.0
    observations = []
    for i in range(count):
        thing = SceneObject("ball", "rubber", Sphere(0.05))
        state = ObjectState((0.0, 0.0, 0.6), linear_velocity=(0.1 * i, 0.0, 0.0))
        scene = Scene(CORNER, (thing,), (state,))
        path = make_simulator("event_driven").rollout([scene], TRUE, times).positions[0, 0]
        seen = ObservedObject(thing, Trajectory(5.0 + times, path), state)
        observations.append(Observation(scene.environment, (seen,), 5.0))
    return observations
