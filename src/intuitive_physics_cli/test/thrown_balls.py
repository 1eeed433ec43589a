"""Balls thrown over a floor, with detections as perception has them."""

from __future__ import annotations

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory

FLOOR = Environment([Plane("floor", "room", (0.0, 0.0, 1.0), 0.0)])
"""Without an edge."""

TRUE = StaticParameters.uniform(("rubber", "room"), restitution=0.8)
"""θ_s that the balls obey."""

NOISE, SPIN = 0.002, 2.0
"""m and rad/s, standard deviations on each axis of detections and of initial spins."""

PAUSE = 5.0
"""s from the start of one throw to that of the next."""


def thrown_balls(
    count: int, rng: np.random.Generator, height: float = 0.6, duration: float = 1.5
) -> list[Observation]:
    """Throws that bounce, seen 30 times a second.

    Parameters
    ----------
    height : m above the floor at the start
    duration : s that each is seen
    """
    frames = np.arange(1 + round(30.0 * duration)) / 30.0
    return [_thrown(PAUSE * k, frames, height, rng) for k in range(count)]


def _thrown(
    start: float, frames: np.ndarray, height: float, rng: np.random.Generator
) -> Observation:
    ball = SceneObject("ball", "rubber", Sphere(0.05))
    velocity = (*rng.uniform(-1.0, 1.0, 2), rng.uniform(0.5, 2.0))
    true = ObjectState((0.0, 0.0, height), (0, 0, 0, 1), velocity, rng.normal(0.0, SPIN, 3))
    path = make_simulator("auto").rollout([Scene(FLOOR, (ball,), (true,))], TRUE, frames)
    seen = path.positions[0, 0] + rng.normal(0.0, NOISE, (frames.size, 3))
    stated = np.broadcast_to(NOISE**2 * np.eye(3), (frames.size, 3, 3))
    detections = Detections(start + frames, seen, stated, np.zeros((3, 3)))
    known = ObservedObject(ball, Trajectory(start + frames, path.positions[0, 0]), true, detections)
    return Observation(FLOOR, (known,), start)
