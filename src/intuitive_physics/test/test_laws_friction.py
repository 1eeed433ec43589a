"""Sliding, rolling and holding on a plane."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.shapes import Box, Capsule, Sphere

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    ROUNDING,
    STEPPED,
    UPRIGHT,
    Body,
    G,
    about_y,
    coefficients,
    downhill,
    engines,
    incline,
    lying,
    make_scene,
    on_incline,
    quaternion,
    quaternion_product,
    roundness,
    stepped_at,
)

SPHERE, CAPSULE, BOX = Sphere(0.05), Capsule(0.05, 0.2), Box((0.1, 0.1, 0.1))
ROLLING_BODIES = [
    (EVENT_DRIVEN, SPHERE),
    (STEPPED, SPHERE),
    (STEPPED, CAPSULE),
    (BULLET, SPHERE),
]
SLIDING_BODIES = [(EVENT_DRIVEN, SPHERE), (STEPPED, SPHERE), (STEPPED, BOX), (BULLET, BOX)]


def cases(pairs):
    return pytest.mark.parametrize(
        ("engine", "shape"), pairs, ids=[f"{engine}-{shape.kind}" for engine, shape in pairs]
    )


def allowed(engine, acceleration, times, phases=1):
    """How far (m) an engine may be off after so many phases of motion at up to an acceleration.

    The end of a phase is late by up to a step h: a h². Bullet moves by the speed at a step's end
    and not by the mean one: a h t. Sweeps that stop at a part σ of what gravity does in a step
    leave σ g t² / 2.
    """
    h, t = engine.step, np.asarray(times)
    late = np.abs(acceleration) * (phases * h * h + engine.flight_step * (t + h))
    return ROUNDING + late + 0.5 * engine.sweep_rest * G * t**2


@cases(ROLLING_BODIES)
@pytest.mark.parametrize("mu", [0.1, 0.4])
def test_sliding_turns_to_rolling(engine, shape, mu):
    # v = v0 - μ_d g t until it rolls, at k / (1 + k) v0 / (μ_d g), with v = v0 / (1 + k) for ever:
    # friction J brakes v by J / m and spins by J r / I until v = r ω. A sphere's k = 2/5 makes
    # that 5/7 v0 after 2 v0 / (7 μ_d g).
    v0, k = 2.0, roundness(shape)
    t_roll = k / (1 + k) * v0 / (mu * G)
    x_roll = v0 * t_roll - 0.5 * mu * G * t_roll**2
    times = np.array([0.5, 1.0, 2.0, 2.5]) * t_roll
    scene = make_scene(Body(shape, (0, 0, shape.radius), lying(shape), (v0, 0, 0)))
    path = engine.path(scene, coefficients(mu), times)[0]
    sliding = v0 * times - 0.5 * mu * G * times**2
    rolling = x_roll + v0 / (1 + k) * (times - t_roll)
    truth = np.where(times <= t_roll, sliding, rolling)
    np.testing.assert_array_less(np.abs(path[:, 0] - truth), allowed(engine, mu * G, times))
    np.testing.assert_allclose(path[:, 1], 0.0, atol=engine.gap)
    np.testing.assert_allclose(path[:, 2], shape.radius, atol=engine.gap)
    # The impulse at the contact keeps the angular momentum about it, whatever its time.
    speed = (path[3, 0] - path[2, 0]) / (times[3] - times[2])
    assert speed == pytest.approx(v0 / (1 + k), rel=1e-6 if engine is not BULLET else 1e-3)


@cases(ROLLING_BODIES)
def test_backspin_brings_it_back(engine, shape):
    # Slip v0 + r ω0 is used up by J = k m / (1 + k) (v0 + r ω0): v = (v0 - k r ω0) / (1 + k), for a
    # sphere (5 v0 - 2 r ω0) / 7.
    v0, spin, mu, k = 1.0, 100.0, 0.3, roundness(shape)
    t_roll = k / (1 + k) * (v0 + shape.radius * spin) / (mu * G)
    scene = make_scene(Body(shape, (0, 0, shape.radius), lying(shape), (v0, 0, 0), (0, -spin, 0)))
    path = engine.path(scene, coefficients(mu), [t_roll + 0.1, t_roll + 0.6])[0]
    speed = (path[1, 0] - path[0, 0]) / 0.5
    expected = (v0 - k * shape.radius * spin) / (1 + k)
    assert expected < 0
    exactness = {EVENT_DRIVEN: 1e-9, STEPPED: 1e-6, BULLET: 1e-2}
    assert speed == pytest.approx(expected, rel=exactness[engine])


@cases(ROLLING_BODIES)
@pytest.mark.parametrize("mu_r", [0.01, 0.1])
def test_rolling_friction_stops_it(engine, shape, mu_r):
    # Torque μ_r r N: (m + I / r²) a = μ_r m g, a = μ_r g / (1 + k), 5/7 μ_r g for a sphere; it
    # stops after v0² / (2 a) and stays.
    v0, r = 0.5, shape.radius
    brake = mu_r * G / (1 + roundness(shape))
    scene = make_scene(Body(shape, (0, 0, r), lying(shape), (v0, 0, 0), (0, v0 / r, 0)))
    times = np.array([0.25, 0.5, 1.0, 1.2]) * v0 / brake
    path = engine.path(scene, coefficients(0.5, mu_r=mu_r), times)[0]
    full = v0**2 / (2 * brake)
    truth = full * np.array([0.4375, 0.75, 1.0, 1.0])
    np.testing.assert_array_less(np.abs(path[:, 0] - truth), allowed(engine, brake, times))


@cases(SLIDING_BODIES)
def test_stopping_distance(engine, shape):
    # A box stops after v0² / (2 μ_d g). A sphere that cannot roll is none: it slides with a spin
    # that friction feeds, x = v0² (1 - (1 / (1 + k))²) / (2 μ_d g), 12/49 v0² / (μ_d g), and with
    # rolling friction μ_r stops v0² (5/7)² / (2 · 5/7 μ_r g) later.
    v0, mu, mu_r = 2.0, 0.3, 0.2
    if isinstance(shape, Box):
        height, mu_r = 0.05, 0.0
        full, time, late = v0**2 / (2 * mu * G), v0 / (mu * G), 0.0
    else:
        height, brake = shape.radius, 5 / 7 * mu_r * G
        # While it slides rolling friction does not act.
        full = 12 / 49 * v0**2 / (mu * G) + (5 / 7 * v0) ** 2 / (2 * brake)
        time = 2 / 7 * v0 / (mu * G) + 5 / 7 * v0 / brake
        # Rolling friction begins with the first step in which it does not slide: v h too late.
        late = 5 / 7 * v0 * engine.step
    scene = make_scene(Body(shape, (0, 0, height), UPRIGHT, (v0, 0, 0)))
    times = [time + 0.1, time + 1.1]
    x, q = engine.poses(scene, coefficients(mu, mu_r=mu_r), times)
    np.testing.assert_array_less(np.abs(x[0, :, 0] - full), late + allowed(engine, mu * G, time))
    np.testing.assert_allclose(x[0, :, 1], 0.0, atol=engine.gap)
    if isinstance(shape, Box):
        assert abs(q[0, 1] @ UPRIGHT) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("heading", [0.0, 0.4, np.pi / 4, 1.3])
@engines(STEPPED, BULLET)
def test_a_box_stops_after_the_same_way_in_any_direction(engine, heading):
    # Coulomb's cone is round: |F| ≤ μ N, and the path is a straight line.
    v0, mu = 1.5, 0.4
    along = np.array([np.cos(heading), np.sin(heading), 0])
    scene = make_scene(Body(BOX, (0, 0, 0.05), UPRIGHT, v0 * along))
    time = v0 / (mu * G)
    end = engine.path(scene, coefficients(mu), [time + 0.2])[0, 0] - (0, 0, 0.05)
    tolerance = allowed(engine, mu * G, time)
    assert end @ along == pytest.approx(v0**2 / (2 * mu * G), abs=tolerance)
    assert np.linalg.norm(end - (end @ along) * along) <= tolerance + engine.gap


FLAT = Box((0.2, 0.2, 0.05))


@pytest.mark.parametrize("degrees", [10.0, 25.0, 40.0])
@engines(STEPPED, BULLET)
def test_a_box_holds_on_an_incline_below_atan_mu_s_and_slides_above(engine, degrees):
    # Held while tan α ≤ μ_s. The flat box does not tip: width / height is 4.
    alpha = np.radians(degrees)
    start = on_incline(alpha, 0.025)
    scene = make_scene(Body(FLAT, start, about_y(alpha)), planes=[incline(alpha)])
    times = [0.5, 1.0]
    held = engine.path(scene, coefficients(1.02 * np.tan(alpha)), times)[0]
    np.testing.assert_allclose(held, [start, start], atol=1e-3)
    mu = 0.98 * np.tan(alpha)
    slid = (engine.path(scene, coefficients(mu), times)[0] - start) @ downhill(alpha)
    a = G * (np.sin(alpha) - mu * np.cos(alpha))
    tolerance = allowed(engine, G * np.sin(alpha), times)
    np.testing.assert_array_less(np.abs(slid - 0.5 * a * np.square(times)), tolerance)
    assert slid[1] > 0.25 * a


@engines(STEPPED)
def test_once_it_slides_dynamic_friction_acts(engine):
    # μ_d < tan α < μ_s: at rest it stays, given a push it slides at g (sin α - μ_d cos α).
    alpha, mu_s, mu = np.radians(25.0), 0.6, 0.3
    start, theta = on_incline(alpha, 0.025), coefficients(mu, mu_s=mu_s)
    times = np.array([0.5, 1.0])
    at_rest = make_scene(Body(FLAT, start, about_y(alpha)), planes=[incline(alpha)])
    np.testing.assert_allclose(engine.path(at_rest, theta, times)[0], [start, start], atol=1e-3)
    v0 = 0.5
    pushed = make_scene(
        Body(FLAT, start, about_y(alpha), v0 * downhill(alpha)), planes=[incline(alpha)]
    )
    slid = (engine.path(pushed, theta, times)[0] - start) @ downhill(alpha)
    a = G * (np.sin(alpha) - mu * np.cos(alpha))
    truth = v0 * times + 0.5 * a * times**2
    np.testing.assert_array_less(np.abs(slid - truth), allowed(engine, a, times))


@pytest.mark.parametrize("degrees", [5.0, 20.0])
@cases(ROLLING_BODIES)
def test_rolling_down_an_incline(engine, shape, degrees):
    # Without slip a = g sin α / (1 + k); the friction it takes, k / (1 + k) tan α, is below μ_s.
    alpha = np.radians(degrees)
    start = on_incline(alpha, shape.radius)
    scene = make_scene(Body(shape, start, lying(shape)), planes=[incline(alpha)])
    times = np.array([0.5, 1.0])
    went = (engine.path(scene, coefficients(0.8), times)[0] - start) @ downhill(alpha)
    a = G * np.sin(alpha) / (1 + roundness(shape))
    np.testing.assert_array_less(np.abs(went - 0.5 * a * times**2), allowed(engine, a, times))


@cases(ROLLING_BODIES)
def test_a_steep_incline_slides(engine, shape):
    # Where k / (1 + k) tan α > μ the friction cannot make it roll: a = g (sin α - μ cos α).
    alpha, mu, k = np.radians(50.0), 0.15, roundness(shape)
    assert k / (1 + k) * np.tan(alpha) > 1.5 * mu
    start = on_incline(alpha, shape.radius)
    scene = make_scene(Body(shape, start, lying(shape)), planes=[incline(alpha)])
    times = np.array([0.3, 0.6])
    went = (engine.path(scene, coefficients(mu), times)[0] - start) @ downhill(alpha)
    a = G * (np.sin(alpha) - mu * np.cos(alpha))
    np.testing.assert_array_less(np.abs(went - 0.5 * a * times**2), allowed(engine, a, times))


@cases(ROLLING_BODIES[:3])
def test_rolling_friction_holds_on_a_slight_incline(engine, shape):
    # It stays where tan α ≤ μ_r, and else rolls at g (sin α - μ_r cos α) / (1 + k).
    alpha = np.arctan(0.05)
    start = on_incline(alpha, shape.radius)
    scene = make_scene(Body(shape, start, lying(shape)), planes=[incline(alpha)])
    stays = engine.path(scene, coefficients(0.5, mu_r=0.06), [4.0])[0, 0]
    np.testing.assert_allclose(stays, start, atol=1e-3)
    leaves = engine.path(scene, coefficients(0.5, mu_r=0.03), [2.0])[0, 0]
    a = G * (np.sin(alpha) - 0.03 * np.cos(alpha)) / (1 + roundness(shape))
    went = (leaves - start) @ downhill(alpha)
    np.testing.assert_array_less(abs(went - 2.0 * a), allowed(engine, a, 2.0))


@engines(EVENT_DRIVEN, STEPPED)
def test_pivoting_decays(engine):
    # Spin about the normal: I dω/dt = -μ_r r N, so dω/dt = -5/2 μ_r g / r; the angle is ω0² / 2α.
    mu_r, spin, r = 0.05, 10.0, SPHERE.radius
    alpha = 2.5 * mu_r * G / r
    scene = make_scene(Body(SPHERE, (0, 0, r), UPRIGHT, (0, 0, 0), (0, 0, spin)))
    q = engine.poses(scene, coefficients(0.4, mu_r=mu_r), [spin / alpha + 0.05, 2.0])[1][0]
    angle = spin**2 / (2 * alpha)
    for orientation in q:
        turned = 2 * np.arctan2(orientation[2], orientation[3])
        assert turned == pytest.approx(angle, abs=allowed(engine, alpha, spin / alpha))


def test_a_spinning_box_stops_by_the_friction_under_its_face():
    # A uniform pressure on a square face of edge s opposes pivoting by the torque μ N s c, with
    # c = (√2 + ln(1 + √2)) / 6 = 0.3826; four corners that carry a quarter each, by μ N s / √2.
    # What engines use for a face lies between: the time to stop is I ω0 / torque.
    mu, spin, s = 0.3, 8.0, 0.1
    scene = make_scene(Body(BOX, (0, 0, s / 2), UPRIGHT, (0, 0, 0), (0, 0, spin)))
    slowest = s**2 / 6 * spin / (mu * G * s * 0.3826)
    fastest = s**2 / 6 * spin / (mu * G * s / np.sqrt(2))
    times = np.array([0.5 * fastest, slowest + 0.05, slowest + 1.0])
    x, q = STEPPED.poses(scene, coefficients(mu), times)
    angles = 2 * np.arctan2(q[0, :, 2], q[0, :, 3])
    assert 0.7 * spin * times[0] < angles[0] < spin * times[0]
    least, most = 0.5 * spin * fastest, 0.5 * spin * slowest
    slack = allowed(STEPPED, spin / fastest, slowest)
    assert least - slack < angles[1] < most + slack
    assert angles[2] == pytest.approx(angles[1], abs=1e-6)
    np.testing.assert_allclose(x[0, :, :2], 0.0, atol=1e-3)


@engines(STEPPED, BULLET)
def test_a_capsule_does_not_roll_along_its_axis(engine):
    # Along its axis it can only slide: v0² / (2 μ g).
    v0, mu = 1.0, 0.4
    capsule = Body(CAPSULE, (0, 0, 0.05), (0, np.sqrt(0.5), 0, np.sqrt(0.5)), (v0, 0, 0))
    time = v0 / (mu * G)
    path = engine.path(make_scene(capsule), coefficients(mu), [time + 0.1, time + 1.0])[0]
    full = v0**2 / (2 * mu * G)
    np.testing.assert_array_less(np.abs(path[:, 0] - full), allowed(engine, mu * G, time))


def test_curved_rolling_converges_with_the_step():
    # A capsule that rolls down obliquely, and a ball that slides across an incline: what is left of
    # the error after halving the step is at most about a half of it (first order).
    alpha, mu = np.radians(15.0), 0.3
    start = on_incline(alpha, SPHERE.radius)
    scene = make_scene(Body(SPHERE, start, UPRIGHT, (0, 3.0, 0)), planes=[incline(alpha)])
    theta = coefficients(mu, mu_s=0.6)
    truth = EVENT_DRIVEN.path(scene, theta, [0.2])[0, 0]
    errors = [
        np.linalg.norm(stepped_at(h).path(scene, theta, [0.2])[0, 0] - truth)
        for h in (0.02, 0.01, 0.005, 0.0025)
    ]
    # Below that the reference's own error, from turning its friction every 2 ms, shows.
    if errors[0] > 1e-5:
        slope = np.polyfit(np.arange(4), np.log2(errors), 1)[0]
        assert slope < -0.8, errors


@pytest.mark.parametrize("heading", [0.3, 1.0])
@engines(STEPPED)
def test_a_capsule_rolls_in_any_heading(engine, heading):
    # The same slope, turned about the vertical with all that is on it.
    alpha = np.radians(10.0)
    turn = quaternion((0, 0, heading))
    c, s = np.cos(heading), np.sin(heading)
    spun = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    normal = spun @ incline(alpha)[:3]
    start = CAPSULE.radius * normal
    scene = make_scene(
        Body(CAPSULE, start, quaternion_product(turn, lying(CAPSULE))), planes=[(*normal, 0.0)]
    )
    end = engine.path(scene, coefficients(0.8), [1.0])[0, 0] - start
    a = G * np.sin(alpha) / (1 + roundness(CAPSULE))
    np.testing.assert_allclose(end, 0.5 * a * spun @ downhill(alpha), atol=allowed(engine, a, 1.0))
