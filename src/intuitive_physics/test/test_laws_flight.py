"""Motion without contacts: free fall, free rotation, the air."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj, ellipkinc

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.shapes import Box, Capsule, Sphere

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    ROUNDING,
    STEPPED,
    UPRIGHT,
    Body,
    G,
    coefficients,
    engines,
    inverse,
    make_scene,
    motion_between,
    quaternion,
    quaternion_product,
    random_quaternion,
    rotation_vector,
    stepped_at,
)

ROUND_OR_NOT = [Sphere(0.05), Box((0.1, 0.2, 0.3)), Capsule(0.05, 0.2)]


@engines()
def test_projectile(engine):
    # x(t) = x0 + v0 t + g t²/2; semi-implicit Euler lags by g h t/2.
    times = np.array([0.013, 0.1, 0.3, 0.605])
    start, velocity = np.array([0.3, -0.2, 5.0]), np.array([1.0, -2.0, 0.5])
    scene = make_scene(Body(Sphere(0.05), start, UPRIGHT, velocity, (3.0, -2.0, 1.0)))
    path = engine.path(scene, coefficients(), times)[0]
    truth = start + np.outer(times, velocity) + np.outer(0.5 * times**2, (0, 0, -G))
    lag = 0.5 * G * engine.flight_step * (times[-1] + engine.flight_step)
    np.testing.assert_allclose(path, truth, atol=ROUNDING + lag)


@pytest.mark.parametrize("shape", ROUND_OR_NOT, ids=lambda s: s.kind)
@engines(STEPPED, BULLET)
def test_the_centre_of_any_spinning_shape_flies_a_parabola(engine, shape):
    times = np.array([0.1, 0.7])
    velocity = np.array([0.4, 0.1, 2.0])
    scene = make_scene(Body(shape, (0, 0, 3.0), UPRIGHT, velocity, (5.0, 8.0, -6.0)))
    path = engine.path(scene, coefficients(), times)[0]
    truth = np.outer(times, velocity) + np.outer(0.5 * times**2, (0, 0, -G)) + (0, 0, 3.0)
    lag = 0.5 * G * engine.flight_step * (times[-1] + engine.flight_step)
    np.testing.assert_allclose(path, truth, atol=ROUNDING + lag)


def floating(shape, orientation, body_spin):
    """A body that turns freely; its spin is given in its own axes."""
    spin = rotation_matrix(orientation) @ body_spin
    return make_scene(
        Body(shape, (0, 0, 0), orientation, (0, 0, 0), spin), planes=(), gravity=[0] * 3
    )


def angle_between(a, b):
    """Angle in rad of the rotation between orientations."""
    return np.linalg.norm(rotation_vector(quaternion_product(a, inverse(b))))


def phase_error(engine, rate, time):
    """What the angle turned at `rate` rad/s may be off by in a method of fourth order.

    That is (ω h)⁴ of it; Bullet's method is of first order, which is ω h / 2 of it.
    """
    part = rate * engine.step
    return rate * time * (part / 2 if engine is BULLET else part**4) + 1e-7


@pytest.mark.parametrize("shape", [Box((0.1, 0.1, 0.3)), Box((0.3, 0.3, 0.1)), Capsule(0.05, 0.2)])
@engines(STEPPED, BULLET)
def test_precession_of_a_symmetric_body(engine, shape):
    # L stands still; the symmetry axis turns about it at |L| / I1 while the body turns about that
    # axis at (1 - I3 / I1) ω3: R(t) = exp(L t / I1) R0 exp((1 - I3 / I1) ω3 t e3).
    start = random_quaternion(np.random.default_rng(1))
    body_spin = np.array([2.0, 1.0, 4.0])
    i1, _, i3 = shape.inertia(500.0)
    momentum = rotation_matrix(start) @ ([i1, i1, i3] * body_spin)
    own_rate = (1 - i3 / i1) * body_spin[2]
    rate = np.linalg.norm(momentum) / i1 + abs(own_rate)
    times = np.array([0.25, 0.5, 1.0])
    _, turned = engine.poses(floating(shape, start, body_spin), coefficients(), times)
    for t, q in zip(times, turned[0], strict=True):
        about_own = quaternion((0, 0, own_rate * t))
        about_momentum = quaternion(momentum * t / i1)
        truth = quaternion_product(about_momentum, quaternion_product(start, about_own))
        assert angle_between(q, truth) < phase_error(engine, rate, t)


def tumbling(inertia, body_spin, times):
    """Angular velocity in the body's axes of a free body, I1 < I2 < I3 (Landau and Lifshitz, § 37).

    For M² > 2 E I2: ω1 = a1 cn τ, ω2 = a2 sn τ, ω3 = a3 dn τ with τ = n (t + t0).
    """
    i1, i2, i3 = inertia
    energy2 = inertia @ body_spin**2
    square = ((inertia * body_spin) ** 2).sum()
    assert square > energy2 * i2
    a1 = np.sqrt((energy2 * i3 - square) / (i1 * (i3 - i1)))
    a2 = np.sqrt((energy2 * i3 - square) / (i2 * (i3 - i2)))
    a3 = np.sqrt((square - energy2 * i1) / (i3 * (i3 - i1)))
    rate = np.sqrt((i3 - i2) * (square - energy2 * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (energy2 * i3 - square) / ((i3 - i2) * (square - energy2 * i1))
    # All signs positive at the start: τ0 is the amplitude's elliptic integral.
    first = ellipkinc(np.arctan2(body_spin[1] / a2, body_spin[0] / a1), m)
    sn, cn, dn, _ = ellipj(first + rate * np.asarray(times), m)
    return np.stack([a1 * cn, a2 * sn, a3 * dn], axis=1)


INTERMEDIATE = Box((0.3, 0.2, 0.1)), np.array([0.1, 5.0, 0.6])
"""A box and a spin in its own axes that is all but about its intermediate axis."""


def tumbling_errors(engine, times):
    """How far (rad/s) the spin in the body's axes is from Jacobi's functions, shape (n_times, 3).

    It is R(t)ᵀ L / I and L stands still, so that orientations alone tell it.
    """
    shape, body_spin = INTERMEDIATE
    inertia = shape.inertia(500.0)
    start = random_quaternion(np.random.default_rng(2))
    momentum = rotation_matrix(start) @ (inertia * body_spin)
    truth = tumbling(inertia, body_spin, times)
    _, turned = engine.poses(floating(shape, start, body_spin), coefficients(), times)
    return np.array([rotation_matrix(q).T @ momentum / inertia for q in turned[0]]) - truth


@engines(STEPPED, BULLET)
def test_tumbling_about_the_intermediate_axis(engine):
    # Thrown about its middle axis a box turns over and over. The instability lets an error of the
    # start grow by exp(λ t), λ = 5 rad/s sqrt((I3 - I2) (I2 - I1) / (I1 I3)) = 2.4 /s, until it has
    # turned over after 1.3 s, and shrinks it after that: by 23 at the most.
    times = np.linspace(0.1, 2.0, 20)
    assert tumbling(INTERMEDIATE[0].inertia(500.0), INTERMEDIATE[1], times)[:, 1].min() < -4.0
    errors = tumbling_errors(engine, times)
    rate = np.linalg.norm(INTERMEDIATE[1])
    np.testing.assert_allclose(errors, 0.0, atol=23 * rate * phase_error(engine, rate, 1.0))


def test_tumbling_converges_with_the_step():
    # Free rotation is of fourth order in the step: halving it leaves a sixteenth of the error.
    times = np.linspace(0.2, 2.0, 10)
    errors = [np.abs(tumbling_errors(stepped_at(h), times)).max() for h in (0.04, 0.02, 0.01)]
    orders = -np.diff(np.log2(errors))
    assert (orders > 3.5).all(), orders


@pytest.mark.parametrize("shape", ROUND_OR_NOT[1:], ids=lambda s: s.kind)
@engines(STEPPED)
def test_free_rotation_keeps_energy_and_momentum(engine, shape):
    rng = np.random.default_rng(3)
    scene = floating(shape, random_quaternion(rng), rng.normal(size=3) * 4.0)
    theta = coefficients()
    gap = 0.01
    times = np.arange(501) * gap
    x, q = engine.poses(scene, theta, times)
    motions = [motion_between(x[:, k : k + 2], q[:, k : k + 2], gap) for k in range(0, 500, 25)]
    energies = np.array([m.energy(scene, theta) for m in motions])
    momenta = np.array([m.momentum(scene, theta)[1] for m in motions])
    # Read from two orientations, a spin is off by (|ω| gap)² / 12; 500 steps may not add to that.
    reading = 2 * (np.linalg.norm(scene.states[0].angular_velocity) * gap) ** 2 / 12
    np.testing.assert_allclose(energies, energies[0], rtol=reading)
    size = np.linalg.norm(momenta[0])
    np.testing.assert_allclose(momenta, np.tile(momenta[0], (20, 1)), atol=reading * size)


@pytest.mark.parametrize("density", [30.0, 90.0])
@engines(STEPPED)
def test_falling_through_air(engine, density):
    # m dv/dt = m g - k v²: v = v_t tanh(g t / v_t), fallen v_t² / g ln cosh(g t / v_t), with
    # v_t = sqrt(m g / k), k = ρ C_d π r² / 2.
    shape, drag = Sphere(0.05), 0.47
    k = 0.5 * 1.2 * drag * np.pi * shape.radius**2
    v_t = np.sqrt(shape.mass(density) * G / k)
    scene = make_scene(Body(shape, (0, 0, 0), air={"drag_coefficient": drag}), planes=())
    times = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
    fallen = -engine.path(scene, coefficients(density=density), times)[0, :, 2]
    truth = v_t**2 / G * np.log(np.cosh(G * times / v_t))
    # Drag held constant over a step is late by half of it: h / 2 times the speed it took.
    taken = G * times - v_t * np.tanh(G * times / v_t)
    assert (np.abs(fallen - truth) < 0.5 * engine.step * taken + ROUNDING).all()


@engines(STEPPED)
def test_terminal_velocity(engine):
    # Where k v² = m g nothing changes any more, whatever the step.
    shape, drag, density = Sphere(0.05), 0.47, 30.0
    v_t = np.sqrt(shape.mass(density) * G / (0.6 * drag * np.pi * shape.radius**2))
    scene = make_scene(Body(shape, (0, 0, 0), air={"drag_coefficient": drag}), planes=())
    path = engine.path(scene, coefficients(density=density), [20.0, 21.0])[0, :, 2]
    assert path[0] - path[1] == pytest.approx(v_t, rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "surface"),
    [
        (Box((0.1, 0.1, 0.1)), 6 * 0.1**2),
        (Capsule(0.05, 0.1), 2 * np.pi * 0.05 * (0.1 + 2 * 0.05)),
    ],
    ids=["box", "capsule"],
)
@engines(STEPPED)
def test_drag_acts_on_the_mean_silhouette(engine, shape, surface):
    # Without gravity v = v0 / (1 + k v0 t / m), x = m / k ln(1 + k v0 t / m), k = ρ C_d A / 2 with
    # A = S / 4 (Cauchy).
    v0, t, density = 10.0, 1.0, 50.0
    beta = 0.5 * 1.2 * 1.1 * surface / 4 / shape.mass(density)
    body = Body(shape, (0, 0, 0), UPRIGHT, (v0, 0, 0), air={"drag_coefficient": 1.1})
    scene = make_scene(body, planes=(), gravity=(0, 0, 0))
    x = engine.path(scene, coefficients(density=density), [t])[0, 0, 0]
    taken = v0 - v0 / (1 + beta * v0 * t)
    truth = np.log(1 + beta * v0 * t) / beta
    assert x == pytest.approx(truth, abs=0.5 * engine.step * taken)


@engines(STEPPED)
def test_magnus_force_bends_the_path_to_a_circle(engine):
    # m v² / R = k ω v with k = ρ A r C_M / 2 and ω normal to v: R = m v / (k ω), turning at
    # Ω = k ω / m against v × ω; the force does no work.
    shape, density, magnus, spin, v0 = Sphere(0.05), 30.0, 1.0, 60.0, 3.0
    k = 0.5 * 1.2 * np.pi * 0.05**2 * 0.05 * magnus
    rate = k * spin / shape.mass(density)
    radius = v0 / rate
    body = Body(shape, (0, 0, 0), UPRIGHT, (v0, 0, 0), (0, 0, spin), {"magnus_coefficient": magnus})
    scene = make_scene(body, planes=(), gravity=(0, 0, 0))
    times = np.linspace(0.5, 2 * np.pi / rate, 8)
    path = engine.path(scene, coefficients(density=density), times)[0]
    truth = radius * np.stack([np.sin(rate * times), 1 - np.cos(rate * times), 0 * times], axis=1)
    # The force turned by (Ω h)² / 2 in a step: of first order in h on the way, none in the speed.
    np.testing.assert_allclose(path, truth, atol=0.5 * rate * engine.step * v0 * times[-1])
    fine = engine.path(scene, coefficients(density=density), [times[-1], times[-1] + 0.01])[0]
    assert np.linalg.norm(fine[1] - fine[0]) / 0.01 == pytest.approx(v0, rel=(rate * 0.01) ** 2)


@engines(STEPPED)
def test_no_air_no_force(engine):
    air = {"drag_coefficient": 1.0, "magnus_coefficient": 1.0}
    body = Body(Sphere(0.05), (0, 0, 0), UPRIGHT, (5.0, 0, 0), (0, 0, 50.0), air)
    scene = make_scene(body, planes=(), gravity=(0, 0, 0), air_density=0.0)
    path = engine.path(scene, coefficients(), [2.0])[0, 0]
    np.testing.assert_allclose(path, (10.0, 0, 0), atol=ROUNDING)


@engines(EVENT_DRIVEN, STEPPED)
def test_a_sphere_turns_steadily(engine):
    # I is a number, so ω stays: the orientation turns by |ω| t about ω.
    spin = np.array([3.0, -7.0, 5.0])
    scene = make_scene(
        Body(Sphere(0.05), (0, 0, 1.0), UPRIGHT, (0, 0, 1), spin), planes=(), gravity=(0, 0, 0)
    )
    _, turned = engine.poses(scene, coefficients(), [0.37, 1.0])
    for t, q in zip([0.37, 1.0], turned[0], strict=True):
        assert angle_between(q, quaternion(spin * t)) < 1e-7
