"""Live predictor: the newest inputs, and all that is kept from one prediction to the next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics_predictor.estimation.object_estimate import SceneEstimate, Surroundings
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates
from intuitive_physics_predictor.live.live_prediction import (
    Inputs,
    LivePrediction,
    NothingToPredictError,
    PerceivedStates,
    check_fresh,
)
from intuitive_physics_predictor.live.self_calibration import Factor, SelfCalibration
from intuitive_physics_predictor.live.settings import PredictionSettings
from intuitive_physics_predictor.noisy_newton import PreparedScene
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters


@dataclass(frozen=True, eq=False)
class Snapshot:
    """State of a predictor at one time; immutable, so that other threads may use it.

    Parameters
    ----------
    newest : prediction; None while nothing can be predicted
    estimates : of each object of the newest states, as `SceneEstimate`; empty: of none
    factors : on the noise of the states, as earlier predictions met what was seen
    """

    inputs: Inputs
    settings: PredictionSettings
    newest: LivePrediction | None = None
    estimates: tuple[WeightedStates | None, ...] = ()
    factors: Mapping[str, Factor] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _DrawnAhead:
    """Samples of a scene, and what they were drawn with."""

    prepared: PreparedScene
    seed: int
    worlds: WorldBatch


class Predictor:
    """Predicts from the newest inputs, one prediction after the other.

    One thread owns it: only `snapshot` may be read by others. The distribution of θ_s, the prepared
    scene and the samples drawn ahead are kept while what they are made from stays; they change no
    prediction.

    Parameters
    ----------
    settings : how to predict
    seed : of the next prediction's noise, one more after each prediction
    inputs : default: none yet
    calibration : factors on uncertainties from earlier predictions; default: none yet
    """

    def __init__(
        self,
        settings: PredictionSettings,
        seed: int = 0,
        inputs: Inputs | None = None,
        calibration: SelfCalibration | None = None,
    ) -> None:
        self.calibration = calibration or SelfCalibration()
        self.snapshot = Snapshot(inputs or Inputs(), settings, factors=self.calibration.factors())
        self._seed = seed
        self._surroundings: Surroundings | None
        self._scene_estimate = SceneEstimate(np.random.default_rng(seed))
        self._uncertain: (
            tuple[LearnedParameters | None, tuple[str, ...], UncertainParameters] | None
        )
        self._prepared: tuple[Scene, LearnedParameters | None, PreparedScene] | None
        self._drawn: _DrawnAhead | None
        self._taking: Iterator[None] | None = None
        self._forget()

    def take(self, **newer: Any) -> None:
        """Take over newer inputs, given by the names of the fields of `Inputs`."""
        perceived = newer.pop("states", None)
        if newer:
            inputs = replace(self.snapshot.inputs, **newer)
            self.snapshot = replace(self.snapshot, inputs=inputs)
        if perceived is not None:
            for _ in self.take_states(perceived):
                pass

    def take_states(self, perceived: PerceivedStates) -> Iterator[None]:
        """Take over newer states, and yield between one object and the next.

        Each takes a good part of a tick's time. Until the last step, predictions begin with the
        earlier states. Steps that are left of those are done first.
        """
        for _ in self._taking or ():
            pass
        self._taking = self._take_states(perceived)
        return self._taking

    @property
    def is_taking(self) -> bool:
        """Whether states are taken over, of which not all objects are done yet."""
        return self._taking is not None

    def _take_states(self, perceived: PerceivedStates) -> Iterator[None]:
        try:
            self._compare(perceived)
            estimates: list[WeightedStates | None] = []
            for states in self._estimated(perceived):
                estimates.append(states)
                if len(estimates) < len(perceived.objects):
                    yield
            inputs = replace(self.snapshot.inputs, states=perceived)
            self.snapshot = replace(self.snapshot, inputs=inputs, estimates=tuple(estimates))
        finally:
            self._taking = None

    def set(self, *, settings: PredictionSettings | None = None, seed: int | None = None) -> None:
        """Set how, or with which seed, the next prediction is made."""
        if settings is not None:
            self.snapshot = replace(self.snapshot, settings=settings)
            self._forget()
        if seed is not None:
            self._seed = seed

    def draw_ahead(self) -> None:
        """Draw the samples of the next prediction, which depend on no time.

        Where they cannot be drawn, `predict` raises the reason.
        """
        with suppress(Exception):
            self._samples(self._prepare())

    def predict(self, *, now: float, monotonic: float) -> LivePrediction:
        """Predict from now on, from states carried forward to now.

        Both are one simulation: of the samples, from the states' stamp on, whose output begins now.

        Parameters
        ----------
        now : s, on the clock of the stamps
        monotonic : s, now on the clock of `PerceivedStates.arrived`

        Raises
        ------
        NothingToPredictError
            When environment or states are missing, or the states are too old or have no objects.
        InvalidInputError
            When states and environment are in different frames or the scene or settings are
            invalid.
        PredictionFailedError, UnsupportedSceneError
            As `noisy_newton.predict`.
        """
        try:
            made = self._predict(now, monotonic)
        except Exception:
            self.snapshot = replace(self.snapshot, newest=None)
            raise
        self.snapshot = replace(self.snapshot, newest=made)
        gravity = made.scene.environment.gravity
        self.calibration.take_prediction(
            made.distribution, made.start, gravity, made.prepared.guessed
        )
        self._seed += 1
        return made

    def _predict(self, now: float, monotonic: float) -> LivePrediction:
        """Take the steps of a tick, as docs/method/prediction.md has them."""
        inputs, settings = self.snapshot.inputs, self.snapshot.settings
        _, states = inputs.perceived()
        check_fresh(states, settings.options, now, monotonic)
        prepared = self._prepare()
        samples = self._samples(prepared)
        start = max(now, states.stamp) if settings.options.carry_forward else states.stamp
        distribution = settings.predict(
            prepared,
            start - states.stamp + settings.times,
            seed=self._seed,
            sample_count=settings.options.sample_count,
            drawn=samples,
        )
        return LivePrediction(
            distribution=replace(distribution, times=settings.times),
            prepared=prepared,
            learned=inputs.learned,
            settings=settings,
            start=start,
            states_stamp=states.stamp,
            seed=self._seed,
            environment_version=inputs.environment_version,
        )

    def _prepare(self) -> PreparedScene:
        """Return the prepared scene of the newest inputs; the newest one is kept."""
        inputs, settings = self.snapshot.inputs, self.snapshot.settings
        scene, learned = inputs.scene, inputs.learned
        kept = self._prepared
        if kept is None or kept[0] is not scene or kept[1] is not learned:
            parameters = self._parameters(learned, scene.materials)
            prepared = settings.prepare(
                scene, parameters, self.snapshot.estimates, self.calibration
            )
            self._prepared = kept = (scene, learned, prepared)
        return kept[2]

    def _compare(self, perceived: PerceivedStates) -> None:
        """Compare the new detections with the predictions of their time."""
        if not perceived.detections:
            return
        for item, detections in zip(perceived.objects, perceived.detections, strict=True):
            if detections is not None:
                self.calibration.take_detection(
                    item.id,
                    float(detections.times[-1]),
                    detections.positions[-1],
                    detections.covariances[-1] + detections.bias,
                )
        self.snapshot = replace(self.snapshot, factors=self.calibration.factors())

    def _estimated(self, perceived: PerceivedStates) -> Iterator[WeightedStates | None]:
        """Yield the estimate of each object from all its detections so far."""
        inputs, settings = replace(self.snapshot.inputs, states=perceived), self.snapshot.settings
        if not perceived.detections or not settings.options.estimate_states:
            return
        try:
            scene = inputs.scene
        except (NothingToPredictError, InvalidInputError):
            # The next prediction from these states says what is wrong with them.
            return
        uncertain = self._parameters(inputs.learned, scene.materials)
        surroundings = self._surroundings
        if surroundings is None or (
            surroundings.environment is not scene.environment
            or surroundings.uncertain is not uncertain
        ):
            engine = settings.estimation_simulator
            surroundings = Surroundings(
                scene.environment, uncertain, engine, settings.options.spin_prior
            )
            self._surroundings = surroundings
        yield from self._scene_estimate.updates(
            surroundings,
            perceived.objects,
            perceived.states,
            perceived.stamp,
            perceived.detections,
            settings.state_noise(self.calibration).guess_scale,
        )

    def _parameters(
        self, learned: LearnedParameters | None, materials: tuple[str, ...]
    ) -> UncertainParameters:
        """Return the distribution of θ_s; the newest one is kept."""
        kept = self._uncertain
        if kept is None or kept[0] is not learned or kept[1] != materials:
            uncertain = self.snapshot.settings.uncertain_parameters(learned, materials)
            self._uncertain = kept = (learned, materials, uncertain)
        return kept[2]

    def _samples(self, prepared: PreparedScene) -> WorldBatch:
        """Return the samples of the next prediction, the ones drawn ahead if they match."""
        drawn = self._drawn
        if drawn is None or drawn.prepared is not prepared or drawn.seed != self._seed:
            settings = self.snapshot.settings
            worlds = settings.draw(prepared, self._seed, settings.options.sample_count)
            self._drawn = drawn = _DrawnAhead(prepared, self._seed, worlds)
        return drawn.worlds

    def _forget(self) -> None:
        """Drop all that was made with earlier settings."""
        self._uncertain = self._prepared = self._drawn = None
        self._surroundings = None
