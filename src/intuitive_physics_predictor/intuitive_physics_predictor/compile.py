"""Compile and load the kernels ahead of time, so that no prediction ever waits for them."""

from __future__ import annotations

import numpy as np

from intuitive_physics.kernels.warm_up import WarmUp
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Detections, SeenSpin
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.compile import warm_up as warm_up_simulation
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.estimation.object_estimate import SceneEstimate, Surroundings
from intuitive_physics_predictor.moments import weighted_moments
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noisy_newton import PreparedScene
from intuitive_physics_predictor.outside import objects_inside
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters


def warm_up() -> None:
    """Call once every kernel of a prediction."""
    warm_up_simulation()
    warm_up_samples()
    warm_up_estimates()


def warm_up_samples() -> None:
    """Compile the kernels that draw samples and take their moments, or load them."""
    weighted_moments(np.zeros((2, 1, 3)), np.full(2, 0.5))
    ball = SceneObject("ball", "any", Sphere(1.0))
    scene = Scene(Environment(), (ball,), (ObjectState((0.0, 0.0, 0.0)),))
    prepared = PreparedScene.of(scene, StaticParameters.uniform(["any"]), StateNoise())
    prepared.sampled(1, np.random.default_rng(0))
    objects_inside(prepared.world, prepared.spread.means)


def warm_up_estimates() -> None:
    """Follow a ball for two frames: its first estimate is as fast as those after it."""
    ball = SceneObject("ball", "any", Sphere(0.1))
    learned = LearnedParameters.defaults(("any",))
    surroundings = Surroundings(Environment(), UncertainParameters(learned), make_simulator("auto"))
    estimate = SceneEstimate(np.random.default_rng(0))
    for frame in range(2):
        state = ObjectState(
            (frame, 0.0, 0.0), linear_velocity=(1.0, 0.0, 0.0), covariance=np.eye(12)
        )
        spin = SeenSpin(np.zeros(3), np.eye(3), 0.0)
        detections = Detections([frame], state.position[None], np.eye(3)[None], np.eye(3), spin)
        for _ in estimate.updates(surroundings, [ball], [state], float(frame), [detections]):
            pass


WARM_UPS: tuple[WarmUp, ...] = (warm_up_samples, warm_up_estimates)
"""Functions that `intuitive_physics.kernels.warm_up` calls after those of the simulation."""
