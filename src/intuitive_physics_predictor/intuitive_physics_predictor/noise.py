"""Draws of θ_d: states and sizes, with the uncertainty of their perception."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.geometry.quaternions import (
    load_quaternion,
    store_quaternion,
    turned_by,
)
from intuitive_physics.geometry.vectors import add, load, store
from intuitive_physics.kernels import entry, inlined, kernel
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.prior_knowledge.initial_spins import EQUAL, unknown_spin
from intuitive_physics.scene import SceneObject
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ROTATION,
    ObjectState,
)
from intuitive_physics.validation import non_negative_float

LEARNED = "learned"
"""A spin that is a guess has the spread with which balls of its material are thrown here, where
that was learned, else as perceived."""

PERCEIVED = "perceived"
"""A spin that is a guess has the covariance it was perceived with."""

FIXED = "fixed"
"""A spin that is a guess has the fixed noise alone."""

SPIN_PRIORS = (LEARNED, PERCEIVED, FIXED)
"""Priors of a spin that perception could not see."""


@dataclass(frozen=True)
class StateNoise:
    """Noise that is added to a perceived state (Sec. III-E).

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
    spin_prior : of spins that are a guess, one of `SPIN_PRIORS`
    guess_scale : factor on the standard deviations of that prior
    """

    perceived: bool = True
    position: float = 0.0
    rotation: float = 0.0
    linear_velocity: float = 0.0
    angular_velocity: float = 0.0
    scale: float = 1.0
    spin_scale: float = 1.0
    spin_prior: str = LEARNED
    guess_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.spin_prior not in SPIN_PRIORS:
            raise UnknownNameError(
                f"spin prior is {self.spin_prior!r}; expected one of {', '.join(SPIN_PRIORS)}"
            )
        for name in ("position", "rotation", "linear_velocity", "angular_velocity"):
            non_negative_float(getattr(self, name), f"{name} noise")
        for name in ("scale", "spin_scale", "guess_scale"):
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


def with_spin_prior(
    state: ObjectState,
    scene_object: SceneObject,
    learned: LearnedParameters | None,
    spin_prior: str = LEARNED,
    scale: float = 1.0,
) -> ObjectState:
    """Return a state whose spin, where it is a guess, has the prior that was asked for.

    `learned` has θ_s and how balls are thrown; None: nothing was learned. `scale` is a factor on
    the standard deviations of the prior, one of `SPIN_PRIORS`.
    """
    guess = unknown_spin(scene_object.shape, state)
    if guess is None:
        return state
    deviation = guess
    if spin_prior == FIXED:
        deviation = 0.0
    elif spin_prior == LEARNED:
        deviation = _learned_deviation(guess, learned, scene_object.material)
    covariance = state.covariance.copy()
    covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = (scale * deviation) ** 2 * np.eye(3)
    return state.with_covariance(covariance)


def _learned_deviation(guess: float, learned: LearnedParameters | None, material: str) -> float:
    """Spread of initial spins, rad/s: as learned, in place of the guess that it was learned of."""
    spread = None if learned is None else learned.initial_spins.by_material.get(material)
    # A ball that is seen to be at rest has a spin of about zero too, and is surer of it.
    if spread is None or guess < spread.stated * (1.0 - EQUAL):
        return guess
    return spread.deviation


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
        return self.at(rng.standard_normal((count, len(self.means), ERROR_SIZE)))

    def at(self, normal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the states (count, n_objects, 13) at normal (count, n_objects, 12) deviates."""
        drawn = np.empty((len(normal), *self.means.shape))
        _add_errors(self.means, self.roots, normal, drawn)
        return drawn


def draw_sizes(
    shape: tuple[int, int], deviation: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw factors (count, n_objects) on the dimensions, log-normal, so that none is below zero.

    `shape` is that of the result, `deviation` the relative standard deviation of a dimension.
    """
    return np.exp(non_negative_float(deviation, "size noise") * rng.standard_normal(shape))


@entry
def _add_errors(means: Any, roots: Any, normal: Any, states: Any) -> None:
    """Write states (count, n_objects, 13): the mean ones, and on them R times what is normal."""
    for s in range(states.shape[0]):
        for k in range(states.shape[1]):
            add_error(means[k], roots[k], normal[s, k], states[s, k])


@kernel
def add_error(mean: Any, root: Any, normal: Any, state: Any) -> None:
    """Write a state (13,): the mean one, and on it R times what is normal (12,)."""
    store(state[0:3], add(load(mean[0:3]), _error(root, normal, POSITION.start)))
    turn = _error(root, normal, ROTATION.start)
    store_quaternion(state[3:7], turned_by(load_quaternion(mean[3:7]), turn))
    store(state[7:10], add(load(mean[7:10]), _error(root, normal, LINEAR_VELOCITY.start)))
    store(state[10:13], add(load(mean[10:13]), _error(root, normal, ANGULAR_VELOCITY.start)))


@inlined
def _error(root: Any, normal: Any, first: Any) -> Any:
    """Three elements of R n, from the one numbered `first` on."""
    x = y = z = 0.0
    for j in range(normal.size):
        x += root[first, j] * normal[j]
        y += root[first + 1, j] * normal[j]
        z += root[first + 2, j] * normal[j]
    return x, y, z
