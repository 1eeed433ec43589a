"""Laws of spheres with κ = I / (m r²): 2/5 of a solid one, 2/3 of a thin shell."""

from __future__ import annotations

import numpy as np
import pytest

from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Sphere

from .laws_scenes import (
    EVENT_DRIVEN,
    STEPPED,
    Body,
    G,
    coefficients,
    engines,
    make_scene,
)

RADIUS = 0.05
SOLID, BETWEEN, SHELL = 1.0, 1.3, 5.0 / 3.0
factors = pytest.mark.parametrize("factor", [SOLID, BETWEEN, SHELL])


def kappa(factor: float) -> float:
    return 0.4 * factor


def sphere(factor: float, position, velocity=(0, 0, 0), spin=(0, 0, 0)) -> Body:
    properties = {"inertia_factor": factor}
    return Body(Sphere(RADIUS), position, velocity=velocity, spin=spin, air=properties)


@factors
@engines(EVENT_DRIVEN, STEPPED)
def test_speed_at_which_a_sliding_sphere_comes_to_roll(engine, factor):
    # Friction keeps the angular momentum about a point of the floor: m r v0 = (m r² + I) v / r,
    # so v = v0 / (1 + κ), 5/7 v0 of a solid sphere and 3/5 v0 of a thin shell, whatever μ.
    # It is reached after t = v0 κ / ((1 + κ) μ g).
    v0, mu, k = 1.4, 0.3, kappa(factor)
    onset = v0 * k / ((1.0 + k) * mu * G)
    scene = make_scene(sphere(factor, (0, 0, RADIUS), velocity=(v0, 0, 0)))
    motion = engine.motion(scene, coefficients(mu), onset + 0.1)
    assert motion.velocity[0, 0] == pytest.approx(v0 / (1.0 + k), abs=1e-8)
    assert motion.spin[0, 1] == pytest.approx(v0 / (1.0 + k) / RADIUS, abs=1e-6)
    # Before that it slides: v = v0 - μ g t.
    sliding = engine.motion(scene, coefficients(mu), 0.4 * onset)
    t = 0.4 * onset + 0.005
    assert sliding.velocity[0, 0] == pytest.approx(v0 - mu * G * t, abs=1e-8)


@factors
@engines(EVENT_DRIVEN, STEPPED)
def test_acceleration_down_an_incline(engine, factor):
    # Rolling without slip: a = g (sin θ - μ_r cos θ) / (1 + κ).
    angle, mu_r, k = 0.25, 0.01, kappa(factor)
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    scene = make_scene(sphere(factor, RADIUS * normal), planes=[(*normal, 0.0)])
    t = 0.6
    moved = engine.path(scene, coefficients(0.8, mu_r=mu_r), [t])[0, 0] - RADIUS * normal
    a = G * (np.sin(angle) - mu_r * np.cos(angle)) / (1.0 + k)
    down = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    assert moved @ down == pytest.approx(0.5 * a * t * t, abs=1e-7)


@factors
@engines(EVENT_DRIVEN, STEPPED)
def test_steepest_incline_on_which_friction_holds_the_roll(engine, factor):
    # Rolling takes the friction κ / (1 + κ) g sin θ ≤ μ_s g cos θ; beyond it slides with
    # a = g (sin θ - μ_d cos θ).
    mu, t, k = 0.2, 0.5, kappa(factor)
    for share in (0.97, 1.03):
        angle = np.arctan(share * mu * (1.0 + k) / k)
        normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
        scene = make_scene(sphere(factor, RADIUS * normal), planes=[(*normal, 0.0)])
        moved = engine.path(scene, coefficients(mu), [t])[0, 0] - RADIUS * normal
        rolls = G * np.sin(angle) / (1.0 + k)
        slides = G * (np.sin(angle) - mu * np.cos(angle))
        a = rolls if share < 1.0 else slides
        down = np.array([np.cos(angle), 0.0, -np.sin(angle)])
        assert moved @ down == pytest.approx(0.5 * a * t * t, abs=1e-5)


@factors
@engines(EVENT_DRIVEN, STEPPED)
def test_impact_that_ends_the_slip(engine, factor):
    # The contact feels the mass m κ / (1 + κ): sticking leaves v = v0 / (1 + κ) without spin
    # before, and ω = v / r.
    k, fall, speed = kappa(factor), 0.2, 0.5
    scene = make_scene(sphere(factor, (0, 0, RADIUS + fall), velocity=(speed, 0, 0)))
    hit = np.sqrt(2.0 * fall / G)
    after = engine.motion(scene, coefficients(0.9, e=0.6), hit + 0.05)
    assert after.velocity[0, 0] == pytest.approx(speed / (1.0 + k), abs=1e-6)
    assert after.spin[0, 1] == pytest.approx(speed / (1.0 + k) / RADIUS, abs=1e-4)


@engines(EVENT_DRIVEN, STEPPED)
def test_impact_of_two_spheres_of_different_inertia(engine):
    # Slip s between the two is ended by J = s / Σ (1 + 1/κ_i) / m_i where friction suffices, and
    # each gets the velocity J / m_i. Head on along x without gravity, both spinning about z.
    spin, k = 30.0, (kappa(SOLID), kappa(SHELL))
    one = sphere(SOLID, (-0.1, 0, 0), velocity=(1.0, 0, 0), spin=(0, 0, spin))
    other = sphere(SHELL, (0.1, 0, 0), velocity=(-1.0, 0, 0), spin=(0, 0, 0))
    scene = make_scene(one, other, planes=(), gravity=(0, 0, 0))
    theta = coefficients(2.0, e=1.0)
    push = spin * RADIUS / (2.0 + 1.0 / k[0] + 1.0 / k[1])
    after = engine.motion(scene, theta, 0.1)
    assert abs(after.velocity[0, 1]) == pytest.approx(push, rel=1e-6)
    assert after.velocity[0, 1] == pytest.approx(-after.velocity[1, 1], rel=1e-9)


@factors
def test_both_engines_agree(factor):
    # A spinning sphere that falls, bounces, slides and rolls out.
    scene = make_scene(
        sphere(factor, (0, 0, 0.2), velocity=(0.8, 0.3, 0), spin=(5.0, -12.0, 8.0)),
    )
    theta = coefficients(0.3, mu_r=0.02, e=0.4)
    times = np.linspace(0.0, 1.5, 31)
    exact, stepped = (engine.path(scene, theta, times)[0] for engine in (EVENT_DRIVEN, STEPPED))
    assert np.abs(exact - stepped).max() < 2e-3


def test_both_engines_agree_where_spheres_lie_on_each_other():
    # Contacts that press together, which both engines solve by sweeps: a shell in the groove of
    # two planes rolls down it.
    planes = [(0.0, 0.6, 0.8, 0.0), (0.0, -0.6, 0.8, 0.0)]
    gravity = (1.2, 0.0, -9.7)
    # Both contacts are r cos β from the axis of rolling, cos β = 0.8: a = g_x / (1 + κ / cos² β).
    k, t = kappa(SHELL), 0.5
    scene = make_scene(sphere(SHELL, (0, 0, RADIUS / 0.8)), planes=planes, gravity=gravity)
    exact = 0.5 * gravity[0] / (1.0 + k / 0.64) * t * t
    for engine in (EVENT_DRIVEN, STEPPED):
        assert engine.path(scene, coefficients(0.9), [t])[0, 0, 0] == pytest.approx(exact, rel=2e-3)


def test_a_hollow_sphere_is_read_back():
    thing = SceneObject("shell", "body", Sphere(RADIUS), inertia_factor=SHELL)
    assert SceneObject.from_dict(thing.to_dict()) == thing
