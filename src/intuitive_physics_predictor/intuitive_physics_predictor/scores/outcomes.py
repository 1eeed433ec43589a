"""Outcomes of predicted scenes, to which noise is fitted and on which it is scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.noisy_newton import predict


@dataclass(frozen=True, eq=False)
class Outcome:
    """A scene as it was perceived, and the later positions of its objects.

    Parameters
    ----------
    scene : objects with perceived states and covariances
    times : (n_times,) s after the states, strictly increasing
    positions : (n_objects, n_times, 3) m, where the objects were; NaN where that is not known
    covariances : (n_objects, n_times, 3, 3) m², of the errors of `positions`; None: they are the
        truth
    """

    scene: Scene
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    covariances: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        expected = (len(self.scene.objects), len(self.times), 3)
        if self.positions.shape != expected:
            raise InvalidInputError(
                f"positions have the shape {self.positions.shape}; expected {expected}"
            )
        if self.covariances is not None and self.covariances.shape != (*expected, 3):
            raise InvalidInputError(
                f"covariances have the shape {self.covariances.shape}; expected {(*expected, 3)}"
            )

    def detected(
        self, samples: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the detections of objects at `samples`: with errors, where positions have some.

        Parameters
        ----------
        samples : (n_samples, n_objects, n_times, 3) m
        rng : of the errors, which are drawn from `covariances`, each independent of all others

        Returns
        -------
        (n_samples, n_objects, n_times, 3) m
        """
        if self.covariances is None:
            return samples
        variances, axes = np.linalg.eigh(self.covariances)
        roots = axes * np.sqrt(np.maximum(variances, 0.0))[..., None, :]
        errors = np.einsum("...ij,n...j->n...i", roots, rng.standard_normal(samples.shape))
        return np.asarray(samples + errors)


Prediction = Callable[[Outcome, np.random.Generator], NDArray[np.float64]]
"""Samples of an outcome's positions, (n_samples, n_objects, n_times, 3) m."""


def noisy_prediction(
    learned: LearnedParameters, scales: NoiseScales, sample_count: int, simulator: Simulator
) -> Prediction:
    """Return noisy Newton with all that is uncertain, as perceived, as learned and as scaled."""

    def sample(outcome: Outcome, rng: np.random.Generator) -> NDArray[np.float64]:
        return predict(
            outcome.scene,
            scales.parameters(learned, outcome.scene.materials),
            outcome.times,
            rng=rng,
            sample_count=sample_count,
            noise=scales.state_noise(),
            size_noise=scales.size,
            simulator=simulator,
        ).positions

    return sample


def predict_outcomes(
    outcomes: Sequence[Outcome], prediction: Prediction, seed: int
) -> Iterator[NDArray[np.float64]]:
    """Predict the detections: samples with errors like those of the positions.

    Each outcome has random numbers of its own, the same ones whatever predicts it, so that the
    scores of two predictions differ less by chance. They are those of no other outcome, and of no
    generator made of a seed alone.

    Yields
    ------
    (n_samples, n_objects, n_times, 3) m for each outcome
    """
    for number, outcome in enumerate(outcomes):
        samples, noise = outcome_generators(seed, number)
        yield outcome.detected(prediction(outcome, samples), noise)


def outcome_generators(seed: int, number: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Return the generators of one outcome, of its samples and of the noise on its detections.

    Their streams are children of the seed's. NumPy reads a list of numbers as one, in which zeros
    at the end do not count: `default_rng([0, 0])` is `default_rng(0)`.
    """
    streams = np.random.SeedSequence(seed, spawn_key=(number,)).spawn(2)
    samples, noise = (np.random.default_rng(stream) for stream in streams)
    return samples, noise
