"""A billiard break, ours beside pooltool, which has an environment of its own."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import MissingPeerError
from benchmarks.peers.ours import NAMES, Ours
from benchmarks.peers.rollout_program import PROGRAMS
from benchmarks.scenes import Instance, Surface
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState

PROGRAM = Path(__file__).resolve().parents[1] / "peers/pooltool_break.py"
PYTHON = PROGRAMS / "pooltool/bin/python"  # of pooltool's environment

RADIUS, DENSITY = 0.028575, 1740.0  # m and kg/m³ of all balls
LENGTH, WIDTH = 2.54, 1.27  # m between the cushions
ROWS = 5  # of the triangle
GAP, JITTER = 1e-4, 2e-5  # m between two balls of the triangle, and by which their places differ
SPEED = 8.0  # m/s of the cue ball, which slides
ASIDE = 0.02  # m, at most, from the middle to the cue ball
CLOTH_FRICTION, ROLLING_FRICTION = 0.2, 0.01
CUSHION_RESTITUTION, CUSHION_FRICTION = 0.85, 0.2
STEPS, TIME_STEP = 500, 0.02  # outputs, and s from one to the next; all balls rest by the end


@dataclass(frozen=True)
class Breaks:
    """Median seconds of a break by engine, pooltool's median number of events, and its version.

    Without pooltool `left_out` says why.
    """

    count: int
    seconds: dict[str, float]
    events: float = 0.0
    version: str = ""
    left_out: str = ""


@dataclass(frozen=True, eq=False)
class Break(Instance):
    """Balls on cloth between cushions, where pairs differ."""

    @property
    def static_parameters(self) -> StaticParameters:
        """θ_s of pooltool: balls that meet neither lose energy nor rub."""
        materials = ["ball", "cloth", "cushion"]
        pairs = np.zeros((4, 3, 3))
        pairs[:, 0, 0] = 0.0, 0.0, 0.0, 1.0
        pairs[:, 0, 1] = pairs[:, 1, 0] = CLOTH_FRICTION, CLOTH_FRICTION, ROLLING_FRICTION, 0.0
        cushion = CUSHION_FRICTION, CUSHION_FRICTION, 0.0, CUSHION_RESTITUTION
        pairs[:, 0, 2] = pairs[:, 2, 0] = cushion
        return StaticParameters(materials, np.full(3, DENSITY), pairs)


def measure_breaks(count: int, repetitions: int, rng: np.random.Generator) -> Breaks:
    """Measure `count` random breaks; in each the median of the repetitions counts."""
    places = [random_places(rng) for _ in range(count)]
    seconds = {
        name: statistics.median(_own_seconds(name, balls, repetitions) for balls in places)
        for name in NAMES
    }
    try:
        theirs = _pooltool(places, repetitions)
    except MissingPeerError as missing:
        return Breaks(count, seconds, left_out=str(missing))
    seconds["pooltool"] = statistics.median(one["seconds"] for one in theirs["breaks"])
    events = statistics.median(one["events"] for one in theirs["breaks"])
    return Breaks(count, seconds, events, theirs["version"])


def random_places(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return (16, 2) m from a corner: the cue ball, and 15 balls in a triangle."""
    middle, apart = WIDTH / 2, 2 * RADIUS + GAP
    triangle = [
        (middle + (k - row / 2) * apart, 0.75 * LENGTH + row * apart * math.sqrt(0.75))
        for row in range(ROWS)
        for k in range(row + 1)
    ]
    cue = (middle + rng.uniform(-ASIDE, ASIDE), 0.25 * LENGTH)
    return np.array([cue, *triangle]) + rng.uniform(-JITTER, JITTER, (1 + len(triangle), 2))


def as_instance(places: NDArray[np.float64]) -> Break:
    """Return our scene of balls at those places, of which the first moves along y."""
    planes = [
        Plane("cloth", "cloth", (0, 0, 1), 0.0),
        Plane("left", "cushion", (1, 0, 0), 0.0),
        Plane("right", "cushion", (-1, 0, 0), -WIDTH),
        Plane("near", "cushion", (0, 1, 0), 0.0),
        Plane("far", "cushion", (0, -1, 0), -LENGTH),
    ]
    objects = [SceneObject(f"ball_{i}", "ball", Sphere(RADIUS)) for i in range(len(places))]
    states = [
        ObjectState((x, y, RADIUS), linear_velocity=(0, 0.0 if i else SPEED, 0))
        for i, (x, y) in enumerate(places.tolist())
    ]
    scene = Scene(Environment(planes), tuple(objects), tuple(states))
    return Break(scene, Surface(), np.array([[state.to_vector() for state in states]]))


def _own_seconds(name: str, places: NDArray[np.float64], repetitions: int) -> float:
    with Ours(name).prepare(as_instance(places), STEPS, TIME_STEP) as world:
        world.predict()
        return statistics.median(world.predict().seconds for _ in range(repetitions))


def _pooltool(places: Sequence[NDArray[np.float64]], repetitions: int) -> dict[str, Any]:
    """Return what `peers/pooltool_break.py` answers, or raise `MissingPeerError`."""
    if not PYTHON.exists():
        raise MissingPeerError("pooltool is missing: tools/bench_packages.sh pooltool")
    request = {
        "radius": RADIUS,
        "length": LENGTH,
        "width": WIDTH,
        "cloth": CLOTH_FRICTION,
        "rolling": ROLLING_FRICTION,
        "cushion_restitution": CUSHION_RESTITUTION,
        "cushion_friction": CUSHION_FRICTION,
        "speed": SPEED,
        "times": repetitions,
        "breaks": [balls.tolist() for balls in places],
    }
    with tempfile.TemporaryDirectory() as home:
        done = subprocess.run(
            [PYTHON, "-I", PROGRAM],
            input=json.dumps(request),
            # It writes settings into the home, and would read a user's own there.
            env={**os.environ, "HOME": home},
            capture_output=True,
            text=True,
        )
    if done.returncode != 0:
        raise MissingPeerError(f"pooltool's program ended with {done.returncode}\n{done.stderr}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer
