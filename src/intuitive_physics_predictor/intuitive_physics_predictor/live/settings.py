"""Settings of live prediction, frozen: the library's and the node's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import choice, number, other
from intuitive_physics.simulation import (
    ENGINE_GUIDE,
    SIMULATORS,
    Simulator,
    make_simulator,
)
from intuitive_physics.simulation.contact_noise import LARGEST_TILT, ContactNoise
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales
from intuitive_physics_predictor.noisy_newton import DEFAULT_SAMPLE_COUNT, PreparedScene

LARGEST_PREDICTION = 50_000_000
"""Numbers in one predicted distribution: 400 MB, and what takes some seconds."""


@dataclass(frozen=True)
class PredictionSettings:
    """How to predict. Every field has its meaning, unit and range in its metadata.

    Raises
    ------
    InvalidInputError
        When horizon, time step and number of samples do not go together.
    """

    horizon: float = number(5.0, 0.01, 60.0, "s predicted ahead")
    time_step: float = number(0.01, 0.001, 1.0, "s between predicted points")
    sample_count: int = number(DEFAULT_SAMPLE_COUNT, 1, 10_000, "simulations a prediction")
    simulator: str = choice("auto", tuple(SIMULATORS), f"engine. {ENGINE_GUIDE}")
    threads: int = number(2, 1, 64, "threads that simulate; the answer does not depend on it")
    stale_after: float = number(0.5, 0.01, 60.0, "s; older states are not predicted from")
    carry_forward: bool = other(
        True,
        "begin now, by the node's clock; false: at the states' stamp, which may be of another one",
    )
    use_perceived_covariance: bool = other(
        True, "samples have the covariance the states were perceived with; false: fixed noise only"
    )
    position_noise: float = number(0.0, 0.0, 10.0, "fixed noise, m, added to it")
    rotation_noise: float = number(0.0, 0.0, 3.2, "fixed noise, rad, added to it")
    velocity_noise: float = number(0.0, 0.0, 100.0, "fixed noise, m/s, added to it")
    spin_noise: float = number(0.0, 0.0, 1000.0, "fixed noise, rad/s, added to it")
    state_scale: float = number(
        1.0, 0.0, 1000.0, "factor on the perceived standard deviations of pose and velocity"
    )
    spin_scale: float = number(
        1.0, 0.0, 1000.0, "factor on the perceived standard deviations of the spin"
    )
    static_parameters_scale: float = number(
        1.0, 0.0, 1000.0, "factor on the standard deviations of learned static parameters"
    )
    unidentified_scale: float = number(
        1.0, 0.0, 1.0, "share of the way to its bounds that a parameter nobody could tell may go"
    )
    contact_scale: float = number(
        0.0, 0.0, 1000.0, "standard deviation of frictions and restitution about their pair's"
    )
    size_scale: float = number(
        0.0, 0.0, 1000.0, "relative standard deviation of the objects' dimensions"
    )
    impact_restitution_noise: float = number(
        0.0, 0.0, 1.0, "standard deviation of the restitution from one impact to the next"
    )
    impact_tilt_noise: float = number(
        0.0, 0.0, LARGEST_TILT, "rad, standard deviation of the surface's normal at an impact"
    )

    def __post_init__(self) -> None:
        check_size(self.sample_count, 1, self.times.size)

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """Predicted times, (n_times,) s from the start of a prediction."""
        return output_times(self.horizon, self.time_step)

    @cached_property
    def engine(self) -> Simulator:
        """The simulator of that name, which threads may share."""
        return make_simulator(self.simulator, self.threads)

    def draw(self, prepared: PreparedScene, count: int, rng: np.random.Generator) -> WorldBatch:
        """Return `count` samples of a scene, each with its own draw of all that is uncertain."""
        return prepared.sampled(count, rng, self.noise_scales.size, self.contact_noise)

    @property
    def noise_scales(self) -> NoiseScales:
        """Factors on what is uncertain."""
        return NoiseScales(**{name: getattr(self, f"{name}_scale") for name in NOISE_SCALES})

    @property
    def contact_noise(self) -> ContactNoise:
        """Noise at each impact; none by default."""
        return ContactNoise(self.impact_restitution_noise, self.impact_tilt_noise)

    @property
    def state_noise(self) -> StateNoise:
        """Noise on the states (Sec. III-E)."""
        return StateNoise(
            perceived=self.use_perceived_covariance,
            position=self.position_noise,
            rotation=self.rotation_noise,
            linear_velocity=self.velocity_noise,
            angular_velocity=self.spin_noise,
            scale=self.state_scale,
            spin_scale=self.spin_scale,
        )


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
