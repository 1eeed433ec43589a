"""The live predictor: the newest inputs, what is prepared of them, and the newest prediction."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics_predictor.live.live_prediction import (
    Inputs,
    LivePrediction,
    check_fresh,
    predict_prepared,
    prepare,
    uncertain_parameters,
)
from intuitive_physics_predictor.live.settings import PredictionSettings
from intuitive_physics_predictor.noisy_newton import PreparedScene
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters


@dataclass(frozen=True, eq=False)
class PrefetchedSamples:
    """Samples of a scene that were drawn before they were due, and what they were drawn from.

    Parameters
    ----------
    seed : of the noise
    worlds : one a sample
    """

    prepared: PreparedScene
    settings: PredictionSettings
    seed: int
    worlds: WorldBatch


class Predictor:
    """Predicts from the newest inputs, again and again.

    Everything that changes is here and belongs to one thread, which calls all methods. Other
    threads may read `inputs`, `settings` and `newest`: each is an immutable object that is replaced
    as a whole, and a `LivePrediction` can be questioned without this object.

    Parameters
    ----------
    settings : how to predict; may be replaced
    seed : of the next prediction's noise, one more after each
    """

    def __init__(self, settings: PredictionSettings, seed: int = 0) -> None:
        self.settings = settings
        self.seed = seed
        self.inputs = Inputs()
        self.newest: LivePrediction | None = None
        self._uncertain: tuple[Any, UncertainParameters] | None = None
        self._prepared: tuple[Any, PreparedScene] | None = None
        self._prefetched: PrefetchedSamples | None = None

    def take(self, **newer: Any) -> None:
        """Take inputs that are newer, fields of `Inputs` by name."""
        self.inputs = replace(self.inputs, **newer)

    def prefetch(self) -> None:
        """Draw the samples of the next prediction before it is due.

        What is drawn depends on no time, and the prediction is the same to the bit without it.
        Inputs that nothing can be drawn from are left to `predict`, which reports them.
        """
        with suppress(IntuitivePhysicsError):
            self._prefetched = self._samples(self._prepare(self.inputs.scene, self.inputs.learned))

    def predict(self, now: float, monotonic: float) -> LivePrediction:
        """Carry the newest states forward to now and predict from there.

        Both are one simulation of the samples: from the states' stamp on, recorded from now on.

        Parameters
        ----------
        now : s, on the clock of the stamps
        monotonic : s, now on the clock of `SeenStates.arrived`

        Raises
        ------
        NothingToPredictError
            When there is no environment, no states, they are too old or have no objects.
        InvalidInputError
            When states and environment are in different frames or cannot be simulated.
        PredictionFailedError, UnsupportedSceneError
            As `noisy_newton.predict`.
        """
        try:
            self.newest = self._predict(now, monotonic)
        except Exception:
            self.newest = None
            raise
        self.seed += 1
        return self.newest

    def _predict(self, now: float, monotonic: float) -> LivePrediction:
        inputs, settings = self.inputs, self.settings
        _, seen = inputs.perceived()
        check_fresh(seen, settings, now, monotonic)
        samples = self._samples(self._prepare(inputs.scene, inputs.learned))
        start = max(now, seen.stamp) if settings.carry_forward else seen.stamp
        return predict_prepared(
            samples.prepared,
            samples.worlds,
            settings,
            learned=inputs.learned,
            times=settings.times,
            start=start,
            states_stamp=seen.stamp,
            seed=samples.seed,
            environment_version=inputs.environment_version,
        )

    def _samples(self, prepared: PreparedScene) -> PrefetchedSamples:
        """Return samples of a scene; reuse the prefetched ones if they match."""
        settings, ready = self.settings, self._prefetched
        if (
            ready is not None
            and ready.prepared is prepared
            and ready.settings is settings
            and ready.seed == self.seed
        ):
            return ready
        worlds = settings.draw(prepared, settings.sample_count, np.random.default_rng(self.seed))
        return PrefetchedSamples(prepared, settings, self.seed, worlds)

    def _prepare(self, scene: Scene, learned: LearnedParameters | None) -> PreparedScene:
        """Return the scene prepared; the newest answer is reused while its inputs are the same."""
        made_from = (scene, learned, self.settings)
        if self._prepared is None or not _same(self._prepared[0], made_from):
            uncertain = self._parameters(learned, scene.materials)
            self._prepared = made_from, prepare(scene, uncertain, self.settings)
        return self._prepared[1]

    def _parameters(
        self, learned: LearnedParameters | None, materials: tuple[str, ...]
    ) -> UncertainParameters:
        """Return the distribution of θ_s; the newest answer is reused while it holds."""
        made_from = (learned, self.settings)
        if (
            self._uncertain is None
            or not _same(self._uncertain[0][:2], made_from)
            or self._uncertain[0][2] != materials
        ):
            uncertain = uncertain_parameters(learned, materials, self.settings)
            self._uncertain = (*made_from, materials), uncertain
        return self._uncertain[1]


def _same(made_from: tuple[Any, ...], wanted: tuple[Any, ...]) -> bool:
    """Whether two tuples hold the very same objects: equal ones are compared by nobody."""
    return all(a is b for a, b in zip(made_from, wanted, strict=True))
