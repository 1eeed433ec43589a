"""Inputs of live prediction, and predictions with what they were made from."""

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
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics.state import ObjectState
from intuitive_physics.validation import increasing_times
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.live.settings import PredictionSettings, check_size
from intuitive_physics_predictor.noisy_newton import PreparedScene, predict_sampled
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

CLOCK_TOLERANCE = 0.1
"""s that states may be stamped ahead of this machine's clock: cameras keep a time of their own."""


class NothingToPredictError(IntuitivePhysicsError):
    """What a prediction is made from is not there, or too old."""


class NoObjectsError(NothingToPredictError):
    """No objects are tracked; not a fault."""


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
    prepared : the scene, from which the same samples are drawn again
    settings : how it was predicted
    learned : θ_s; None: nothing was learned
    start : s, on the clock of the states' stamp
    states_stamp : s, when the states were seen
    seed : of the noise
    environment_version : of the message that brought it
    """

    distribution: TrajectoryDistribution
    prepared: PreparedScene
    settings: PredictionSettings
    learned: LearnedParameters | None
    start: float
    states_stamp: float
    seed: int
    environment_version: int

    @property
    def scene(self) -> Scene:
        """What was predicted, as perceived."""
        return self.prepared.scene

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
        settings = self.settings
        check_size(sample_count, len(self.scene.objects), times.size)
        distribution = predict_sampled(
            self.scene,
            settings.draw(self.prepared, sample_count, np.random.default_rng(self.seed)),
            self.start - self.states_stamp + times,
            simulator=settings.engine,
            orientations=True,
        )
        return replace(distribution, times=times)


def uncertain_parameters(
    learned: LearnedParameters | None, materials: tuple[str, ...], settings: PredictionSettings
) -> UncertainParameters:
    """Return the distribution of θ_s over what was learned and these materials.

    A material nobody has learned of may be anything.
    """
    known = learned or LearnedParameters.defaults(materials)
    all_of_them = tuple(dict.fromkeys((*known.materials, *materials)))
    return settings.noise_scales.parameters(known.extended(all_of_them))


def prepare(
    scene: Scene, parameters: UncertainParameters, settings: PredictionSettings
) -> PreparedScene:
    """Return a scene prepared to be predicted again and again.

    Raises
    ------
    InvalidInputError, UnknownNameError
        As `PreparedScene.of`.
    """
    return PreparedScene.of(scene, parameters, settings.state_noise)


def predict_prepared(
    prepared: PreparedScene,
    worlds: WorldBatch,
    settings: PredictionSettings,
    *,
    learned: LearnedParameters | None,
    times: NDArray[np.float64],
    start: float,
    states_stamp: float,
    seed: int,
    environment_version: int,
) -> LivePrediction:
    """Simulate samples of a scene from its states' stamp on; record from `start` on.

    Parameters
    ----------
    worlds : the samples
    times : (n_times,) s after `start`
    seed : that the samples were drawn with

    Raises
    ------
    InvalidInputError
        When the prediction would be too large.
    PredictionFailedError, UnsupportedSceneError
        As `noisy_newton.predict`.
    """
    check_size(worlds.size, len(prepared.scene.objects), times.size)
    distribution = predict_sampled(
        prepared.scene, worlds, start - states_stamp + times, simulator=settings.engine
    )
    return LivePrediction(
        distribution=replace(distribution, times=times),
        prepared=prepared,
        settings=settings,
        learned=learned,
        start=start,
        states_stamp=states_stamp,
        seed=seed,
        environment_version=environment_version,
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
        When objects overlap, or a number is not what it must be.
    PredictionFailedError, UnsupportedSceneError
        As `noisy_newton.predict`.
    """
    # What is perceived may overlap by its noise; a scene that is made up should not.
    check_overlaps([scene], pack_worlds([scene], StaticParameters.uniform(scene.materials)))
    checked = increasing_times(times, "times")
    check_size(sample_count, len(scene.objects), checked.size)
    prepared = prepare(scene, uncertain_parameters(learned, scene.materials, settings), settings)
    return predict_prepared(
        prepared,
        settings.draw(prepared, sample_count, np.random.default_rng(seed)),
        settings,
        learned=learned,
        times=checked,
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
    limit = settings.stale_after
    age = monotonic - seen.arrived
    if settings.carry_forward:
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
