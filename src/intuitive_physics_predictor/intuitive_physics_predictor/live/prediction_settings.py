"""Options of live prediction, checked, and what is made of them once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.live.options import PredictionOptions
from intuitive_physics_predictor.noisy_newton import PreparedScene, predict_sampled
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

LARGEST_PREDICTION = 50_000_000
"""Numbers in one predicted distribution: 400 MB, and what takes some seconds."""


@dataclass(frozen=True, eq=False)
class DrawnSamples:
    """Samples of a scene, and what they were drawn from.

    Parameters
    ----------
    seed : of the noise
    worlds : one a sample
    """

    prepared: PreparedScene
    seed: int
    worlds: WorldBatch


class PredictionSettings:
    """Options, and what is made of them once.

    Parameters
    ----------
    options : as the user gave them
    """

    def __init__(self, options: PredictionOptions) -> None:
        self.options = options
        self.times = output_times(options.horizon, options.time_step)
        check_size(options.sample_count, 1, self.times.size)
        self.noise = options.state_noise
        self.scales = options.noise_scales
        self.contact_noise = options.contact_noise
        self.simulator = make_simulator(options.simulator, options.threads)
        self._newest: tuple[LearnedParameters | None, tuple[str, ...], UncertainParameters] | None
        self._newest = None
        self._prepared: tuple[Scene, LearnedParameters | None, PreparedScene] | None = None
        self._ahead: DrawnSamples | None = None

    def parameters(
        self, learned: LearnedParameters | None, materials: tuple[str, ...]
    ) -> UncertainParameters:
        """Return the distribution of θ_s over what was learned and these materials.

        A material nobody has learned of may be anything. The newest answer is kept.
        """
        newest = self._newest
        if newest is None or newest[0] is not learned or newest[1] != materials:
            known = learned or LearnedParameters.defaults(materials)
            all_of_them = tuple(dict.fromkeys((*known.materials, *materials)))
            uncertain = self.scales.parameters(known.extended(all_of_them))
            self._newest = newest = (learned, materials, uncertain)
        return newest[2]

    def prepared(self, scene: Scene, learned: LearnedParameters | None) -> PreparedScene:
        """Prepare a scene to be predicted. The newest answer is kept.

        Raises
        ------
        InvalidInputError, UnknownNameError
            As `PreparedScene.of`.
        """
        newest = self._prepared
        if newest is None or newest[0] is not scene or newest[1] is not learned:
            uncertain = self.parameters(learned, scene.materials)
            made = PreparedScene.of(scene, uncertain, self.noise)
            self._prepared = newest = (scene, learned, made)
        return newest[2]

    def draw_ahead(self, scene: Scene, learned: LearnedParameters | None, seed: int) -> None:
        """Draw the samples that will be asked for next, as far as anyone knows, and keep them.

        What is drawn depends on no time, so it need not wait until a prediction is due.

        Raises
        ------
        InvalidInputError, UnknownNameError
            As `PreparedScene.of`.
        """
        self._ahead = self._drawn(self.prepared(scene, learned), seed, self.options.sample_count)

    def predict(
        self,
        scene: Scene,
        learned: LearnedParameters | None,
        times: NDArray[np.float64],
        *,
        seed: int,
        sample_count: int,
        orientations: bool = False,
    ) -> TrajectoryDistribution:
        """Predict a scene, as `noisy_newton.predict`; without θ_s its materials may be anything."""
        check_size(sample_count, len(scene.objects), times.size)
        samples = self._drawn(self.prepared(scene, learned), seed, sample_count)
        return predict_sampled(
            scene, samples.worlds, times, simulator=self.simulator, orientations=orientations
        )

    def _drawn(self, prepared: PreparedScene, seed: int, count: int) -> DrawnSamples:
        """Return so many samples of a scene, those drawn ahead if they are the ones."""
        ahead = self._ahead
        if ahead and (ahead.prepared, ahead.seed, ahead.worlds.size) == (prepared, seed, count):
            return ahead
        rng = np.random.default_rng(seed)
        worlds = prepared.sampled(count, rng, self.scales.size, self.contact_noise)
        return DrawnSamples(prepared, seed, worlds)


def output_times(horizon: float, time_step: float) -> NDArray[np.float64]:
    """Return times from 0 to `horizon` (s) every `time_step` (s), shape (n_times,).

    Raises
    ------
    InvalidInputError
        When one of them is not above zero or there would be more than a million times.
    """
    if not (0.0 < time_step <= horizon < np.inf) or horizon / time_step > 1e6:
        raise InvalidInputError(
            f"horizon is {horizon} s and time step {time_step} s; expected "
            "0 < time step ≤ horizon, and at most a million times"
        )
    return time_step * np.arange(int(horizon / time_step + 1e-9) + 1, dtype=np.float64)


def check_size(sample_count: int, objects: int, times: int) -> None:
    """Check that a prediction is not larger than can be answered.

    Raises
    ------
    InvalidInputError
        When it would have more than `LARGEST_PREDICTION` numbers.
    """
    if sample_count * objects * times * 3 > LARGEST_PREDICTION:
        raise InvalidInputError(
            f"{sample_count} samples of {objects} objects at {times} times were asked for; "
            f"expected at most {LARGEST_PREDICTION:,} numbers, ask for fewer"
        )
