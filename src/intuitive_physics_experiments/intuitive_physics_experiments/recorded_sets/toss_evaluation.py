"""Fit friction and restitution to a part of recorded tosses, simulate the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.simulation import Simulator, pack_worlds
from intuitive_physics.validation import finite_array
from intuitive_physics_cli.evaluation.evaluation import split
from intuitive_physics_cli.plugins import make_engine
from intuitive_physics_experiments.recorded_sets.cube_tosses import (
    MATERIALS,
    CubeToss,
)
from intuitive_physics_experiments.recorded_sets.toss_mass_centre import (
    MassCentreFit,
    fit_mass_centre,
    with_mass_centre,
)
from intuitive_physics_experiments.recorded_sets.tumbling_flight import tumbling_flight
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.convergence import SearchProgress, SearchResult
from intuitive_physics_learner.search.parameter_search import ParameterSearch
from intuitive_physics_learner.search.update_rules import make_update_rule

FAILED_DISTANCE = 1000.0  # m; what a point counts that was not simulated, as in the learner's J


@dataclass(frozen=True, eq=False)
class TossErrors:
    """Errors of tosses, each the mean over the steps after the first row."""

    position: NDArray[np.float64]  # (..., n_tosses) distance of the centres over the cube's width
    # (..., n_tosses) rad, angle of the rotation between the orientations
    rotation: NDArray[np.float64]


class TossBatch:
    """Tosses in one environment, packed once to be simulated and judged many times."""

    def __init__(self, tosses: Sequence[CubeToss]) -> None:
        self._worlds = pack_worlds(
            [toss.observation.scene() for toss in tosses], StaticParameters.uniform(MATERIALS)
        )
        self.width = tosses[0].width
        tracks = [toss.observation.objects[0].trajectory for toss in tosses]
        steps = max(len(track) for track in tracks) - 1
        self._times = np.full((len(tosses), steps), np.nan)
        self._positions = np.zeros((len(tosses), steps, 3))
        self._orientations = np.zeros((len(tosses), steps, 4))
        for row, (toss, track) in enumerate(zip(tosses, tracks, strict=True)):
            self._times[row, : len(track) - 1] = track.times[1:] - track.times[0]
            self._positions[row, : len(track) - 1] = track.positions[1:]
            self._orientations[row, : len(track) - 1] = toss.orientations[1:]

    @property
    def times(self) -> NDArray[np.float64]:
        """Shape (n_tosses, n_steps), s after the first row; NaN after a toss's end."""
        return self._times

    def simulated(self, simulator: Simulator, candidates: Sequence[StaticParameters]) -> TossErrors:
        """Errors (n_candidates, n_tosses) of simulating every toss from its first row."""
        count = len(candidates)
        rollout = simulator.rollout_batch(
            self._worlds.crossed(candidates), np.tile(self._times, (count, 1)), orientations=True
        )
        shape = (count, *self._times.shape)
        return self.errors(
            rollout.positions[:, 0].reshape(*shape, 3),
            np.asarray(rollout.orientations)[:, 0].reshape(*shape, 4),
        )

    def errors(
        self, positions: NDArray[np.float64], orientations: NDArray[np.float64]
    ) -> TossErrors:
        """Errors of positions (..., n_tosses, n_steps, 3) m and orientations (..., 4).

        A pose that is not finite at a step that was recorded counts `FAILED_DISTANCE` and half a
        turn.
        """
        recorded = np.isfinite(self._times)
        distances = np.linalg.norm(positions - self._positions, axis=-1)
        distances = np.where(np.isfinite(distances), distances, FAILED_DISTANCE)
        angles = rotation_angles(orientations, self._orientations)
        angles = np.where(np.isfinite(angles), angles, np.pi)
        steps = recorded.sum(axis=-1)
        return TossErrors(
            np.where(recorded, distances, 0.0).sum(axis=-1) / steps / self.width,
            np.where(recorded, angles, 0.0).sum(axis=-1) / steps,
        )


def rotation_angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle (...) rad, 0 to π, of the rotation from a (..., 4) to b (..., 4), unit quaternions."""
    # As 4 atan2(|a - b|, |a + b|), which is exact for small angles where acos(a · b) is not;
    # b and -b are the same rotation, the nearer one counts.
    apart, together = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return 4.0 * np.arctan2(np.minimum(apart, together), np.maximum(apart, together))


# The library's defaults, with dynamic friction for both.
DEFAULT_FRICTION, DEFAULT_RESTITUTION = 0.4, 0.5

# s; MuJoCo's contacts are springs: a bounce lasts one of these times, the one that fits best.
MUJOCO_STEP, MUJOCO_CONTACT_TIMES = 0.002, (0.008, 0.016, 0.032)

CMA_SETTINGS = {"population": 8}  # Two parameters need no generations as large as those of Table I


class FrictionAndRestitution:
    """The search space of μ_s = μ_d and e, each from 0 to 1, of a cube and a table."""

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 2

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point `unit` (2,) of the unit square, clipped to it, to θ_s."""
        point = np.clip(finite_array(unit, "friction and restitution", (2,)), 0.0, 1.0)
        return toss_parameters(*point.tolist())


@dataclass(frozen=True, eq=False)
class TossFit:
    """Fit of one engine to the tosses."""

    simulator: Simulator  # the engine, of those of that name the one that fitted best
    search: SearchResult  # how the fit went; its cost is that of `toss_cost`, m
    # fitted, default: errors in training and in the test with fitted and with default parameters
    fitted: tuple[TossErrors, TossErrors]
    default: tuple[TossErrors, TossErrors]


@dataclass(frozen=True, eq=False)
class TossEvaluation:
    """Result of an evaluation."""

    # training, test: tosses fitted to and not fitted to
    training: tuple[CubeToss, ...]
    test: tuple[CubeToss, ...]
    fits: dict[str, TossFit]  # by the engine's name
    # errors in training and in the test of flying until the first touch
    free_flight: tuple[TossErrors, TossErrors]
    mass_centre: MassCentreFit | None = None  # what was learned of it, if it was


def toss_parameters(friction: float, restitution: float) -> StaticParameters:
    """θ_s of cube and table: μ_s = μ_d, e, and no rolling friction, which a cube does not feel."""
    return StaticParameters.uniform(
        MATERIALS,
        static_friction=friction,
        dynamic_friction=friction,
        rolling_friction=0.0,
        restitution=restitution,
    )


def toss_cost(errors: TossErrors, width: float) -> NDArray[np.float64]:
    """Cost in m, shape (...), of errors (..., n_tosses): mean distance plus turn × half the width.

    A turn moves the middle of a face by half the cube's width times the angle, so both parts say
    how far the cube's surface is from where it was seen.
    """
    return width * (errors.position + 0.5 * errors.rotation).mean(axis=-1)


def evaluate_tosses(
    tosses: Sequence[CubeToss],
    engines: Sequence[str],
    options: LearningOptions,
    train_fraction: float = 0.25,
    on_progress: Callable[[SearchProgress], None] | None = None,
    learn_mass_centre: bool = False,
) -> TossEvaluation:
    """Split at random (by the options' seed), fit each engine to one part, simulate both.

    `learn_mass_centre`: the cube's centre of mass is fitted too, to the flights of the training
    part.
    """
    training, test = split(tosses, train_fraction, options.seed)
    centre = fit_mass_centre(training) if learn_mass_centre else None
    if centre is not None:
        training, test = (
            [with_mass_centre(toss, centre.mass_centre) for toss in part]
            for part in (training, test)
        )
    parts = (TossBatch(training), TossBatch(test))
    fits = {}
    for name in engines:
        searches = [
            (_fit(parts[0], simulator, options, on_progress), simulator)
            for simulator in toss_simulators(name)
        ]
        search, simulator = min(searches, key=lambda pair: pair[0].cost)
        default = toss_parameters(DEFAULT_FRICTION, DEFAULT_RESTITUTION)
        fits[name] = TossFit(
            simulator,
            search,
            fitted=_both(parts, simulator, search.parameters),
            default=_both(parts, simulator, default),
        )
    flights = (_fly(training, parts[0]), _fly(test, parts[1]))
    return TossEvaluation(tuple(training), tuple(test), fits, flights, centre)


def toss_simulators(name: str) -> list[Simulator]:
    """Engines of that name to fit with: MuJoCo's contacts are fitted in their softness too."""
    if name == "mujoco":
        from intuitive_physics_experiments.engines.mujoco_simulator import MujocoSimulator

        return [
            MujocoSimulator(time_step=MUJOCO_STEP, contact_time=time)
            for time in MUJOCO_CONTACT_TIMES
        ]
    return [make_engine(name)]


def _fit(
    batch: TossBatch,
    simulator: Simulator,
    options: LearningOptions,
    on_progress: Callable[[SearchProgress], None] | None,
) -> SearchResult:
    space = FrictionAndRestitution()
    rule = make_update_rule(
        options.method,
        space.size,
        np.random.default_rng(options.seed),
        (DEFAULT_FRICTION, DEFAULT_RESTITUTION),
        **(CMA_SETTINGS if options.method == "cma_es" else {}),
    )

    def costs(candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        return toss_cost(batch.simulated(simulator, candidates), batch.width)

    search = ParameterSearch(costs, space, rule)
    return search.run(options.criteria, on_progress=on_progress)


def _both(
    parts: tuple[TossBatch, TossBatch], simulator: Simulator, parameters: StaticParameters
) -> tuple[TossErrors, TossErrors]:
    training, test = (part.simulated(simulator, [parameters]) for part in parts)
    return _only(training), _only(test)


def _only(errors: TossErrors) -> TossErrors:
    return TossErrors(errors.position[0], errors.rotation[0])


def _fly(tosses: Sequence[CubeToss], batch: TossBatch) -> TossErrors:
    positions = np.full((*batch.times.shape, 3), np.nan)
    orientations = np.full((*batch.times.shape, 4), np.nan)
    for row, (toss, times) in enumerate(zip(tosses, batch.times, strict=True)):
        (cube,) = toss.observation.objects
        flown = times[np.isfinite(times)]
        positions[row, : flown.size], orientations[row, : flown.size] = tumbling_flight(
            toss.observation.environment, toss.width, cube.initial_state, flown
        )
    return batch.errors(positions, orientations)
