"""The prediction that is due now, from the newest of everything."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.simulation import pack_worlds
from intuitive_physics.simulation.overlap_check import check_overlaps
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import increasing_times
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.live.prediction_settings import PredictionSettings

CLOCK_TOLERANCE = 0.1
"""s that states may be stamped ahead of this machine's clock: cameras keep a time of their own."""


class NothingToPredictError(IntuitivePhysicsError):
    """What a prediction is made from is not there, or too old."""


class NoObjectsError(NothingToPredictError):
    """Nothing moves, or nothing is there, which is nobody's fault."""


@dataclass(frozen=True, eq=False)
class SeenStates:
    """Objects and their states at one time.

    Parameters
    ----------
    stamp : s, when they were seen
    arrived : s on a clock that always goes on (`time.monotonic`)
    delay : s, how old they were by their stamp when they arrived
    frame_id : frame they are in
    """

    objects: tuple[SceneObject, ...]
    states: tuple[ObjectState, ...]
    stamp: float
    arrived: float
    delay: float
    frame_id: str


@dataclass(frozen=True, eq=False)
class Inputs:
    """The newest of each input; None is what has not come yet.

    Parameters
    ----------
    learned : θ_s
    """

    environment: Environment | None = None
    environment_version: int = 0
    learned: LearnedParameters | None = None
    seen: SeenStates | None = None

    def perceived(self) -> tuple[Environment, SeenStates]:
        """Return environment and states.

        Raises
        ------
        NothingToPredictError
            When one of them has not come yet.
        """
        if self.environment is None or self.seen is None:
            missing = "environment" if self.environment is None else "object states"
            raise NothingToPredictError(f"no {missing} yet")
        return self.environment, self.seen

    @cached_property
    def scene(self) -> Scene:
        """What is to be predicted.

        Raises
        ------
        NothingToPredictError
            When environment or states have not come yet, or hold no objects.
        InvalidInputError
            When they are in different frames or do not go together.
        """
        environment, seen = self.perceived()
        if not seen.objects:
            raise NoObjectsError("no objects are seen")
        if seen.frame_id != environment.frame_id:
            raise InvalidInputError(
                f"object states are in frame {seen.frame_id!r}; "
                f"expected {environment.frame_id!r}, the environment's"
            )
        return Scene(environment, seen.objects, seen.states)


@dataclass(frozen=True, eq=False)
class LivePrediction:
    """A prediction and what it was made from.

    Parameters
    ----------
    distribution : its times count from `start`
    start : s, on the clock of the states' stamp
    states_stamp : s, when the states were seen
    seed : of the noise
    scene, learned, settings, environment_version : what it was made from
    """

    distribution: TrajectoryDistribution
    scene: Scene
    learned: LearnedParameters | None
    settings: PredictionSettings
    start: float
    states_stamp: float
    seed: int
    environment_version: int

    @property
    def static_parameters_version(self) -> int:
        """Version of θ_s; 0: nothing was learned."""
        return 0 if self.learned is None else self.learned.version

    def again(self, times: NDArray[np.float64], sample_count: int) -> TrajectoryDistribution:
        """Predict from the same inputs, with orientations; as many samples are the same ones.

        Parameters
        ----------
        times : (n_times,) s after `start`
        """
        distribution = self.settings.predict(
            self.scene,
            self.learned,
            self.start - self.states_stamp + times,
            seed=self.seed,
            sample_count=sample_count,
            orientations=True,
        )
        return replace(distribution, times=times)


def predict_now(
    inputs: Inputs, settings: PredictionSettings, *, seed: int, now: float, monotonic: float
) -> LivePrediction:
    """Carry the newest states forward to now and predict from there.

    Both are one simulation: of the samples, from the states' stamp on, that is written down from
    now on.

    Parameters
    ----------
    seed : of the noise
    now : s, on the clock of the stamps
    monotonic : s, now on the clock of `SeenStates.arrived`

    Raises
    ------
    NothingToPredictError
        When there is no environment, no states, they are too old or have no objects.
    InvalidInputError
        When states and environment are in different frames or the scene or settings cannot be.
    PredictionFailedError, UnsupportedSceneError
        As `noisy_newton.predict`.
    """
    _, seen = inputs.perceived()
    check_fresh(seen, settings, now, monotonic)
    scene = inputs.scene
    start = max(now, seen.stamp) if settings.options.carry_forward else seen.stamp
    distribution = settings.predict(
        scene,
        inputs.learned,
        start - seen.stamp + settings.times,
        seed=seed,
        sample_count=settings.options.sample_count,
    )
    return LivePrediction(
        distribution=replace(distribution, times=settings.times),
        scene=scene,
        learned=inputs.learned,
        settings=settings,
        start=start,
        states_stamp=seen.stamp,
        seed=seed,
        environment_version=inputs.environment_version,
    )


def predict_scene(
    scene: Scene,
    learned: LearnedParameters | None,
    settings: PredictionSettings,
    times: ArrayLike,
    *,
    seed: int,
    sample_count: int,
    start: float,
    environment_version: int = 0,
) -> LivePrediction:
    """Predict a scene that somebody asks about, from its states on.

    Parameters
    ----------
    times : (n_times,) s after `start`, strictly increasing, none negative
    start : s, which the states are taken to be of

    Raises
    ------
    InvalidInputError
        When objects are in one another, or a number is not what it must be.
    PredictionFailedError, UnsupportedSceneError
        As `noisy_newton.predict`.
    """
    # What is perceived may overlap by its noise; a scene that is made up should not.
    check_overlaps([scene], pack_worlds([scene], StaticParameters.uniform(scene.materials)))
    distribution = settings.predict(
        scene,
        learned,
        increasing_times(times, "times"),
        seed=seed,
        sample_count=sample_count,
    )
    return LivePrediction(
        distribution=distribution,
        scene=scene,
        learned=learned,
        settings=settings,
        start=start,
        states_stamp=start,
        seed=seed,
        environment_version=environment_version,
    )


def check_fresh(
    seen: SeenStates, settings: PredictionSettings, now: float, monotonic: float
) -> None:
    """Check that states are new enough, by when they arrived and by their stamp.

    Raises
    ------
    NothingToPredictError
        When they are not, or are stamped ahead of the clock.
    """
    limit = settings.options.stale_after
    age = monotonic - seen.arrived
    if settings.options.carry_forward:
        if not -CLOCK_TOLERANCE <= seen.delay <= limit:
            when = "old" if seen.delay > 0.0 else "in the future"
            raise NothingToPredictError(
                f"object states arrive {abs(seen.delay):.1f} s {when}; expected at most "
                f"{limit:g} s old: set use_sim_time where they are of a replayed bag, or "
                "carry_forward to false where they are stamped by another clock"
            )
        age = max(age, now - seen.stamp)
    if age > limit:
        raise NothingToPredictError(
            f"the newest object states are {age:.1f} s old; expected at most {limit:g} s"
        )
