"""Settings of live prediction: the user's options, checked, and what follows from them."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import check_limit
from intuitive_physics.scene import Scene
from intuitive_physics.settings import check_settings, choice, number, other
from intuitive_physics.simulation import ENGINE_GUIDE, SIMULATORS, Simulator, make_simulator
from intuitive_physics.simulation.contact_noise import LARGEST_TILT, ContactNoise
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics.state import ERROR_SIZE
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates
from intuitive_physics_predictor.live.self_calibration import SelfCalibration
from intuitive_physics_predictor.noise import LEARNED, SPIN_PRIORS, StateNoise
from intuitive_physics_predictor.noise_scales import NOISE_SCALES, NoiseScales
from intuitive_physics_predictor.noisy_newton import (
    DEFAULT_SAMPLE_COUNT,
    PreparedScene,
    predict_sampled,
)
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters


@dataclass(frozen=True)
class PredictionOptions:
    """Options of a prediction; the metadata of each field has its meaning, unit and range."""

    horizon: float = number(5.0, 0.01, 60.0, "s predicted ahead")
    time_step: float = number(0.01, 0.001, 1.0, "s between predicted points")
    sample_count: int = number(DEFAULT_SAMPLE_COUNT, 1, 10_000, "simulations a prediction")
    longest_horizon: float = number(
        600.0, 0.01, 1e6, "s predicted ahead at most, whatever is asked"
    )
    largest_prediction: int = number(
        20_000_000,
        1000,
        1_000_000_000,
        "numbers of a prediction, or of the samples it is made from, at most; a million takes up "
        "to 30 MB",
    )
    simulator: str = choice("auto", tuple(SIMULATORS), f"engine. {ENGINE_GUIDE}")
    threads: int = number(2, 1, 64, "threads that simulate; the answer does not depend on it")
    stale_after: float = number(0.5, 0.01, 60.0, "s; older states are not predicted from")
    carry_forward: bool = other(
        True,
        "begin now, by the node's clock; false: at the states' stamp, which may be of another one",
    )
    estimate_states: bool = other(
        True,
        "begin where a sphere is by everything seen of it, through bounces; false: by the newest "
        "perceived state alone",
    )
    self_calibration: bool = other(
        True,
        "scale the states' standard deviations by how well earlier predictions met what was seen",
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
    spin_prior: str = choice(
        LEARNED,
        SPIN_PRIORS,
        "what a spin is drawn from that was not seen: the spread with which balls of its material "
        "are thrown here, as learned; the covariance it was perceived with; or spin_noise alone",
    )
    static_parameters_scale: float = number(
        1.0, 0.0, 1000.0, "factor on the standard deviations of learned static parameters"
    )
    unidentified_scale: float = number(
        1.0, 0.0, 1.0, "share of the way to its bounds that an unidentified parameter may go"
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
        check_settings(self)

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
            spin_prior=self.spin_prior,
        )


@dataclass(frozen=True, eq=False)
class PredictionSettings:
    """Options and what follows from them; immutable, so that threads may share them.

    Parameters
    ----------
    options : as the user gave them

    Attributes
    ----------
    times : (n_times,) s, output times of a prediction
    simulator : engine with its threads
    estimation_simulator : the same for estimating states: always the fastest that can, in the
        thread that asks, as batches are so small that another thread's start costs more than it
        brings

    Raises
    ------
    InvalidInputError
        When horizon, time step and sample count do not go together.
    """

    options: PredictionOptions
    times: NDArray[np.float64] = field(init=False)
    simulator: Simulator = field(init=False)
    estimation_simulator: Simulator = field(init=False)

    def __post_init__(self) -> None:
        options = self.options
        times = output_times(options.horizon, options.time_step)
        self._check_size(options.sample_count, 1, times.size)
        times.flags.writeable = False
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "simulator", make_simulator(options.simulator, options.threads))
        object.__setattr__(self, "estimation_simulator", make_simulator("auto"))

    def stopped_by(self, flag: StopFlag) -> PredictionSettings:
        """Return the same settings whose simulations end once the flag is set."""
        made = copy(self)
        for name in ("simulator", "estimation_simulator"):
            object.__setattr__(made, name, getattr(self, name).stopped_by(flag))
        return made

    def uncertain_parameters(
        self, learned: LearnedParameters | None, materials: tuple[str, ...]
    ) -> UncertainParameters:
        """Return the distribution of θ_s for the learned materials and these.

        Parameters of a material that was not learned may have any value. Too many materials
        (`limits`) are refused.
        """
        if learned is None:
            check_limit("most_materials", len(materials), "materials in the scene")
        parameters = learned or LearnedParameters.defaults(materials)
        union = tuple(dict.fromkeys((*parameters.materials, *materials)))
        check_limit("most_materials", len(union), "materials, learned and in the scene")
        return self.options.noise_scales.parameters(parameters.extended(union))

    def prepare(
        self,
        scene: Scene,
        parameters: UncertainParameters,
        estimates: tuple[WeightedStates | None, ...] = (),
        calibration: SelfCalibration | None = None,
    ) -> PreparedScene:
        """Prepare a scene to be sampled, with estimates of its objects as `PreparedScene` has them.

        The noise gets the factors of the calibration, where there is one.
        """
        return PreparedScene.of(scene, parameters, self.state_noise(calibration), estimates)

    def state_noise(self, calibration: SelfCalibration | None = None) -> StateNoise:
        """Return the noise on states, times the factors of a calibration, if those are used."""
        noise = self.options.state_noise
        if calibration is None or not self.options.self_calibration:
            return noise
        return calibration.applied_to(noise)

    def draw(self, prepared: PreparedScene, seed: int, sample_count: int) -> WorldBatch:
        """Draw samples; the same seed gives the same ones.

        Samples with more than `largest_prediction` numbers are refused.
        """
        objects, parameters = len(prepared.scene.objects), prepared.world.coefficients.size
        self._check_size(sample_count, objects, 1, parameters)
        options = self.options
        return prepared.sampled(
            sample_count,
            np.random.default_rng(seed),
            options.noise_scales.size,
            options.contact_noise,
        )

    def predict(
        self,
        prepared: PreparedScene,
        times: NDArray[np.float64],
        *,
        seed: int,
        sample_count: int,
        orientations: bool = False,
        drawn: WorldBatch | None = None,
    ) -> TrajectoryDistribution:
        """Predict a prepared scene at times (n_times,) s after the states.

        `drawn` are samples of `draw` with this scene, seed and count; default: they are drawn. A
        prediction with more than `largest_prediction` numbers is refused.
        """
        self._check_size(sample_count, len(prepared.scene.objects), times.size)
        worlds = self.draw(prepared, seed, sample_count) if drawn is None else drawn
        return predict_sampled(
            prepared.scene, worlds, times, simulator=self.simulator, orientations=orientations
        )

    def check_horizon(self, horizon: float) -> None:
        """Refuse a horizon (s) that is longer than the option `longest_horizon`."""
        if horizon > self.options.longest_horizon:
            raise InvalidInputError(
                f"a prediction of {horizon:g} s was asked for; expected at most "
                f"{self.options.longest_horizon:g} s: ask for less, or raise longest_horizon"
            )

    def _check_size(self, sample_count: int, objects: int, times: int, parameters: int = 0) -> None:
        """Refuse a prediction or samples with more numbers than `largest_prediction`."""
        # Of each object the 13 numbers of its state, and the 12 normal ones they are drawn from.
        drawn = objects * (2 * ERROR_SIZE + 1) + parameters
        largest = self.options.largest_prediction
        if sample_count * max(objects * times * 3, drawn) > largest:
            raise InvalidInputError(
                f"{sample_count} samples of {objects} objects at {times} times were asked for; "
                f"expected at most {largest:,} numbers: ask for fewer, or raise largest_prediction"
            )


def output_times(horizon: float, time_step: float) -> NDArray[np.float64]:
    """Return times (n_times,) from 0 to `horizon` (s) every `time_step` (s).

    InvalidInputError is raised when there would be more than a million, or one is not above zero.
    """
    if not (0.0 < time_step <= horizon < np.inf) or horizon / time_step > 1e6:
        raise InvalidInputError(
            f"horizon is {horizon} s and time step {time_step} s; expected "
            "0 < time step ≤ horizon, and at most a million times"
        )
    return time_step * np.arange(int(horizon / time_step + 1e-9) + 1, dtype=np.float64)
