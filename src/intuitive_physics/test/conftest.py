"""Small scenes the tests share."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState

G = 9.81


class World:
    """Spheres of one material on a floor z = 0 (and walls), with coefficients by name."""

    gravity = G

    def __init__(self) -> None:
        self.simulator = make_simulator("event_driven")

    def scene(self, *balls, planes=((0, 0, 1, 0),), gravity=(0, 0, -G)) -> Scene:
        """Each ball: radius, then the arguments of `ObjectState`."""
        environment = Environment(
            [Plane(f"plane_{k}", "floor", p[:3], p[3]) for k, p in enumerate(planes)],
            gravity=gravity,
        )
        objects = [SceneObject(f"ball_{k}", "ball", Sphere(b[0])) for k, b in enumerate(balls)]
        return Scene(environment, tuple(objects), tuple(ObjectState(*b[1:]) for b in balls))

    def parameters(self, mu_s=0.5, mu_d=0.4, mu_r=0.0, e=0.5, between=None) -> StaticParameters:
        """θ_s with the same coefficients for all pairs; `between` changes those of two balls."""
        theta = StaticParameters.uniform(
            ["ball", "floor"],
            static_friction=mu_s,
            dynamic_friction=mu_d,
            rolling_friction=mu_r,
            restitution=e,
        )
        return theta.with_pair("ball", "ball", **(between or {}))

    def roll(self, scene, parameters, times, **options):
        rollout = self.simulator.rollout([scene], parameters, np.asarray(times), **options)
        assert rollout.status[0] == 0
        return rollout

    def path(self, scene, parameters, times) -> np.ndarray:
        """Positions, shape (n_objects, n_times, 3)."""
        return self.roll(scene, parameters, times).positions[0]


@pytest.fixture(scope="session")
def world() -> World:
    return World()
