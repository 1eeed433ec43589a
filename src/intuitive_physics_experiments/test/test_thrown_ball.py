"""The engine behind the rendered bags obeys the laws it stands for.

Tolerances: an impact is found one step (1/4800 s) late, which lengthens the fall by at most
g · step in speed and v · step in place; everything else is exact.
"""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.rendering.corner_room import corner_environment
from intuitive_physics_experiments.rendering.thrown_ball import (
    AS_BULLET_HAS_IT,
    CONTACT_LAWS,
    STEP,
    BallContact,
    Fidelity,
    move_ball,
)

G = 9.81
R = 0.05
FLOOR = Environment([Plane("floor", "room", (0, 0, 1), 0.0)])


def test_free_fall_is_a_parabola():
    # x(t) = x0 + v0 t - g t² / 2; semi-implicit Euler is g · step · t / 2 off.
    start = ObjectState((0.0, 0.0, 5.0), linear_velocity=(1.0, -2.0, 3.0))
    motion = move_ball(FLOOR, R, 500.0, BallContact(0.5, 0.01, 0.5), start, 0.8)
    t = motion.times[:, None]
    expected = start.position + t * start.linear_velocity - 0.5 * G * t**2 * [0.0, 0.0, 1.0]
    assert np.abs(motion.positions - expected).max() < 0.5 * G * STEP * 0.8 * 1.01


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9])
def test_bounce_heights_fall_by_the_square_of_restitution(restitution):
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


def dropped_restitution(restitution: float, speed: float, fidelity: Fidelity, drops: int) -> float:
    """Mean ratio of the speeds after and before an impact, from the heights before and after.

    The drops begin at heights that reach the surface at all phases of a step.
    """
    ratios = []
    for phase in np.arange(drops) / drops:
        height = 0.5 * speed**2 / G + phase * speed * fidelity.step
        start = ObjectState((0.0, 0.0, R + height))
        fall = float(np.sqrt(2.0 * height / G))
        duration = fall * (1.0 + restitution) + 0.01
        motion = move_ball(
            FLOOR, R, 500.0, BallContact(0.5, 0.0, restitution), start, duration, 480,
            fidelity=fidelity,
        )  # fmt: skip
        after = motion.times > fall + 0.005
        # Semi-implicit Euler lies on a parabola; its top is that of the motion.
        curve = np.polyfit(motion.times[after] - fall, motion.positions[after, 2] - R, 2)
        top = curve[2] - 0.25 * curve[1] ** 2 / curve[0]
        ratios.append(np.sqrt(top / height))
    return float(np.mean(ratios))


@pytest.mark.parametrize(
    ("restitution", "speed", "fidelity", "drops"),
    [
        (0.5, 1.5, AS_BULLET_HAS_IT, 24),
        (0.75, 1.5, AS_BULLET_HAS_IT, 24),
        (0.75, 3.0, AS_BULLET_HAS_IT, 24),
        (0.9, 3.0, AS_BULLET_HAS_IT, 24),
        (0.75, 1.5, CONTACT_LAWS, 8),
    ],
)
def test_restitution_seems_larger_by_what_a_step_of_gravity_adds(
    restitution, speed, fidelity, drops
):
    # (1 + 2 e - 1/e) g h / 2 u, to first order in g h / u.
    order = G * fidelity.step / speed
    expected = 0.5 * (1.0 + 2.0 * restitution - 1.0 / restitution) * order
    excess = dropped_restitution(restitution, speed, fidelity, drops) - restitution
    assert excess == pytest.approx(expected, abs=0.05 * order)


@pytest.mark.parametrize(
    ("normal", "offset", "axis"), [((-1, 0, 0), -1.0, 0), ((0, -1, 0), -1.0, 1)]
)
def test_walls_return_restitution_times_the_speed(normal, offset, axis):
    # v' = -e v along the normal
    weightless = Environment([Plane("wall", "room", normal, offset)], gravity=(0.0, 0.0, 0.0))
    velocity = np.zeros(3)
    velocity[axis] = 2.0
    start = ObjectState((0.5, 0.5, 1.0), linear_velocity=velocity)
    motion = move_ball(weightless, R, 500.0, BallContact(0.0, 0.0, 0.7), start, 0.5)
    assert motion.velocities[-1] == pytest.approx(-0.7 * velocity, abs=1e-9)
    assert motion.positions[:, axis].max() <= 1.0 - R + 2.0 * STEP


@pytest.mark.parametrize("friction", [0.1, 0.8])
def test_oblique_impact_slides_or_grips(friction):
    # Sliding: Δv_t = μ (1 + e) v_n; gripping: v_t' = 5/7 v_t for a solid sphere without spin.
    weightless = Environment([Plane("floor", "room", (0, 0, 1), 0.0)], gravity=(0.0, 0.0, 0.0))
    start = ObjectState((0.0, 0.0, 0.5), linear_velocity=(2.0, 0.0, -2.0))
    motion = move_ball(weightless, R, 500.0, BallContact(friction, 0.0, 0.5), start, 0.5)
    tangential = max(2.0 - friction * 1.5 * 2.0, 5.0 / 7.0 * 2.0)
    assert motion.velocities[-1] == pytest.approx([tangential, 0.0, 1.0], abs=2e-3)


def test_sliding_turns_into_rolling_at_five_sevenths():
    start = ObjectState((0.0, 0.0, R), linear_velocity=(2.0, 1.0, 0.0))
    motion = move_ball(FLOOR, R, 500.0, BallContact(0.4, 0.0, 0.5), start, 1.0)
    assert motion.velocities[-1, :2] == pytest.approx([10.0 / 7.0, 5.0 / 7.0], rel=2e-3)


def test_by_the_contact_laws_rolling_friction_does_not_act_on_what_slips():
    # Spin grows by 5/2 μ_d g / r until the ball rolls, at 5/7 of its speed, after 2/7 v / μ_d g. As
    # Bullet has it, it grows by 5/2 (μ_d - μ_r) g / r.
    mu, mu_r, speed = 0.4, 0.03, 2.0
    start = ObjectState((0.0, 0.0, R - 1e-6), linear_velocity=(speed, 0.0, 0.0))
    for fidelity, spun_by in ((CONTACT_LAWS, mu), (AS_BULLET_HAS_IT, mu - mu_r)):
        motion = move_ball(
            FLOOR, R, 500.0, BallContact(mu, mu_r, 0.5), start, 0.2, 480, fidelity=fidelity
        )
        slips = motion.times < 2.0 / 7.0 * speed / (mu * G) - 0.005
        times, spins = motion.times[slips], motion.angular_velocities[slips, 1]
        gain = (spins[-1] - spins[2]) / (times[-1] - times[2])
        assert gain == pytest.approx(2.5 * spun_by * G / R, rel=3e-3)
    motion = move_ball(
        FLOOR, R, 500.0, BallContact(mu, mu_r, 0.5), start, 0.4, 480, fidelity=CONTACT_LAWS
    )
    rolls = motion.times > 2.0 / 7.0 * speed / (mu * G)
    lost = 5.0 / 7.0 * mu_r * G * (motion.times[rolls] - 2.0 / 7.0 * speed / (mu * G))
    assert motion.velocities[rolls, 0] == pytest.approx(5.0 / 7.0 * speed - lost, rel=1e-3)


def test_by_the_contact_laws_a_spin_about_the_normal_runs_down():
    # Torque μ_r r m g, inertia 2/5 m r²: ω loses 5/2 μ_r g / r in a second.
    start = ObjectState((0.0, 0.0, R - 1e-6), angular_velocity=(0.0, 0.0, 10.0))
    contact = BallContact(0.5, 0.02, 0.5)
    motion = move_ball(FLOOR, R, 500.0, contact, start, 0.6, fidelity=CONTACT_LAWS)
    expected = 10.0 - 2.5 * 0.02 * G / R * motion.times
    assert motion.angular_velocities[:, 2] == pytest.approx(expected, abs=0.05)


def test_by_the_contact_laws_both_engines_move_a_ball_alike():
    # Thrown into the corner with spin: slipping and sticking impacts with floor and walls, and
    # rolling. Impacts are found a step late and 1e-4 of the speed is lost or won at each.
    mu, mu_r, e = 0.3, 0.02, 0.6
    start = ObjectState(
        (0.2, 0.1, 0.6), linear_velocity=(2.0, 1.2, 0.5), angular_velocity=(3.0, -8.0, 5.0)
    )
    room = corner_environment()
    motion = move_ball(room, R, 500.0, BallContact(mu, mu_r, e), start, 2.0, fidelity=CONTACT_LAWS)
    parameters = StaticParameters.uniform(("ball", "room")).with_pair(
        "ball",
        "room",
        static_friction=mu,
        dynamic_friction=mu,
        rolling_friction=mu_r,
        restitution=e,
    )
    scene = Scene(room, (SceneObject("ball", "ball", Sphere(R)),), (start,))
    rollout = make_simulator("event_driven").rollout([scene], parameters, motion.times[1:])
    apart = rollout.positions[0].reshape(-1, 3) - motion.positions[1:]
    assert np.abs(apart).max() < 1e-3


def test_rolling_friction_slows_by_five_sevenths_mu_r_g():
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


def test_same_start_same_motion():
    start = ObjectState((0.2, 0.1, 0.8), linear_velocity=(1.5, 1.0, 1.0))
    contact = BallContact(0.4, 0.01, 0.7)
    a, b = (move_ball(corner_environment(), R, 500.0, contact, start, 1.0) for _ in range(2))
    assert np.array_equal(a.positions, b.positions)


def test_a_rate_that_does_not_divide_the_step_is_refused():
    with pytest.raises(InvalidInputError, match="divisor of 4800"):
        move_ball(FLOOR, R, 500.0, BallContact(0.4, 0.01, 0.7), ObjectState((0, 0, 1)), 1.0, 70)
