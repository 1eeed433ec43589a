"""All options of live prediction in one place: the library's and the node's parameters."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import choice, number, other
from intuitive_physics.simulation import ENGINE_GUIDE, SIMULATORS
from intuitive_physics.simulation.contact_noise import LARGEST_TILT, ContactNoise
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales
from intuitive_physics_predictor.noisy_newton import DEFAULT_SAMPLE_COUNT


@dataclass(frozen=True)
class PredictionOptions:
    """How to predict. Every field says its meaning, unit and range in its metadata."""

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
