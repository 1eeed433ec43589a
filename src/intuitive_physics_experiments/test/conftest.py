from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.recorded_sets.table_tennis import LAUNCH_BOUNCE_HEIGHT
from intuitive_physics_experiments.recorded_sets.toss_evaluation import toss_parameters
from intuitive_physics_experiments.rendering.corner_room import corner_camera, corner_environment
from intuitive_physics_experiments.rendering.depth_renderer import DepthImage, DepthRenderer
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag

GRAVITY = 9.81
RESTITUTION = 0.9


@pytest.fixture(scope="session")
def renderer():
    """The corner room's renderer."""
    return DepthRenderer(corner_camera(), corner_environment())


@pytest.fixture(scope="session")
def full_image(renderer):
    """Makes the whole image of the corner room with a ball in it."""

    def make(center: Any, radius: float) -> DepthImage:
        rendered = renderer.render_balls([center], [radius])
        crop = (rendered.region.rows, rendered.region.columns)
        depth, cosine = (
            values.copy()
            for values in (renderer.background.depth, renderer.background.incidence_cosine)
        )
        depth[crop], cosine[crop] = rendered.image.depth, rendered.image.incidence_cosine
        return DepthImage(depth, cosine)

    return make


@pytest.fixture(scope="session")
def small_bag(tmp_path_factory):
    """A rendered bag of one throw; treat it as read-only."""
    path = tmp_path_factory.mktemp("bags") / "one_throw"
    render_bag(path, RenderSettings(throws=1, seed=1, lead_in=0.5, throw_duration=1.0, pause=0.3))
    return path


def bounce_once(times: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray]:
    start, speed, up = floor + 0.35, np.array([-3.8, 0.1]), 3.1
    landing = (up + np.sqrt(up**2 + 2.0 * GRAVITY * 0.35)) / GRAVITY
    since = times - landing
    rebound = RESTITUTION * (GRAVITY * landing - up)
    before = times < landing
    falling = start + up * times - GRAVITY / 2.0 * times**2
    z = np.where(before, falling, floor + rebound * since - GRAVITY / 2.0 * since**2)
    vz = np.where(before, up - GRAVITY * times, rebound - GRAVITY * since)
    across = [np.full_like(times, component) for component in speed]
    position = np.column_stack([3.0 + speed[0] * times, 0.1 + speed[1] * times, z])
    return position, np.column_stack([*across, vz])


@pytest.fixture(scope="session")
def bouncing_flight():
    """Positions and velocities, at given times, of a ball that bounces once at a given height."""
    return bounce_once


@pytest.fixture(scope="session")
def launch_arrays():
    """Arrays of a recorded set of so many equal launches."""

    def make(count: int) -> dict[str, Any]:
        times = np.arange(160) / 180.0
        flights = [bounce_once(times, LAUNCH_BOUNCE_HEIGHT)[0] for _ in range(count)]
        return {
            "time": np.tile(times, count),
            "position": np.concatenate(flights).astype(np.float32),
            "offsets": np.arange(count + 1) * times.size,
            "radius": np.array(0.02),
            "mass": np.array(0.0027),
        }

    return make


@pytest.fixture(scope="session")
def toss_arrays():
    """Arrays of a recorded set of cubes that an engine has tossed."""

    def make(
        count: int,
        engine: str = "bullet",
        friction: float = 0.2,
        restitution: float = 0.3,
        mass_centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> dict[str, Any]:
        rng = np.random.default_rng(7)
        times = np.arange(60) / 100.0
        starts = [
            ObjectState(
                (0.0, 0.0, 0.2 + 0.01 * i),
                Rotation.from_quat(rng.normal(size=4)).as_quat(),
                (1.0, *rng.normal(0.0, 0.3, 2)),
                rng.normal(0.0, 4.0, 3),
            )
            for i in range(count)
        ]
        cube = SceneObject("cube", "cube", Box((0.1, 0.1, 0.1)), mass_centre=mass_centre)
        table = Environment([Plane("table", "table", (0.0, 0.0, 1.0), 0.0)])
        rollout = make_simulator(engine).rollout(
            [Scene(table, (cube,), (start,)) for start in starts],
            toss_parameters(friction, restitution),
            times,
        )
        return recorded_as_toss_set(
            rollout.positions[:, 0], np.asarray(rollout.orientations)[:, 0], starts, times
        )

    return make


def recorded_as_toss_set(
    positions: np.ndarray, orientations: np.ndarray, starts: list[ObjectState], times: np.ndarray
) -> dict[str, Any]:
    """Only the first row of each toss has velocities; nobody reads the others."""
    tosses, steps = positions.shape[:2]
    velocities, spins = np.zeros((2, tosses, steps, 3))
    for i, start in enumerate(starts):
        velocities[i, 0] = start.linear_velocity
        turn = Rotation.from_quat(start.orientation)
        spins[i, 0] = turn.as_matrix().T @ start.angular_velocity
    return {
        "position": positions.reshape(-1, 3),
        "quaternion_wxyz": orientations[..., [3, 0, 1, 2]].reshape(-1, 4),
        "velocity_world": velocities.reshape(-1, 3),
        "angular_velocity_body": spins.reshape(-1, 3),
        "offsets": np.arange(tosses + 1) * steps,
        "dt": np.array(times[1]),
        "cube_edge": np.array(0.1),
    }
