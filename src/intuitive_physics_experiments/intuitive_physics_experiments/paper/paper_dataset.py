"""The paper's synthetic set (Sec. IV-B): random objects thrown through the room, seen with noise.

Each run is a scene with its true motion and the observation that a learner gets of it: positions at
30 Hz with noise N(0, 0.02), and initial states estimated from them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.simulation import Simulator, WorldStatus
from intuitive_physics.state import ANGULAR_VELOCITY, ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_experiments.flight_fits import fit_noisy_flight, flight_length
from intuitive_physics_experiments.paper.paper_room import (
    SHAPE_KINDS,
    SPIN_DEVIATION,
    dataset_parameters,
    dataset_simulator,
    draw_initial_states,
    draw_pool,
    paper_room,
)
from intuitive_physics_experiments.results import write_csv, write_whole
from intuitive_physics_recordings.observation_files import save_observations

DURATION = 5.0  # s of a run (Sec. IV-B)
SAMPLE_RATE = 30.0  # 1/s (Sec. IV-B)
POSITION_NOISE = 0.02  # m, the standard deviation of N(0, 0.02) on each axis
TRAINING_SHARE = 0.8  # Share of the runs that is learned from, as in the paper

# Where an observation's initial states come from: the paper's first three points, all points before
# the first surprise, or the truth (which no learner has).
INITIAL_STATES = ("three_points", "flight", "true")


@dataclass(frozen=True, eq=False)
class PaperRun:
    """One simulation run of the set."""

    scene: Scene  # with the true initial states
    # (n_objects, n_times, 3) m, the true ones at the times of the observation
    positions: NDArray[np.float64]
    observation: Observation  # what a learner gets

    def with_initial_states(self, source: str) -> PaperRun:
        """Return the same run with the initial states of another of `INITIAL_STATES`."""
        objects = tuple(
            ObservedObject(
                observed.object,
                observed.trajectory,
                _initial_state(observed.trajectory, truth, self.scene.environment, source),
            )
            for observed, truth in zip(self.observation.objects, self.scene.states, strict=True)
        )
        return replace(self, observation=replace(self.observation, objects=objects))


@dataclass(frozen=True, eq=False)
class PaperDataset:
    """A pool of objects, the θ_s they obey, and what was seen of them."""

    pool: tuple[SceneObject, ...]  # objects, each of its own material
    parameters: StaticParameters  # the true θ_s, of the pool's materials and the room's
    engine: str  # name of the engine that moved the objects
    # training, test: runs, 80 % and 20 %; a single run is one to train on
    training: tuple[PaperRun, ...]
    test: tuple[PaperRun, ...]

    @property
    def observations(self) -> list[Observation]:
        """Observations of all runs."""
        return self.training_observations + self.test_observations

    @property
    def training_observations(self) -> list[Observation]:
        """Observations that are learned from."""
        return [run.observation for run in self.training]

    @property
    def test_observations(self) -> list[Observation]:
        """Observations that are predicted."""
        return [run.observation for run in self.test]

    def with_initial_states(self, source: str) -> PaperDataset:
        """Return the same set with initial states of another of `INITIAL_STATES`."""
        return replace(
            self,
            training=tuple(run.with_initial_states(source) for run in self.training),
            test=tuple(run.with_initial_states(source) for run in self.test),
        )


def make_paper_dataset(
    objects: int,
    samples: int,
    rng: np.random.Generator,
    *,
    engine: str = "auto",
    initial_states: str = "three_points",
    kinds: Sequence[str] = SHAPE_KINDS,
    on_progress: Callable[[int, int], None] | None = None,
) -> PaperDataset:
    """Draw a pool of objects and throw them until each has `samples` trajectories.

    A run has k = ⌈N(1, 1)⌉ objects, at least one, of those that still lack trajectories. |θ_s| is
    14, 275, 945 for 1, 10, 20 objects (Eq. 3). The engine is one of `DATASET_ENGINES`,
    `initial_states` one of `INITIAL_STATES`, the kinds of shapes are some of `SHAPE_KINDS`.
    Progress is trajectories made, and trajectories in all.
    """
    if samples < 1:
        raise InvalidInputError(f"samples of each object are {samples}; expected at least 1")
    simulator = dataset_simulator(engine)
    pool = draw_pool(objects, rng, kinds)
    parameters = dataset_parameters(engine, pool, rng)
    lacking = np.full(objects, samples)
    runs = []
    while lacking.any():
        chosen = _draw_objects(lacking, rng)
        lacking[chosen] -= 1
        thrown = [pool[i] for i in chosen]
        runs.append(throw_objects(thrown, parameters, simulator, initial_states, rng))
        if on_progress is not None:
            on_progress(objects * samples - int(lacking.sum()), objects * samples)
    order = rng.permutation(len(runs))
    training = max(min(round(TRAINING_SHARE * len(runs)), len(runs) - 1), 1)
    return PaperDataset(
        pool,
        parameters,
        engine,
        tuple(runs[i] for i in np.sort(order[:training])),
        tuple(runs[i] for i in np.sort(order[training:])),
    )


def _draw_objects(lacking: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    candidates = np.flatnonzero(lacking)
    count = int(np.clip(np.ceil(rng.normal(1.0, 1.0)), 1, candidates.size))
    return rng.choice(candidates, count, replace=False)


def throw_objects(
    objects: Sequence[SceneObject],
    parameters: StaticParameters,
    simulator: Simulator,
    initial_states: str,
    rng: np.random.Generator,
) -> PaperRun:
    """Throw objects, each of a material of its own, through the room once, as Eq. 10 says.

    The random numbers are those of initial states, noise and id; `initial_states` is one of
    `INITIAL_STATES`.
    """
    scene = Scene(paper_room(), tuple(objects), draw_initial_states(objects, rng))
    times = np.arange(round(DURATION * SAMPLE_RATE) + 1) / SAMPLE_RATE
    rollout = simulator.rollout([scene], parameters, times, orientations=False)
    if rollout.status[0] != WorldStatus.OK:
        raise InvalidInputError(
            f"simulation with {simulator.name} ended with {WorldStatus(rollout.status[0]).name}; "
            "expected another engine or seed to do better"
        )
    return observed_run(scene, times, rollout.positions[0], initial_states, rng)


def observed_run(
    scene: Scene,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    initial_states: str,
    rng: np.random.Generator,
) -> PaperRun:
    """Return a run whose true motion is known, with the observation that a learner gets of it.

    The scene has the true initial states, `times` (n_times,) s begin at 0, the true `positions`
    (n_objects, n_times, 3) m. The random numbers are those of noise and id.
    """
    noisy = positions + rng.normal(0.0, POSITION_NOISE, positions.shape)
    observed = []
    for scene_object, truth, points in zip(scene.objects, scene.states, noisy, strict=True):
        trajectory = Trajectory(times, points)
        state = _initial_state(trajectory, truth, scene.environment, initial_states)
        observed.append(ObservedObject(scene_object, trajectory, state))
    observation = Observation(scene.environment, tuple(observed), 0.0, rng.bytes(16).hex())
    return PaperRun(scene, positions, observation)


def _initial_state(
    trajectory: Trajectory, truth: ObjectState, environment: Environment, source: str
) -> ObjectState:
    """Position and velocity fitted to the points, spin as Eq. 10 draws it, orientation known."""
    if source not in INITIAL_STATES:
        raise UnknownNameError(
            f"initial states are {source!r}; expected one of {', '.join(INITIAL_STATES)}"
        )
    if source == "true":
        return truth
    t, x, g = trajectory.times, trajectory.positions, environment.gravity
    count = 3 if source == "three_points" else flight_length(t, x, g, POSITION_NOISE)
    position, velocity, covariance = fit_noisy_flight(t[:count], x[:count], g, POSITION_NOISE)
    covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = SPIN_DEVIATION**2 * np.eye(3)
    return ObjectState(position, truth.orientation, velocity, covariance=covariance)


FORMAT = "intuitive_physics/paper_dataset/1"  # Name and version of the ground truth's file format
TRUTH_NAME, TABLE_NAME = "ground_truth.json", "trajectories.csv"  # Files beside the observations


def save_paper_dataset(dataset: PaperDataset, folder: Path) -> None:
    """Write a set into a folder, which must not exist or be empty.

    `training` and `test` get a file for each observation; `trajectories.csv` all points, seen and
    true; `ground_truth.json` the pool, the true θ_s, and the true initial states of each run.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidInputError(f"{folder} exists already; expected a new folder for the set")
    parts = {"training": dataset.training, "test": dataset.test}
    for name, runs in parts.items():
        if runs:
            save_observations([run.observation for run in runs], folder / name)
    truth = {
        "format": FORMAT,
        "engine": dataset.engine,
        "pool": [scene_object.to_dict() for scene_object in dataset.pool],
        "static_parameters": dataset.parameters.to_dict(),
        "runs": [_run_truth(run, name) for name, runs in parts.items() for run in runs],
    }
    write_whole(folder / TRUTH_NAME, json.dumps(truth, allow_nan=False))
    rows = [row for name, runs in parts.items() for row in _rows(runs, name)]
    write_csv(folder / TABLE_NAME, rows)


def _run_truth(run: PaperRun, part: str) -> dict[str, Any]:
    return {
        "observation": run.observation.id,
        "part": part,
        "objects": [scene_object.id for scene_object in run.scene.objects],
        "first_states": [state.to_dict() for state in run.scene.states],
    }


def _rows(runs: Sequence[PaperRun], part: str) -> list[dict[str, Any]]:
    return [
        {
            "part": part,
            "observation": run.observation.id,
            "object": observed.object.id,
            "time": float(time),
            **dict(zip(("x", "y", "z"), map(float, point), strict=True)),
            **dict(zip(("true_x", "true_y", "true_z"), map(float, true), strict=True)),
        }
        for run in runs
        for observed, positions in zip(run.observation.objects, run.positions, strict=True)
        for time, point, true in zip(
            observed.trajectory.times, observed.trajectory.positions, positions, strict=True
        )
    ]
