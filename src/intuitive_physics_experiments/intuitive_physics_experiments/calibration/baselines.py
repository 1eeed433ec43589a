"""Ways to predict that ours must beat: with less of what is uncertain, or with less physics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_cli.evaluation.free_flight import free_flight
from intuitive_physics_predictor.noise import StateNoise, StateSpread
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.scores.noise_fit import spread_weights, weighted_energy_scores
from intuitive_physics_predictor.scores.outcomes import Outcome, Prediction

FIXED_NOISE = 0.02
"""m, rad, m/s and rad/s. The paper has one noise model, N(0, 0.02); it does not say what it adds to
each part of θ_d."""

LARGEST_FIXED_NOISE = 10.0


def fixed_noise(
    learned: LearnedParameters, deviation: float, sample_count: int, simulator: Simulator
) -> Prediction:
    """Return the paper's noisy Newton: Gaussian noise of one size on θ_d, θ_s as learned."""
    noise = StateNoise(False, deviation, deviation, deviation, deviation)

    def sample(outcome: Outcome, rng: np.random.Generator) -> NDArray[np.float64]:
        return predict(
            outcome.scene,
            learned.parameters.extended(outcome.scene.materials),
            outcome.times,
            rng=rng,
            sample_count=sample_count,
            noise=noise,
            simulator=simulator,
        ).positions

    return sample


def fitted_fixed_noise(
    outcomes: Sequence[Outcome],
    learned: LearnedParameters,
    sample_count: int,
    simulator: Simulator,
    seed: int,
    evaluations: int = 15,
) -> float:
    """Return the fixed noise whose predictions of `outcomes` have the best energy score."""

    def way(deviation: float) -> Prediction:
        return fixed_noise(learned, deviation, sample_count, simulator)

    weights = spread_weights(outcomes, way(FIXED_NOISE), seed)
    reference = weighted_energy_scores(outcomes, way(FIXED_NOISE), weights, seed)

    def relative_score(logarithm: float) -> float:
        scores = weighted_energy_scores(outcomes, way(np.exp(logarithm)), weights, seed)
        return float(np.nanmean(scores / reference))

    found = minimize_scalar(
        relative_score,
        bounds=(np.log(0.1 * FIXED_NOISE), np.log(LARGEST_FIXED_NOISE)),
        method="bounded",
        options={"maxiter": evaluations},
    )
    return float(np.exp(found.x))


def single_rollout(learned: LearnedParameters, simulator: Simulator) -> Prediction:
    """Return one simulation from the states as perceived, with θ_s as learned."""
    return fixed_noise(learned, 0.0, 1, simulator)


def free_flights(sample_count: int) -> Prediction:
    """Return flights from noisy states, as uncertain as perceived, to the first plane they reach.

    Nothing of θ_s is used; objects count as their bounding spheres.
    """

    def sample(outcome: Outcome, rng: np.random.Generator) -> NDArray[np.float64]:
        scene = outcome.scene
        states = StateSpread.of(scene.states, StateNoise()).draw(sample_count, rng)
        return np.array(
            [
                [
                    free_flight(
                        scene.environment,
                        thing.shape.bounding_radius,
                        ObjectState.from_vector(state),
                        outcome.times,
                    )
                    for thing, state in zip(scene.objects, world, strict=True)
                ]
                for world in states
            ]
        )

    return sample
