"""The input of the predictor: throws through the paper's room, seen 30 times a second."""

from __future__ import annotations

import time

import numpy as np
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage

from benchmarks.running_nodes import RATE
from benchmarks.scenes import POSITION_NOISE, VELOCITY_NOISE, Instance, thrown
from benchmarks.scenes import SCENES as ALL_SCENES
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import parameter_names
from intuitive_physics.observation import Detections
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import make_simulator, pack_worlds
from intuitive_physics.state import ObjectState
from intuitive_physics_ros.conversions import (
    environment_to_message,
    object_states_to_message,
    stamp_from_seconds,
    static_parameters_to_message,
)
from intuitive_physics_ros.qos import LATCHED, SENSOR_DATA
from intuitive_physics_ros.scripting import Peer
from intuitive_physics_ros.topics import ENVIRONMENT, OBJECT_STATES, STATIC_PARAMETERS

# Shapes that are thrown in each scene
SCENES = {name: ALL_SCENES[name] for name in ("1_sphere", "3_spheres", "3_mixed")}
# The same balls as they move, detected in every frame: the node estimates their states
SEEN = {f"{name}_seen": name for name in ("1_sphere", "3_spheres")}
# Random throws that take turns, each for a second; from each the whole flight lies ahead
THROWS = 8
FRAMES = int(RATE)  # of a throw, for as long as it has its turn
# m and rad/s, standard deviations of each coordinate of a detection, and of a spin not seen
DETECTED, UNKNOWN_SPIN = 0.002, 10.0
# rad and rad/s, standard deviations of orientation and angular velocity
TURN_NOISE, SPIN_NOISE = 0.05, 0.5
RELATIVE_DEVIATION = 0.1  # of learned static parameters
SEED = 3  # of the throws


class Feed:
    """Publishes environment, static parameters and states."""

    def __init__(self, scene: str) -> None:
        rng = np.random.default_rng(SEED)
        self._throws = [thrown(SCENES[SEEN.get(scene, scene)], rng) for _ in range(THROWS)]
        # Made once: the input should cost the machine little beside the node.
        self._messages = [
            _seen_messages(throw, rng) if scene in SEEN else [_states_message(throw.scene)]
            for throw in self._throws
        ]
        self._begun = time.monotonic()

    def start(self, peer: Peer) -> None:
        """Publish environment and static parameters, which the node keeps."""
        first = self._throws[0]
        environment = peer.publisher(EnvironmentMessage, ENVIRONMENT, LATCHED)
        environment.publish(environment_to_message(first.scene.environment, version=1))
        parameters = peer.publisher(StaticParametersMessage, STATIC_PARAMETERS, LATCHED)
        parameters.publish(static_parameters_to_message(self.learned()))
        self._states = peer.publisher(ObjectStates, OBJECT_STATES, SENSOR_DATA)

    def learned(self) -> LearnedParameters:
        """Return θ_s of the first throw, as if it had been learned."""
        parameters = self._throws[0].static_parameters
        size = len(parameter_names(parameters.materials))
        deviations = np.full(size, RELATIVE_DEVIATION * 0.5)
        deviations[: len(parameters.materials)] = RELATIVE_DEVIATION * parameters.density
        known = np.ones(size, dtype=bool)
        return LearnedParameters(parameters, deviations, known, 1, 0.01, 10, "cma_es")

    def publish(self) -> None:
        """Publish the states of a throw with the stamp of this moment."""
        passed = time.monotonic() - self._begun
        turn = self._messages[int(passed) % THROWS]
        message = turn[int(passed % 1.0 * len(turn))]
        message.header.stamp = stamp_from_seconds(time.time())
        self._states.publish(message)


def _seen_messages(throw: Instance, rng: np.random.Generator) -> list[ObjectStates]:
    """Messages of a throw of spheres as it goes on, frame by frame, with detections."""
    times = np.arange(FRAMES) / RATE
    apart = 1e-4
    world = pack_worlds([throw.scene], throw.static_parameters)
    rollout = make_simulator("auto").rollout_batch(
        world, np.sort([*times, *(times + apart)]), orientations=False
    )
    places = rollout.positions[0].reshape(-1, FRAMES, 2, 3)
    deviations = np.repeat([POSITION_NOISE, 0.0, VELOCITY_NOISE, UNKNOWN_SPIN], 3)
    covariance = np.diag(deviations**2)
    spread = np.array([DETECTED**2 * np.eye(3)])
    messages = []
    for frame in range(FRAMES):
        here, there = places[:, frame, 0], places[:, frame, 1]
        states = [
            ObjectState(place, linear_velocity=velocity, covariance=covariance)
            for place, velocity in zip(here, (there - here) / apart, strict=True)
        ]
        detections = [
            Detections([0.0], [place + rng.normal(0.0, DETECTED, 3)], spread, np.zeros((3, 3)))
            for place in here
        ]
        messages.append(
            object_states_to_message(
                throw.scene.objects,
                states,
                frame_id=throw.scene.environment.frame_id,
                detections=detections,
            )
        )
    return messages


def _states_message(scene: Scene) -> ObjectStates:
    deviations = [POSITION_NOISE, TURN_NOISE, VELOCITY_NOISE, SPIN_NOISE]
    covariance = np.diag(np.repeat(np.square(deviations), 3))
    states = [state.with_covariance(covariance) for state in scene.states]
    frame_id = scene.environment.frame_id
    return object_states_to_message(scene.objects, states, frame_id=frame_id)
