"""The motion of a sensor that fits a frame to landmarks best, and whether it can be relied on.

Point-to-plane distances [Chen and Medioni 1992] of readings that are found by projection into the
frame [Rusinkiewicz and Levoy 2001] are made smallest by Gauss–Newton steps with robust weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.geometry.rotations import rotate_quaternions
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.standing import VIEW_DISTANCE
from intuitive_physics_perception.sensor_motion.comparison import Comparison, compare
from intuitive_physics_perception.sensor_motion.landmarks import Landmarks

GATES = (0.1, 0.05, 0.025)
"""m, residuals that count in the first steps: from where the last frame was seen from, what is seen
has moved by up to that. The steps after them go by the noise."""

STEPS = 10
"""Steps at most: numerical."""

CONVERGED = 0.3
"""Standard deviations by which the last step still moves: each one leaves a third of the error."""

LARGEST_MOTION = 0.1
"""m from one frame to the next, with a turn as the shift of what is 2 m away: the range of the
gates. At 30 Hz 3 m/s or 86 °/s."""

SURE = 2.0
"""Standard deviations within which the error of a motion is hidden by the noise of a reading at
`VIEW_DISTANCE`, if the scene determines the motion."""

LEAST_AGREEING = 60
"""Landmarks that a fit needs. Set by hand."""

LARGEST_SCALE = 2.0
"""Median residual of a fit in those of the frames that were modelled: with a larger one it is
another scene. Set by hand."""


def fit_motion(
    points: NDArray[np.float32],
    landmarks: Landmarks,
    start: RigidTransform,
    noise: RangeNoise,
    scale: float,
    least_share: float,
) -> tuple[Comparison, str]:
    """Fit the pose of a sensor to a frame; return the frame compared from there, and why that
    cannot be relied on, a part of a sentence, empty where nothing speaks against it.

    `points` (height, width, 3) m, NaN where nothing was read; `start`: the way in the last frame;
    `scale`: of the residuals in standard deviations, where nothing has moved; `least_share`: part
    of what is seen of the landmarks that has to be where it was.
    """
    way = start
    for k in range(STEPS):
        gate = GATES[k] if k < len(GATES) else 0.0
        compared = compare(points, landmarks, way, noise, scale, gate)
        step, information = compared.step(), compared.determined()
        step = _held(step, information, noise)
        way = _moved(way, step)
        if gate == 0.0 and step @ information @ step < CONVERGED**2:
            break
    compared = compare(points, landmarks, way, noise, scale)
    return compared, _doubt(compared, start, scale, least_share)


def _moved(way: RigidTransform, step: NDArray[np.float64]) -> RigidTransform:
    """Way after a motion (6,) of the sensor as of `Comparison`."""
    turn = step[3:] / VIEW_DISTANCE
    return RigidTransform(way.translation + step[:3], rotate_quaternions(way.orientation, turn))


def _held(
    step: NDArray[np.float64], information: NDArray[np.float64], noise: RangeNoise
) -> NDArray[np.float64]:
    """Step (6,) m without what the information does not determine: nothing moves there."""
    loose = undetermined(information, noise)
    return step - loose.T @ (loose @ step)


def undetermined(information: NDArray[np.float64], noise: RangeNoise) -> NDArray[np.float64]:
    """Return the directions (k, 6), unit vectors, that information (6, 6) in 1/m² leaves open."""
    values, vectors = np.linalg.eigh(information)
    least = (SURE / noise.deviation(VIEW_DISTANCE)) ** 2
    return vectors[:, values < least].T


def motions_in_words(directions: NDArray[np.float64], axes: NDArray[np.float64]) -> str:
    """Return motions in words.

    `directions` (k, 6) of them; `axes` (3, 3): to the axes of the environment's frame.
    """
    words = []
    for motion in directions:
        shifts = np.linalg.norm(motion[:3]) >= np.linalg.norm(motion[3:])
        vector = axes @ (motion[:3] if shifts else motion[3:])
        vector /= np.linalg.norm(vector) * np.sign(vector[np.abs(vector).argmax()])
        named = ", ".join(f"{x:.2f}" for x in np.round(vector, 2) + 0.0)
        words.append(f"{'a shift along' if shifts else 'a turn about'} ({named})")
    return " or ".join(words)


def _doubt(compared: Comparison, start: RigidTransform, scale: float, least_share: float) -> str:
    """Why a fit cannot be relied on."""
    shift, angle = start.difference(compared.way)
    if compared.agreeing < LEAST_AGREEING:
        return "too little of what was modelled is in view"
    if compared.share < least_share:
        return f"{compared.share:.0%} of what is seen of it fits the environment as modelled"
    if compared.residual_scale > LARGEST_SCALE * scale:
        return f"residuals are {compared.residual_scale / scale:.1f} times what noise explains"
    if shift + VIEW_DISTANCE * angle > LARGEST_MOTION:
        return (
            f"it moved by {100.0 * shift:.0f} cm and {np.degrees(angle):.1f}° since the last frame"
        )
    return ""
