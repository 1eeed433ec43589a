"""The engine behind the rendered bags obeys the laws it stands for.

Tolerances: an impact is found one step (1/4800 s) late, which lengthens the fall by at most
g · step in speed and v · step in place; everything else is exact.
"""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment, Plane
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.rendering.corner_room import corner_environment
from intuitive_physics_experiments.rendering.thrown_ball import STEP, BallContact, move_ball

G = 9.81
R = 0.05
FLOOR = Environment([Plane("floor", "room", (0, 0, 1), 0.0)])


def test_free_fall_is_a_parabola() -> None:
    # x(t) = x0 + v0 t - g t² / 2; semi-implicit Euler is g · step · t / 2 off.
    start = ObjectState((0.0, 0.0, 5.0), linear_velocity=(1.0, -2.0, 3.0))
    motion = move_ball(FLOOR, R, 500.0, BallContact(0.5, 0.01, 0.5), start, 0.8)
    t = motion.times[:, None]
    expected = start.position + t * start.linear_velocity - 0.5 * G * t**2 * [0.0, 0.0, 1.0]
    assert np.abs(motion.positions - expected).max() < 0.5 * G * STEP * 0.8 * 1.01


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9])
def test_bounce_heights_fall_by_the_square_of_restitution(restitution: float) -> None:
    # h_n = e^(2n) h
    height = 1.0
    start = ObjectState((0.0, 0.0, R + height))
    contact = BallContact(0.5, 0.0, restitution)
    motion = move_ball(FLOOR, R, 500.0, contact, start, 2.5, sample_rate=240)
    z = motion.positions[:, 2] - R
    peaks = [z[i] for i in range(1, len(z) - 1) if z[i - 1] < z[i] >= z[i + 1] and z[i] > 0.05]
    assert len(peaks) >= 1
    expected = height * restitution ** (2.0 * np.arange(1, len(peaks) + 1))
    assert peaks == pytest.approx(expected, rel=0.015)


@pytest.mark.parametrize(
    ("normal", "offset", "axis"), [((-1, 0, 0), -1.0, 0), ((0, -1, 0), -1.0, 1)]
)
def test_walls_return_restitution_times_the_speed(normal: tuple, offset: float, axis: int) -> None:
    # v' = -e v along the normal
    weightless = Environment([Plane("wall", "room", normal, offset)], gravity=(0.0, 0.0, 0.0))
    velocity = np.zeros(3)
    velocity[axis] = 2.0
    start = ObjectState((0.5, 0.5, 1.0), linear_velocity=velocity)
    motion = move_ball(weightless, R, 500.0, BallContact(0.0, 0.0, 0.7), start, 0.5)
    assert motion.velocities[-1] == pytest.approx(-0.7 * velocity, abs=1e-9)
    assert motion.positions[:, axis].max() <= 1.0 - R + 2.0 * STEP


@pytest.mark.parametrize("friction", [0.1, 0.8])
def test_oblique_impact_slides_or_grips(friction: float) -> None:
    # Sliding: Δv_t = μ (1 + e) v_n; gripping: v_t' = 5/7 v_t for a solid sphere without spin.
    weightless = Environment([Plane("floor", "room", (0, 0, 1), 0.0)], gravity=(0.0, 0.0, 0.0))
    start = ObjectState((0.0, 0.0, 0.5), linear_velocity=(2.0, 0.0, -2.0))
    motion = move_ball(weightless, R, 500.0, BallContact(friction, 0.0, 0.5), start, 0.5)
    tangential = max(2.0 - friction * 1.5 * 2.0, 5.0 / 7.0 * 2.0)
    assert motion.velocities[-1] == pytest.approx([tangential, 0.0, 1.0], abs=2e-3)


def test_sliding_turns_into_rolling_at_five_sevenths() -> None:
    start = ObjectState((0.0, 0.0, R), linear_velocity=(2.0, 1.0, 0.0))
    motion = move_ball(FLOOR, R, 500.0, BallContact(0.4, 0.0, 0.5), start, 1.0)
    assert motion.velocities[-1, :2] == pytest.approx([10.0 / 7.0, 5.0 / 7.0], rel=2e-3)


def test_rolling_friction_slows_by_five_sevenths_mu_r_g() -> None:
    # Torque μ_r r N about the contact point, inertia 7/5 m r²: a = 5/7 μ_r g, straight on.
    mu_r, v0 = 0.03, np.array([1.0, 0.5, 0.0])
    spin = np.cross([0.0, 0.0, 1.0], v0) / R
    start = ObjectState((0.0, 0.0, R), linear_velocity=v0, angular_velocity=spin)
    motion = move_ball(FLOOR, R, 500.0, BallContact(0.5, mu_r, 0.5), start, 1.0)
    speed = np.linalg.norm(motion.velocities, axis=1)
    assert (speed[12] - speed[-1]) / (motion.times[-1] - motion.times[12]) == pytest.approx(
        5.0 / 7.0 * mu_r * G, rel=0.01
    )
    assert motion.velocities[-1] / speed[-1] == pytest.approx(v0 / np.linalg.norm(v0), abs=5e-3)


def test_same_start_same_motion() -> None:
    start = ObjectState((0.2, 0.1, 0.8), linear_velocity=(1.5, 1.0, 1.0))
    contact = BallContact(0.4, 0.01, 0.7)
    a, b = (move_ball(corner_environment(), R, 500.0, contact, start, 1.0) for _ in range(2))
    assert np.array_equal(a.positions, b.positions)


def test_a_rate_that_does_not_divide_the_step_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="divisor of 4800"):
        move_ball(FLOOR, R, 500.0, BallContact(0.4, 0.01, 0.7), ObjectState((0, 0, 1)), 1.0, 70)
