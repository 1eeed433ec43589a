"""Jumps of position and velocity that points ask for."""

import numpy as np

from intuitive_physics_learner.segmented_estimation.jumps import (
    JUMP_DISPLACEMENT,
    JUMP_VELOCITY,
    asked_jump,
)


def test_jumps_are_the_ridge_regression_of_offsets():
    """With x = (a, b), (Aᵀ W A + P) x = Aᵀ W r for A = [1 t], P of the priors."""
    generator = np.random.default_rng(0)
    times = np.arange(6) / 30.0
    offsets = generator.normal(0.0, 0.01, (1, 2, 1, 6, 3))
    precisions, scales = np.full((1, 1, 6), 0.02**-2), np.array([[[1.0], [0.1]]])
    jump = asked_jump(offsets, times[None], precisions, scales)
    design = np.stack([np.ones(6), times], axis=1)
    for k, scale in enumerate((1.0, 0.1)):
        prior = np.diag([(scale * JUMP_DISPLACEMENT) ** -2, (scale * JUMP_VELOCITY) ** -2])
        information = design.T @ design * 0.02**-2 + prior
        x = np.linalg.solve(information, design.T @ offsets[0, k, 0] * 0.02**-2)
        np.testing.assert_allclose(jump.displacements[0, k, 0], x[0], atol=1e-12)
        np.testing.assert_allclose(jump.velocities[0, k, 0], x[1], atol=1e-12)
        np.testing.assert_allclose(jump.losses[0, k], 0.5 * np.sum(x * (prior @ x)), rtol=1e-9)
        np.testing.assert_allclose(jump.offsets[0, k, 0], offsets[0, k, 0] - design @ x, atol=1e-12)
