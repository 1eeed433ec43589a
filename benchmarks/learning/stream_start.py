"""How long a learner takes to be ready on a database of many observations, in a fresh process."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.store.observation_entries import entry_columns
from intuitive_physics_learner.store.observation_rows import insert_entry

POINTS = 45  # points of the observation: 1.5 s at 30 frames a second
PERIOD = 10.0  # s from one observation to the next
OPENING = """
import json, resource, sys, time
from intuitive_physics_learner.store import CurrentParameters, ObservationStore
began, cpu = time.perf_counter(), time.process_time()
with ObservationStore(sys.argv[1]) as store:
    current, count = CurrentParameters(store), store.count()
    materials = current.extended().materials
print(json.dumps([
    count,
    materials,
    time.perf_counter() - began,
    time.process_time() - cpu,
    resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
]))
"""
"""Program of the fresh process; imports do not count into its seconds."""


@dataclass(frozen=True)
class Start:
    """Opening a database of stored observations and finding θ_s and the materials in it."""

    stored: int
    seconds: float  # without imports
    cpu_seconds: float  # without imports
    process_seconds: float  # with imports
    rss_megabytes: float  # the most that the process had
    file_megabytes: float


def measure_start(stored: int) -> Start:
    """Measure the start on a database that is made for it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learner.sqlite3"
        _fill(path, stored)
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", OPENING, str(path)], capture_output=True, text=True, check=True
        )
        whole = time.perf_counter() - began
        count, materials, seconds, cpu_seconds, memory = json.loads(done.stdout)
        if count != stored or materials != ["ball", "floor"]:
            raise RuntimeError(f"the database of {stored} observations was not read as written")
        return Start(stored, seconds, cpu_seconds, whole, memory, os.path.getsize(path) / 1e6)


def _fill(path: Path, count: int) -> None:
    """Make a database in which one observation occurs `count` times, with other ids and times."""
    ObservationStore(path).close()
    connection = sqlite3.connect(path)
    with connection:
        for name, received_at, text, columns in _rows(count):
            connection.execute(
                "INSERT INTO observations VALUES (?, ?, ?)", (name, received_at, text)
            )
            insert_entry(connection, name, received_at, columns)
    connection.close()


def _rows(count: int) -> Iterator[tuple[str, float, str, tuple[Any, ...]]]:
    """Yield id, time of arrival in s, JSON text and `entry_columns` of each observation."""
    observation = _observation()
    begin, first, last, *rest = entry_columns(observation)
    data = json.loads(observation.to_json())
    (ball,) = data["objects"]
    times = np.array(ball["times"])
    for number in range(count):
        start = PERIOD * number
        data |= {"id": f"{number:032x}", "start_time": start}
        ball["times"] = (start + times).tolist()
        columns = (start + begin, start + first, start + last, *rest)
        yield data["id"], start, json.dumps(data), columns


def _observation() -> Observation:
    """Return a ball in free flight."""
    times = np.arange(1, POINTS + 1) / 30.0
    velocity, gravity = np.array([1.0, 0.5, 7.5]), np.array([0.0, 0.0, -9.81])
    state = ObjectState([0.0, 0.0, 0.1], linear_velocity=velocity)
    positions = state.position + times[:, None] * velocity + 0.5 * times[:, None] ** 2 * gravity
    ball = SceneObject("ball", "ball", Sphere(0.03))
    floor = Environment([Plane("floor", "floor", [0.0, 0.0, 1.0], 0.0)])
    return Observation(floor, (ObservedObject(ball, Trajectory(times, positions), state),), 0.0)
