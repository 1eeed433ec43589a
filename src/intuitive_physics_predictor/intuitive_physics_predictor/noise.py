"""Draws of θ_d: states, and sizes, that are as uncertain as they were perceived."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ROTATION,
    ObjectState,
)
from intuitive_physics.validation import non_negative_float


@dataclass(frozen=True)
class StateNoise:
    """What is added to a perceived state (Sec. III-E).

    The noise has the covariance the state was perceived with, its standard deviations scaled, plus
    fixed Gaussian noise of the standard deviations below on each axis; the paper's setting is fixed
    noise alone.

    Parameters
    ----------
    perceived : whether the perceived covariance counts
    position : m
    rotation : rad
    linear_velocity : m/s
    angular_velocity : rad/s
    scale : factor on the perceived standard deviations of pose and linear velocity
    spin_scale : factor on those of the angular velocity, which is often a guess
    """

    perceived: bool = True
    position: float = 0.0
    rotation: float = 0.0
    linear_velocity: float = 0.0
    angular_velocity: float = 0.0
    scale: float = 1.0
    spin_scale: float = 1.0

    def __post_init__(self) -> None:
        for name in ("position", "rotation", "linear_velocity", "angular_velocity"):
            non_negative_float(getattr(self, name), f"{name} noise")
        for name in ("scale", "spin_scale"):
            non_negative_float(getattr(self, name), f"{name} of perceived noise")

    def covariance(self, state: ObjectState) -> NDArray[np.float64]:
        """Return the covariance of the noise on one state, shape (12, 12)."""
        variances = np.empty(ERROR_SIZE)
        variances[POSITION] = self.position**2
        variances[ROTATION] = self.rotation**2
        variances[LINEAR_VELOCITY] = self.linear_velocity**2
        variances[ANGULAR_VELOCITY] = self.angular_velocity**2
        fixed = np.diag(variances)
        if not self.perceived:
            return fixed
        factors = np.full(ERROR_SIZE, self.scale)
        factors[ANGULAR_VELOCITY] = self.spin_scale
        return fixed + factors[:, None] * state.covariance * factors


@dataclass(frozen=True, eq=False)
class StateSpread:
    """Normal distribution of the states of all objects of a scene.

    Parameters
    ----------
    means : (n_objects, 13) as `ObjectState.to_vector`
    roots : (n_objects, 12, 12) of the covariances: R Rᵀ = Σ. Objects are independent.
    """

    means: NDArray[np.float64]
    roots: NDArray[np.float64]

    @staticmethod
    def of(states: Sequence[ObjectState], noise: StateNoise) -> StateSpread:
        """Return that of perceived states with noise on them."""
        variances, axes = np.linalg.eigh(np.array([noise.covariance(state) for state in states]))
        roots = axes * np.sqrt(np.maximum(variances, 0.0))[:, None, :]
        return StateSpread(np.array([state.to_vector() for state in states]), roots)

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw states (count, n_objects, 13)."""
        normal = rng.standard_normal((count, len(self.means), ERROR_SIZE))
        errors = np.einsum("oij,soj->soi", self.roots, normal)
        drawn = np.repeat(self.means[None], count, axis=0)
        drawn[..., 0:3] += errors[..., POSITION]
        drawn[..., 3:7] = _turned(drawn[..., 3:7], errors[..., ROTATION])
        drawn[..., 7:10] += errors[..., LINEAR_VELOCITY]
        drawn[..., 10:13] += errors[..., ANGULAR_VELOCITY]
        return drawn


def draw_sizes(
    shape: tuple[int, int], deviation: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw factors on the dimensions of objects, log-normal, so that none is below zero.

    Parameters
    ----------
    shape : (count, n_objects)
    deviation : relative standard deviation of a dimension
    """
    return np.exp(non_negative_float(deviation, "size noise") * rng.standard_normal(shape))


def _turned(quaternions: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn (…, 4) quaternions by (…, 3) rotation vectors in the environment's axes."""
    half = 0.5 * np.sqrt((angles * angles).sum(axis=-1))
    # sin(x) / x without dividing by zero
    x, y, z = np.moveaxis(0.5 * np.sinc(half / np.pi)[..., None] * angles, -1, 0)
    w = np.cos(half)
    a, b, c, d = np.moveaxis(quaternions, -1, 0)
    turned = np.empty_like(quaternions)
    turned[..., 0] = w * a + d * x + (y * c - z * b)
    turned[..., 1] = w * b + d * y + (z * a - x * c)
    turned[..., 2] = w * c + d * z + (x * b - y * a)
    turned[..., 3] = w * d - (x * a + y * b + z * c)
    turned /= np.sqrt((turned * turned).sum(axis=-1, keepdims=True))
    return turned
