"""Noise at impacts, by the laws that a ball's bounces then obey."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnsupportedSceneError
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import make_simulator, pack_worlds
from intuitive_physics.simulation.contact_noise import ContactNoise

from .laws_scenes import Body, G, coefficients, make_scene

R, HEIGHT = 0.05, 1.0
FALL = np.sqrt(2 * HEIGHT / G)
"""s until a ball dropped from HEIGHT hits the floor."""
SPEED = G * FALL
COUNT = 2000

noisy_engines = pytest.mark.parametrize("engine", ["event_driven", "stepped"])


def worlds_of(theta, noise, count=COUNT, seed=3, body=None):
    """One body above a floor, so many times, each with noise of its own."""
    scene = make_scene(body or Body(Sphere(R), (0, 0, HEIGHT + R)))
    one = pack_worlds([scene], theta)
    many = one.taken(np.zeros(count, dtype=np.int64))
    return many.with_contact_noise(noise, np.random.default_rng(seed))


def positions_of(engine, worlds, times, threads=1):
    rollout = make_simulator(engine, threads).rollout_batch(worlds, times, orientations=False)
    assert (rollout.status == 0).all()
    return rollout.positions[:, 0]


def rebound_speeds(engine, worlds, bounces):
    """Upward speeds after the first bounces, (count, bounces), from heights in flight.

    From the impact at t_k on the height is v_k τ - g τ²/2, and t_{k+1} = t_k + 2 v_k / g.
    """
    speeds, hit = [], np.full(worlds.size, FALL)
    for _ in range(bounces):
        tau = 0.05
        z = positions_of(engine, worlds, hit[:, None] + tau)[:, 0, 2] - R
        speeds.append(z / tau + 0.5 * G * tau)
        hit = hit + 2 * speeds[-1] / G
    return np.stack(speeds, axis=1)


@noisy_engines
def test_rebound_speeds_have_the_mean_and_the_variance_of_the_restitution(engine):
    # v' = (e + σ z) v: mean e v, variance σ² v². Both estimates are normal for large N, with
    # standard deviations σ v / √N and √(2/N) σ² v²: 4.5 of them are passed once in 10⁵ seeds.
    e, deviation = 0.6, 0.04
    worlds = worlds_of(coefficients(e=e), ContactNoise(restitution=deviation))
    got = rebound_speeds(engine, worlds, 1)[:, 0] / SPEED
    assert abs(got.mean() - e) < 4.5 * deviation / np.sqrt(COUNT)
    assert abs(got.var() - deviation**2) < 4.5 * np.sqrt(2 / COUNT) * deviation**2


@noisy_engines
def test_two_bounces_have_independent_noise(engine):
    # e_k = v_k / v_{k-1}. The correlation of N independent pairs has standard deviation 1 / √N.
    deviation = 0.04
    worlds = worlds_of(coefficients(e=0.6), ContactNoise(restitution=deviation))
    speeds = rebound_speeds(engine, worlds, 2)
    first, second = speeds[:, 0] / SPEED, speeds[:, 1] / speeds[:, 0]
    assert abs(np.corrcoef(first, second)[0, 1]) < 4.5 / np.sqrt(COUNT)
    assert abs(second.std() / deviation - 1) < 4.5 / np.sqrt(2 * COUNT)


@noisy_engines
def test_a_tilted_normal_turns_the_rebound_and_keeps_its_energy(engine):
    # Without friction v' = v - (1 + e) (v·n) n. With e = 1 the speed is kept, and the slope of n
    # is σ z along each horizontal axis, of which v' has 2 v σ z: to second order in σ.
    deviation = 0.02
    worlds = worlds_of(coefficients(e=1.0, mu=0.0), ContactNoise(tilt=deviation))
    t = FALL + np.array([0.1, 0.15])
    x = positions_of(engine, worlds, t)
    velocity = (x[:, 1] - x[:, 0]) / 0.05
    velocity[:, 2] += G * (t.mean() - FALL)
    speeds = np.linalg.norm(velocity, axis=1)
    # stepped sweeps until a velocity changes by less than 1e-5 m/s.
    np.testing.assert_allclose(speeds, SPEED, rtol=1e-5)
    for axis in (0, 1):
        slopes = velocity[:, axis] / (2 * SPEED)
        assert abs(slopes.mean()) < 4.5 * deviation / np.sqrt(COUNT)
        assert abs(slopes.std() / deviation - 1) < 4.5 / np.sqrt(2 * COUNT) + 10 * deviation**2
    assert abs(np.corrcoef(velocity[:, 0], velocity[:, 1])[0, 1]) < 4.5 / np.sqrt(COUNT)


@pytest.mark.parametrize(
    ("engine", "shape"),
    [
        ("event_driven", Sphere(R)),
        ("stepped", Sphere(R)),
        ("stepped", Box((0.1, 0.06, 0.04))),
        ("stepped", Capsule(0.03, 0.1)),
    ],
    ids=str,
)
def test_no_impact_adds_energy(engine, shape):
    # m g z + m v²/2 at the peaks is never above that at the start: z stays below its first value,
    # however large the noise. A box that lies may be lifted by what parts its overlap, 2e-5 m.
    worlds = worlds_of(
        coefficients(e=0.95, mu=0.3, mu_s=0.4),
        ContactNoise(restitution=0.5, tilt=0.3),
        count=40,
        body=Body(shape, (0, 0, 0.5)),
    )
    heights = positions_of(engine, worlds, np.arange(0, 3, 0.02))[..., 2]
    assert heights.max() <= 0.5 + 1e-4
    assert heights.std(axis=0).max() > 0.02


@noisy_engines
def test_friction_stays_in_its_cone(engine):
    # A ball that is not spinning and slides through the impact: with the normal n tilted by at
    # most some σ, J_t = μ J_n about n, so that the impulse leaves the floor's normal by no more
    # than atan μ and the tilt. Without a tilt it is μ itself, whatever the restitution is.
    mu, speed = 0.1, 6.0
    body = Body(Sphere(R), (0, 0, HEIGHT + R), velocity=(speed, 0, 0))
    theta = coefficients(e=0.6, mu=mu)
    worlds = worlds_of(theta, ContactNoise(restitution=0.1), count=200, body=body)
    t = FALL + np.array([0.1, 0.15])
    x = positions_of(engine, worlds, t)
    velocity = (x[:, 1] - x[:, 0]) / 0.05
    normal = velocity[:, 2] + G * (t.mean() - FALL) + SPEED
    np.testing.assert_allclose((speed - velocity[:, 0]) / normal, mu, rtol=1e-4)


@noisy_engines
def test_what_rests_stays_where_it_is(engine):
    body = Body(Sphere(R), (0, 0, R))
    worlds = worlds_of(coefficients(), ContactNoise(0.3, 0.3), count=5, body=body)
    last = positions_of(engine, worlds, [0.0, 5.0])[:, 1]
    np.testing.assert_allclose(last, np.tile([0, 0, R], (5, 1)), atol=1e-4)


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.integers(2, 6), st.sampled_from(["event_driven", "stepped"]))
def test_the_same_seed_is_the_same_answer_alone_and_in_threads(seed, threads, engine):
    # To the bit, for any seed; another seed gives another answer.
    noise, times = ContactNoise(0.1, 0.1), np.arange(0, 1.5, 0.1)
    worlds = worlds_of(coefficients(e=0.7), noise, count=150, seed=seed)
    whole = positions_of(engine, worlds, times)
    np.testing.assert_array_equal(whole, positions_of(engine, worlds, times, threads))
    alone = worlds.taken(np.array([77]))
    np.testing.assert_array_equal(whole[77:78], positions_of(engine, alone, times))
    other = worlds_of(coefficients(e=0.7), noise, count=150, seed=seed + 1)
    assert (whole[:, -1] != positions_of(engine, other, times)[:, -1]).any()


def test_an_engine_that_cannot_refuses():
    worlds = worlds_of(coefficients(), ContactNoise(restitution=0.1), count=2)
    with pytest.raises(UnsupportedSceneError, match="noisy, which bullet cannot simulate"):
        make_simulator("bullet").rollout_batch(worlds, [0.0, 0.1])


@pytest.mark.parametrize("values", [{"restitution": -0.1}, {"tilt": 0.6}, {"tilt": np.nan}])
def test_noise_that_cannot_be_is_refused(values):
    with pytest.raises(InvalidInputError, match="contact noise"):
        ContactNoise(**values)
