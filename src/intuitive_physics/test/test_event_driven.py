"""One sphere and planes: what `test_laws_friction` and `test_laws_impacts` do not ask."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.shapes import Sphere

from .laws_scenes import EVENT_DRIVEN, UPRIGHT, Body, G, coefficients, make_scene

R = 0.05
# Motion is a closed form, so only rounding is left; what it grows to over some hundred events:
EXACT = 1e-9
COMMON = coefficients(0.4, mu_s=0.5, e=0.5)
"""θ_s where its values hardly matter."""


def incline(slope):
    """A plane z = tan(slope) x through the origin: downhill is -x."""
    return (-np.sin(slope), 0.0, np.cos(slope), 0.0)


def on_incline(slope):
    """Centre of a sphere that touches `incline` at the origin, and the downhill direction."""
    return R * np.array(incline(slope)[:3]), -np.array([np.cos(slope), 0.0, np.sin(slope)])


def test_bouncing_ends_and_the_ball_rests():
    # All bounces end by t1 (1 + 2 e / (1 - e)).
    e, h = 0.6, 0.5
    end = np.sqrt(2 * h / G) * (1 + 2 * e / (1 - e))
    scene = make_scene(Body(Sphere(R), (0, 0, h + R)))
    path = EVENT_DRIVEN.path(
        scene, coefficients(0.4, mu_s=0.5, e=e), [end, end + 5.0, end + 100.0]
    )[0]
    np.testing.assert_allclose(path[:, 2], R, atol=EXACT)


def test_rolling_friction_cannot_exceed_the_grip():
    # Rolling needs the friction 5/7 μ_r N; a contact with less grip brakes at μ_s g only.
    v0, mu = 1.0, 0.02
    scene = make_scene(Body(Sphere(R), (0, 0, R), UPRIGHT, (v0, 0, 0), (0, v0 / R, 0)))
    path = EVENT_DRIVEN.path(scene, coefficients(mu, mu_r=0.5, e=0.5), [1.0])[0, 0]
    assert path[0] == pytest.approx(v0 - 0.5 * mu * G, abs=EXACT)


def test_frictionless_sliding_never_ends():
    scene = make_scene(Body(Sphere(R), (0, 0, R), UPRIGHT, (1.5, 0, 0)))
    path = EVENT_DRIVEN.path(scene, coefficients(0.0, e=0.5), [1.0, 10.0])[0]
    np.testing.assert_allclose(path[:, 0], [1.5, 15.0], atol=EXACT)


def test_static_friction_decides_whether_a_ball_slides():
    # The same incline rolls for μ_s just above 2/7 tan β and slides for μ_s just below.
    beta = np.radians(40.0)
    threshold = 2 / 7 * np.tan(beta)
    start, downhill = on_incline(beta)
    scene = make_scene(Body(Sphere(R), start), planes=[incline(beta)])
    rolls = EVENT_DRIVEN.path(scene, coefficients(0.01, mu_s=1.001 * threshold, e=0.5), [1.0])[0, 0]
    slides = EVENT_DRIVEN.path(scene, coefficients(0.01, mu_s=0.999 * threshold, e=0.5), [1.0])[
        0, 0
    ]
    assert (rolls - start) @ downhill == pytest.approx(0.5 * 5 / 7 * G * np.sin(beta), abs=EXACT)
    sliding = G * (np.sin(beta) - 0.01 * np.cos(beta))
    assert (slides - start) @ downhill == pytest.approx(0.5 * sliding, abs=EXACT)


def test_rolling_friction_holds_a_ball_on_a_slight_incline():
    # A ball at rest stays where tan β ≤ μ_r, and else rolls at 5/7 g (sin β - μ_r cos β).
    start, downhill = on_incline(np.arctan(0.05))
    scene = make_scene(Body(Sphere(R), start), planes=[incline(np.arctan(0.05))])
    stays = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, mu_r=0.051, e=0.5), [5.0])[0, 0]
    leaves = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, mu_r=0.049, e=0.5), [5.0])[0, 0]
    np.testing.assert_allclose(stays, start, atol=EXACT)
    beta = np.arctan(0.05)
    a = 5 / 7 * G * (np.sin(beta) - 0.049 * np.cos(beta))
    assert (leaves - start) @ downhill == pytest.approx(0.5 * a * 25.0, abs=EXACT)


def test_curved_rolling_on_an_incline():
    # Rolling across an incline without μ_r is a parabola with 5/7 of gravity's pull downhill.
    beta = np.radians(10.0)
    start, downhill = on_incline(beta)
    n = np.array(incline(beta)[:3])
    v0 = np.array([0.0, 0.7, 0.0])
    scene = make_scene(
        Body(Sphere(R), start, UPRIGHT, v0, np.cross(n, v0) / R), planes=[incline(beta)]
    )
    times = np.array([0.3, 0.9])
    path = EVENT_DRIVEN.path(scene, coefficients(0.8, mu_s=0.9, e=0.5), times)[0]
    truth = (
        start + np.outer(times, v0) + np.outer(0.5 * times**2, 5 / 7 * G * np.sin(beta) * downhill)
    )
    # v turns, so the phase is cut into pieces of 2 ms; without μ_r each piece is exact.
    np.testing.assert_allclose(path, truth, atol=EXACT)


def reference_slip_on_incline(v0, spin, beta, mu_d, t_end, steps):
    """Integrate dv/dt = g_t - μ_d g_n ŝ, dω/dt = -5/(2 r) n × (-μ_d g_n ŝ) by RK4."""
    n = np.array(incline(beta)[:3])
    along = np.array([0, 0, -G]) - (-G * n[2]) * n
    press = G * n[2]

    def rate(y):
        slip = y[3:6] - R * np.cross(y[6:9], n)
        friction = -mu_d * press * slip / np.linalg.norm(slip)
        return np.concatenate([y[3:6], along + friction, -2.5 / R * np.cross(n, friction)])

    y = np.concatenate([R * n, v0, spin])
    h = t_end / steps
    for _ in range(steps):
        k1 = rate(y)
        k2 = rate(y + h / 2 * k1)
        k3 = rate(y + h / 2 * k2)
        k4 = rate(y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return y[:3]


def test_curved_sliding_on_an_incline():
    # The slip's direction turns: pieces of h = 2 ms with the direction of their middle. The local
    # error is O(h³ s''), here below 1e-6 m over 0.4 s against RK4 of the same law.
    beta, mu_d = np.radians(15.0), 0.3
    v0, spin = np.array([0.0, 3.0, 0.0]), np.zeros(3)
    scene = make_scene(
        Body(Sphere(R), on_incline(beta)[0], UPRIGHT, v0, spin), planes=[incline(beta)]
    )
    path = EVENT_DRIVEN.path(scene, coefficients(mu_d, mu_s=0.6, e=0.5), [0.2])[0, 0]
    truth = reference_slip_on_incline(v0, spin, beta, mu_d, 0.2, 4000)
    np.testing.assert_allclose(path, truth, atol=1e-6)


def test_sticking_bounce_feels_rolling_friction():
    # A rolling ball that bounces loses 5/7 μ_r (1 + e) |v_n| of its speed.
    v0, vn, e, mu_r = 1.0, 0.5, 0.5, 0.1
    scene = make_scene(Body(Sphere(R), (0, 0, R), UPRIGHT, (v0, 0, -vn), (0, v0 / R, 0)))
    path = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, mu_r=mu_r, e=e), [0.01, 0.03])[0]
    speed = (path[1, 0] - path[0, 0]) / 0.02
    assert speed == pytest.approx(v0 - 5 / 7 * mu_r * (1 + e) * vn, abs=EXACT)


def test_wall_turns_the_ball_round():
    # A frictionless ball comes back from the wall at e v0.
    v0, e = 1.0, 0.6
    walls = [(0, 0, 1, 0), (-1, 0, 0, -1.0)]
    scene = make_scene(Body(Sphere(R), (0, 0, R), UPRIGHT, (v0, 0, 0)), planes=walls)
    t_hit = (1.0 - R) / v0
    path = EVENT_DRIVEN.path(scene, coefficients(0.0, e=e), [t_hit, t_hit + 0.5])[0]
    assert path[0, 0] == pytest.approx(1.0 - R, abs=EXACT)
    assert path[1, 0] == pytest.approx(1.0 - R - 0.5 * e * v0, abs=EXACT)


def test_ball_driven_into_a_wall_by_its_spin_stays_there():
    # Topspin drives the ball against the wall until friction has used it up; then it rests there.
    walls = [(0, 0, 1, 0), (-1, 0, 0, -1.0)]
    scene = make_scene(
        Body(Sphere(R), (1 - R, 0, R), UPRIGHT, (0, 0, 0), (0, 30.0, 0)), planes=walls
    )
    path = EVENT_DRIVEN.path(scene, coefficients(0.2, mu_r=0.01), [0.05, 10.0, 20.0])[0]
    np.testing.assert_allclose(path[:, 0], 1 - R, atol=2e-5)
    np.testing.assert_allclose(path[2], path[1], atol=EXACT)


def test_ball_rests_in_a_groove():
    # Two planes at ±45° hold a ball at √2 r above their common line.
    s = np.sqrt(0.5)
    scene = make_scene(Body(Sphere(R), (0.0, 0, 0.3)), planes=[(s, 0, s, 0), (-s, 0, s, 0)])
    path = EVENT_DRIVEN.path(scene, coefficients(0.4, mu_s=0.5, mu_r=0.05, e=0.3), [5.0, 10.0])[0]
    np.testing.assert_allclose(path, [[0, 0, R / s]] * 2, atol=1e-6)


def test_ball_slides_along_a_frictionless_groove():
    # Along a groove that falls at β: a = g sin β. The cluster's steps of 1 ms hold the
    # acceleration constant, so that is exact.
    beta, s = 0.2, np.sqrt(0.5)
    turn = np.array([[np.cos(beta), 0, np.sin(beta)], [0, 1, 0], [-np.sin(beta), 0, np.cos(beta)]])
    planes = [(*(turn @ (0, s, s)), 0), (*(turn @ (0, -s, s)), 0)]
    start = turn @ (0, 0, R / s)
    scene = make_scene(Body(Sphere(R), start), planes=planes)
    path = EVENT_DRIVEN.path(scene, coefficients(0.0, e=0.5), [1.0])[0, 0]
    downhill = turn @ (1, 0, 0)
    assert (path - start) @ downhill == pytest.approx(0.5 * G * np.sin(beta), abs=1e-6)


def test_start_below_the_floor_is_lifted():
    # Noisy states of a ball at rest lie below the floor half of the time.
    scene = make_scene(Body(Sphere(R), (0, 0, R - 0.003)))
    path = EVENT_DRIVEN.path(scene, COMMON, [0.0, 1.0])[0]
    np.testing.assert_allclose(path[:, 2], R, atol=EXACT)


def test_orientation_of_a_rolling_ball():
    # A ball that rolls a distance d turns by d / r about n × v.
    v0 = 0.5
    scene = make_scene(Body(Sphere(R), (0, 0, R), UPRIGHT, (v0, 0, 0), (0, v0 / R, 0)))
    _, orientations = EVENT_DRIVEN.poses(scene, COMMON, [0.25, 1.0])
    for t, q in zip([0.25, 1.0], orientations[0], strict=True):
        angle = v0 * t / R
        assert abs(q @ [0, np.sin(angle / 2), 0, np.cos(angle / 2)]) == pytest.approx(1, abs=1e-12)
