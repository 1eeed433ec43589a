"""Pressed contacts converge to the laws of motion with the first order of the step.

Forces are held over a step h, so what is left is proportional to h: half of it for h / 2.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from intuitive_physics.shapes import Box, Capsule
from intuitive_physics.simulation.core.engines import SteppedSimulator

from .laws_scenes import Body, G, about_y, coefficients, make_scene

EDGE = 0.2
HALF_DIAGONAL = EDGE / np.sqrt(2)
FIRST_ANGLE = 0.1
RADIUS, LENGTH, FRICTION = 0.05, 0.3, 0.3
ROD = Capsule(radius=RADIUS, length=LENGTH)
DENSITY = 1000.0


def pose(body: Body, friction: float, t: float, step: float):
    """Position and rotation at the time t, simulated with a step."""
    simulator = SteppedSimulator(time_step=step)
    rollout = simulator.rollout([make_scene(body)], coefficients(friction), [t])
    assert rollout.status[0] == 0
    return rollout.positions[0, 0, 0], Rotation.from_quat(rollout.orientations[0, 0, 0])


def check_first_order(error, steps) -> None:
    """The error (n,) of each step is half of that with a step twice as long."""
    errors = [np.linalg.norm(error(step)) for step in steps]
    ratios = np.array(errors[1:]) / errors[:-1]
    np.testing.assert_allclose(ratios, 0.5, atol=0.06)


def angle_after(t: float, acceleration) -> float:
    """Angle of a cube on its edge from the vertical, from rest, by φ'' = acceleration(φ, φ')."""
    path = solve_ivp(
        lambda _, y: [y[1], acceleration(*y)], (0, t), [FIRST_ANGLE, 0], rtol=1e-11, atol=1e-13
    )
    return path.y[0, -1]


def tilted_cube() -> Body:
    place = HALF_DIAGONAL * np.array([np.sin(FIRST_ANGLE), 0.0, np.cos(FIRST_ANGLE)])
    return Body(Box((EDGE,) * 3), place, about_y(np.pi / 4 + FIRST_ANGLE))


def tilt(rotation: Rotation) -> float:
    return 2 * np.arctan2(*rotation.as_quat()[[1, 3]]) - np.pi / 4


def test_a_cube_that_falls_over_a_held_edge():
    # I φ'' = m g d sin φ about the edge, with I = 2/3 m a² and d = a / √2.
    expected = angle_after(0.2, lambda φ, _: G * HALF_DIAGONAL * np.sin(φ) / (2 / 3 * EDGE**2))
    check_first_order(
        lambda step: [tilt(pose(tilted_cube(), 5.0, 0.2, step)[1]) - expected],
        [4e-3, 2e-3, 1e-3, 5e-4],
    )


def test_a_cube_that_falls_over_an_edge_that_slips():
    # Its centre falls straight down, z = d cos φ: by Lagrange's equation with I = m a² / 6,
    # (I + m d² sin² φ) φ'' = m g d sin φ - m d² sin φ cos φ φ'². Longer steps than these are cut
    # where the edge has got 20 µm deeper, so they do not show the order.
    def acceleration(φ, rate):
        fall = G * HALF_DIAGONAL * np.sin(φ)
        turning = HALF_DIAGONAL**2 * np.sin(φ) * np.cos(φ) * rate**2
        return (fall - turning) / (EDGE**2 / 6 + (HALF_DIAGONAL * np.sin(φ)) ** 2)

    expected = angle_after(0.2, acceleration)
    check_first_order(
        lambda step: [tilt(pose(tilted_cube(), 0.0, 0.2, step)[1]) - expected],
        [1e-3, 5e-4, 2.5e-4],
    )


def rod_rates(_, state):
    """Rates of a rod (x, y, heading, v_x, v_y, spin along it, spin about the vertical).

    Each end is pressed by N_i and slips by u_i, against friction μ N_i û_i. With N_1 + N_2 = m g,
    and moments about the horizontal across the rod that change its angular momentum by
    I_along ω_along ω_up, both N_i are known.
    """
    mass, inertia = ROD.mass(DENSITY), ROD.inertia(DENSITY)
    heading, rolling, turning = state[2], state[5], state[6]
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    across, up = np.array([-along[1], along[0], 0.0]), np.array([0.0, 0.0, 1.0])
    spin = rolling * along + turning * up
    arms = np.array([end * LENGTH / 2 * along - RADIUS * up for end in (1, -1)])
    slips = np.array([*state[3:5], 0.0]) + np.cross(spin, arms)
    slips[:, 2] = 0.0
    forces = up - FRICTION * slips / np.linalg.norm(slips, axis=1, keepdims=True)
    moments = np.cross(arms, forces)
    pressing = np.linalg.solve(
        [np.ones(2), moments @ across], [mass * G, inertia[2] * rolling * turning]
    )
    acceleration, torque = pressing @ forces / mass, pressing @ moments
    return [
        *state[3:5],
        turning,
        *acceleration[:2],
        torque @ along / inertia[2],
        torque @ up / inertia[0],
    ]


@pytest.mark.parametrize(
    ("velocity", "rolling", "turning"),
    [
        ((2.0, 0.3), 0.0, 0.0),
        ((2.0, 0.3), 3.0, 0.0),
        ((2.0, 0.3), 0.0, 4.0),
        ((0.5, 1.0), 0.0, 5.0),
    ],
    ids=["slides", "slides and rolls", "slides and turns", "turns on the spot"],
)
def test_a_rod_that_slides_and_pivots(velocity, rolling, turning):
    t = 0.2
    start = [0.0, 0.0, 0.0, *velocity, rolling, turning]
    x, y, heading = solve_ivp(rod_rates, (0, t), start, rtol=1e-11, atol=1e-13).y[:3, -1]
    body = Body(ROD, (0, 0, RADIUS), about_y(np.pi / 2), (*velocity, 0.0), (rolling, 0.0, turning))

    def error(step):
        position, rotation = pose(body, FRICTION, t, step)
        axis = rotation.apply([0.0, 0.0, 1.0])
        return [*(position[:2] - (x, y)), LENGTH * (np.arctan2(axis[1], axis[0]) - heading)]

    check_first_order(error, [4e-3, 2e-3, 1e-3])
