"""Samples of predictions below the surfaces that balls rest on or lie next to, counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noisy_newton import PreparedScene
from intuitive_physics_predictor.outside import objects_inside

# m: half the edge of the table, the height of its two walls, and the radius of the balls
HALF_TABLE, WALL_HEIGHT, RADIUS = 0.5, 0.5, 0.03
# m, rad, m/s and rad/s, standard deviations of a perceived state on each axis
POSITION_NOISE, ROTATION_NOISE, VELOCITY_NOISE, SPIN_NOISE = 0.001, 0.0, 0.005, 1.0
# m, standard deviation of an error of the perceived position that its covariance leaves out
SYSTEMATIC = 0.002
HORIZON, TIME_STEP = 1.0, 0.05  # s predicted ahead, and between its times
SEED = 5  # of the perceived states and of the samples


def samples_below_a_surface(predictions: int) -> int:
    """Count samples that begin inside a surface or are behind one they are over at any time.

    Each prediction is of states with other errors. Balls lie on a table with edges, at and between
    its two walls, at its edge, and on a box.
    """
    rng = np.random.default_rng(SEED)
    environment = _table_with_walls()
    settings = PredictionSettings(PredictionOptions(horizon=HORIZON, time_step=TIME_STEP))
    theta = StaticParameters.uniform(["ball", "room"])
    count = 0
    for seed in range(predictions):
        scene = _perceived(environment, rng)
        prepared = PreparedScene.of(scene, theta, StateNoise())
        worlds = settings.draw(prepared, seed, settings.options.sample_count)
        predicted = settings.predict(
            prepared,
            settings.times,
            seed=seed,
            sample_count=settings.options.sample_count,
            drawn=worlds,
        )
        inside = int(objects_inside(worlds, prepared.spread.means).any(axis=1).sum())
        count += max(inside, int(_behind(environment.planes, predicted.positions).sum()))
    return count


def _behind(planes: Sequence[Plane], positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which samples (n_samples,) have a centre behind a plane that it is over."""
    is_behind = np.zeros(positions.shape[:-1], dtype=bool)
    for plane in planes:
        is_behind |= (plane.signed_distances(positions) < 0.0) & plane.covers(positions)
    return np.asarray(is_behind.any(axis=(1, 2)))


def _table_with_walls() -> Environment:
    a, h = HALF_TABLE, WALL_HEIGHT
    return Environment(
        [
            Plane(
                "table", "room", (0, 0, 1), 0.0, [(-a, -a, 0), (a, -a, 0), (a, a, 0), (-a, a, 0)]
            ),
            Plane(
                "left", "room", (1, 0, 0), -a, [(-a, -a, 0), (-a, a, 0), (-a, a, h), (-a, -a, h)]
            ),
            Plane(
                "back", "room", (0, 1, 0), -a, [(-a, -a, 0), (-a, -a, h), (a, -a, h), (a, -a, 0)]
            ),
        ],
        [StaticBox("box", "room", (0.2, 0.2, 0.05), (0, 0, 0, 1), (0.2, 0.2, 0.1))],
    )


def _perceived(environment: Environment, rng: np.random.Generator) -> Scene:
    """Return balls where they lie, perceived with errors."""
    wall = RADIUS - HALF_TABLE
    places = {
        "on_table": (0.0, 0.0, RADIUS),
        "at_wall": (wall, 0.1, RADIUS),
        "in_corner": (wall, wall, RADIUS),
        "at_edge": (HALF_TABLE, -0.1, RADIUS),
        "on_box": (0.2, 0.2, 0.1 + RADIUS),
    }
    deviations = [POSITION_NOISE, ROTATION_NOISE, VELOCITY_NOISE, SPIN_NOISE]
    covariance = np.diag(np.repeat(np.square(deviations), 3))
    error = np.hypot(POSITION_NOISE, SYSTEMATIC)
    states = [
        ObjectState(place + rng.normal(0.0, error, 3), covariance=covariance)
        for place in places.values()
    ]
    ball = Sphere(RADIUS)
    objects = [SceneObject(name, "ball", ball) for name in places]
    return Scene(environment, tuple(objects), tuple(states))
