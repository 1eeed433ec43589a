"""Inputs of live prediction, and a prediction with all it was made from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Detections
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.simulation import pack_worlds
from intuitive_physics.simulation.rigid_bodies.overlaps import check_overlaps
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import increasing_times
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.noisy_newton import PreparedScene

CLOCK_TOLERANCE = 0.1
"""Largest lead, in s, of the states' stamp over this machine's clock: cameras may have clocks of
their own. Our choice."""


class NothingToPredictError(IntuitivePhysicsError):
    """Inputs of a prediction are missing or too old."""


class OtherClockError(NothingToPredictError):
    """States are stamped by a clock other than the one they are predicted on."""


class NoObjectsError(NothingToPredictError):
    """No objects tracked; not an error."""


@dataclass(frozen=True, eq=False)
class PerceivedStates:
    """Objects and their states at one time.

    Parameters
    ----------
    stamp : s, when they were seen
    arrived : s, on a clock that never stops (`time.monotonic`)
    delay : s, their age by their stamp when they arrived
    frame_id : frame of the states
    detections : new ones of each object, up to the stamp; None where there are none; empty: not
        known
    """

    objects: tuple[SceneObject, ...]
    states: tuple[ObjectState, ...]
    stamp: float
    arrived: float
    delay: float
    frame_id: str
    detections: tuple[Detections | None, ...] = ()


@dataclass(frozen=True, eq=False)
class Inputs:
    """The newest of each input; None while it has not arrived.

    Parameters
    ----------
    learned : θ_s
    """

    environment: Environment | None = None
    environment_version: int = 0
    learned: LearnedParameters | None = None
    states: PerceivedStates | None = None

    def perceived(self) -> tuple[Environment, PerceivedStates]:
        """Return environment and states.

        Raises
        ------
        NothingToPredictError
            When one of them has not arrived.
        """
        if self.environment is None or self.states is None:
            missing = "environment" if self.environment is None else "object states"
            raise NothingToPredictError(f"no {missing} yet")
        return self.environment, self.states

    @cached_property
    def scene(self) -> Scene:
        """Scene to predict.

        Raises
        ------
        NothingToPredictError
            When environment or states have not arrived, or there are no objects.
        InvalidInputError
            When they are in different frames or do not match.
        """
        environment, states = self.perceived()
        if not states.objects:
            raise NoObjectsError("no objects are seen")
        if states.frame_id != environment.frame_id:
            raise InvalidInputError(
                f"object states are in frame {states.frame_id!r}; "
                f"expected {environment.frame_id!r}, the environment's"
            )
        return Scene(environment, states.objects, states.states)


@dataclass(frozen=True, eq=False)
class LivePrediction:
    """A prediction and what it was made from; immutable, so that threads may share it.

    Parameters
    ----------
    distribution : its times count from `start`
    start : s, on the clock of the states' stamp
    states_stamp : s, when the states were seen
    seed : of the noise
    prepared, learned, settings, environment_version : what it was made from
    """

    distribution: TrajectoryDistribution
    prepared: PreparedScene
    learned: LearnedParameters | None
    settings: PredictionSettings
    start: float
    states_stamp: float
    seed: int
    environment_version: int

    @property
    def scene(self) -> Scene:
        """Scene that was predicted."""
        return self.prepared.scene

    @property
    def static_parameters_version(self) -> int:
        """Version of θ_s; 0 without learned parameters."""
        return 0 if self.learned is None else self.learned.version

    def stopped_by(self, flag: StopFlag) -> LivePrediction:
        """Return the same prediction, whose repetitions end once the flag is set."""
        return replace(self, settings=self.settings.stopped_by(flag))

    def repeat(self, times: NDArray[np.float64], sample_count: int) -> TrajectoryDistribution:
        """Predict from the same inputs, with orientations, at times (n_times,) s after `start`.

        The same count gives the same samples.
        """
        distribution = self.settings.predict(
            self.prepared,
            self.start - self.states_stamp + times,
            seed=self.seed,
            sample_count=sample_count,
            orientations=True,
        )
        return replace(distribution, times=times)


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
    """Predict any scene, from its states on.

    Parameters
    ----------
    times : (n_times,) s after `start`, strictly increasing, none negative
    start : s, time of the states

    Raises
    ------
    InvalidInputError
        When objects overlap, or a number is invalid.
    PredictionFailedError, UnsupportedSceneError
        As `noisy_newton.predict`.
    """
    checked_times = increasing_times(times, "times")
    settings.check_horizon(float(checked_times[-1]))
    parameters = settings.uncertain_parameters(learned, scene.materials)
    # Noise makes perceived objects overlap; a requested scene should not.
    check_overlaps([scene], pack_worlds([scene], StaticParameters.uniform(scene.materials)))
    prepared = settings.prepare(scene, parameters)
    distribution = settings.predict(
        prepared,
        checked_times,
        seed=seed,
        sample_count=sample_count,
    )
    return LivePrediction(
        distribution=distribution,
        prepared=prepared,
        learned=learned,
        settings=settings,
        start=start,
        states_stamp=start,
        seed=seed,
        environment_version=environment_version,
    )


def check_fresh(
    states: PerceivedStates, options: PredictionOptions, now: float, monotonic: float
) -> None:
    """Check the age of states, by their arrival and by their stamp.

    Parameters
    ----------
    now : s, on the clock of the stamps
    monotonic : s, now on the clock of `PerceivedStates.arrived`

    Raises
    ------
    OtherClockError
        When they arrive too old by their stamp, or stamped ahead of the clock.
    NothingToPredictError
        When they are too old meanwhile.
    """
    limit = options.stale_after
    age = monotonic - states.arrived
    if options.carry_forward:
        if not -CLOCK_TOLERANCE <= states.delay <= limit:
            when = "old" if states.delay > 0.0 else "in the future"
            raise OtherClockError(
                f"object states arrive {abs(states.delay):.1f} s {when}; expected at most "
                f"{limit:g} s old: set use_sim_time where they are of a replayed bag, or "
                "carry_forward to false where they are stamped by another clock"
            )
        age = max(age, now - states.stamp)
    if age > limit:
        raise NothingToPredictError(
            f"the newest object states are {age:.1f} s old; expected at most {limit:g} s"
        )
