"""Initial states from the first points of an observation that nothing can have touched yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment
from intuitive_physics.state import ANGULAR_VELOCITY, ROTATION, ObjectState
from intuitive_physics_experiments.paper.noisy_flight import (
    FEWEST_POINTS,
    fit_noisy_flight,
    flight_length,
)

MARGIN = 3.0
"""Standard deviations of a point by which an object may be nearer to something than it seems."""


def with_first_points(observation: Observation, points: int, noise: float) -> Observation:
    """Return an observation whose initial states are fitted to its first points."""
    states = initial_states(observation, points, noise)
    return replace(
        observation,
        objects=tuple(
            ObservedObject(seen.object, seen.trajectory, state)
            for seen, state in zip(observation.objects, states, strict=True)
        ),
    )


def initial_states(observation: Observation, points: int, noise: float) -> list[ObjectState]:
    """Fit free flight to each object's first points; orientation and spin are as observed.

    A point no longer counts, at the latest, where the object's bounding sphere has come near a
    plane or another object's: a gentle touch bends a path by less than noise, and points after it
    would be taken for flight. The first three always count.

    Parameters
    ----------
    observation : all its objects seen first at its start
    points : at most so many of each object, at least 3
    noise : m, standard deviation of a point on each axis
    """
    gravity = observation.environment.gravity
    states = []
    for seen in observation.objects:
        near = _near_something(seen, observation.objects, observation.environment, points, noise)
        free = max(int(near.argmax()) if near.any() else len(near), FEWEST_POINTS)
        times, positions = seen.trajectory.times[:free], seen.trajectory.positions[:free]
        count = flight_length(times, positions, gravity, noise)
        position, velocity, covariance = fit_noisy_flight(
            times[:count], positions[:count], gravity, noise
        )
        known = seen.initial_state
        for part in (ROTATION, ANGULAR_VELOCITY):
            covariance[part, part] = known.covariance[part, part]
        states.append(
            ObjectState(position, known.orientation, velocity, known.angular_velocity, covariance)
        )
    return states


def _near_something(
    seen: ObservedObject,
    objects: Sequence[ObservedObject],
    environment: Environment,
    points: int,
    noise: float,
) -> NDArray[np.bool_]:
    """Whether an object may touch a plane or another object at each of its first points."""
    times, positions = seen.trajectory.times[:points], seen.trajectory.positions[:points]
    radius = seen.object.shape.bounding_radius
    near = np.zeros(len(times), dtype=bool)
    for plane in environment.planes:
        near |= plane.signed_distances(positions) < radius + MARGIN * noise
    for other in objects:
        if other is not seen:
            track = other.trajectory
            there = np.column_stack([np.interp(times, track.times, x) for x in track.positions.T])
            reach = radius + other.object.shape.bounding_radius + MARGIN * np.sqrt(2.0) * noise
            near |= np.linalg.norm(positions - there, axis=1) < reach
    return near
