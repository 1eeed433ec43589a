"""Predict a thrown ball: where it is after 5 s, and whether it falls below 10 cm."""

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.queries.events import falls_below

floor = Environment([Plane("floor", "wood", normal=(0, 0, 1), offset=0.0)])
ball = SceneObject("ball", "rubber", Sphere(radius=0.05))
state = ObjectState(position=(0, 0, 1.0), linear_velocity=(2.0, 0, 0))
theta = StaticParameters.uniform(["rubber", "wood"], restitution=0.8)

future = predict(
    Scene(floor, (ball,), (state,)),
    theta,
    times=np.arange(0, 5, 0.01),
    rng=np.random.default_rng(0),
    noise=StateNoise(linear_velocity=0.1),
    sample_count=200,
)
print(future.mean[0, -1], future.covariance[0, -1])
print(falls_below(future, "ball", 0.1, floor.gravity).probability)
