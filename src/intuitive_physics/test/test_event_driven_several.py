"""Several spheres, and what must hold for any scene."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError, UnsupportedSceneError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import WorldStatus, make_simulator, pack_worlds
from intuitive_physics.simulation.event_driven import EventDrivenSimulator
from intuitive_physics.state import ObjectState

G = 9.81
R = 0.05
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ROOM = [(0, 0, 1, 0), (1, 0, 0, -1), (-1, 0, 0, -1), (0, 1, 0, -1), (0, -1, 0, -1)]


@given(
    ratio=st.floats(0.3, 3.0),
    e=st.floats(0.0, 1.0),
    offset=st.floats(-0.8, 0.8),
    closing=st.floats(0.5, 5.0),
)
@settings(max_examples=100, deadline=None)
def test_collision_without_friction(world, ratio, e, offset, closing):
    # In free fall without friction: momentum is kept and the normal relative velocity becomes -e
    # times what it was: v1' = v1 + (1 + e) m2 / (m1 + m2) (v2 - v1)·n n.
    if e * closing * np.sqrt(1 - offset**2) < 6e-3:
        return
    r1, r2 = R, R * ratio
    reach = r1 + r2
    start = np.array([-0.5, offset * reach, 0.0])
    scene = world.scene((r1, (0, 0, 0)), (r2, start, UPRIGHT, (closing, 0, 0)), gravity=(0, 0, 0))
    scene = Scene(Environment([], gravity=(0, 0, 0)), scene.objects, scene.states)
    contact = np.array([-reach * np.sqrt(1 - offset**2), offset * reach, 0.0])
    t_hit = (contact[0] - start[0]) / closing
    after = world.path(
        scene,
        world.parameters(between={"static_friction": 0, "dynamic_friction": 0, "restitution": e}),
        [t_hit + 0.1, t_hit + 0.3],
    )
    v1, v2 = (after[:, 1] - after[:, 0]) / 0.2
    m1, m2 = r1**3, r2**3
    n = -contact / reach
    v = np.array([closing, 0, 0])
    np.testing.assert_allclose(v1, (1 + e) * m2 / (m1 + m2) * (v @ n) * n, atol=1e-9)
    np.testing.assert_allclose(v2, v - (1 + e) * m1 / (m1 + m2) * (v @ n) * n, atol=1e-9)


def free_collision(world, seed, mu):
    """Velocities and spins before and after two spinning spheres collide in free space."""
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.03, 0.1, 2)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    starts = np.array([np.zeros(3), direction * (radii.sum() + 0.2)])
    velocities = np.array([np.zeros(3), -2.0 * direction + rng.normal(size=3) * 0.3])
    spins = rng.normal(size=(2, 3)) * 5.0
    scene = world.scene(
        *[(radii[k], starts[k], UPRIGHT, velocities[k], spins[k]) for k in range(2)]
    )
    scene = Scene(Environment([], gravity=(0, 0, 0)), scene.objects, scene.states)
    theta = world.parameters(
        between={"static_friction": mu, "dynamic_friction": mu, "restitution": 0.8}
    )
    times = np.array([0.5, 0.5 + 1e-3])
    rollout = world.roll(scene, theta, times)
    after = np.diff(rollout.positions[0], axis=1)[:, 0] / 1e-3
    turned = [rotation_between(q[0], q[1]) / 1e-3 for q in rollout.orientations[0]]
    masses = radii**3
    return radii, masses, starts, velocities, spins, rollout.positions[0][:, 0], after, turned


def rotation_between(a, b):
    """Rotation vector that turns orientation a into b, in the world's axes."""
    ax, ay, az, aw = -a[0], -a[1], -a[2], a[3]
    bx, by, bz, bw = b
    v = np.array(
        [
            bw * ax + bx * aw + by * az - bz * ay,
            bw * ay - bx * az + by * aw + bz * ax,
            bw * az + bx * ay - by * ax + bz * aw,
        ]
    )
    w = bw * aw - bx * ax - by * ay - bz * az
    angle = 2 * np.arctan2(np.linalg.norm(v), w)
    return v / np.linalg.norm(v) * angle


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("mu", [0.05, 1.0])
def test_momentum_is_kept_in_free_collisions(world, seed, mu):
    # Linear: Σ m v. Angular about the origin: Σ (x × m v + 2/5 m r² ω).
    radii, masses, x0, v0, w0, x1, v1, w1 = free_collision(world, seed, mu)
    np.testing.assert_allclose(masses @ v1, masses @ v0, atol=1e-10)

    def angular(x, v, w):
        return sum(
            np.cross(x[k], masses[k] * v[k]) + 0.4 * masses[k] * radii[k] ** 2 * np.asarray(w[k])
            for k in range(2)
        )

    np.testing.assert_allclose(angular(x1, v1, w1), angular(x0, v0, w0), atol=1e-9 * masses.sum())


def test_newtons_cradle(world):
    # Equal frictionless balls at e = 1 in a row: the last takes the whole velocity.
    balls = [(R, (0.2 + 2 * R * k, 0, R)) for k in range(4)]
    scene = world.scene((R, (0, 0, R), UPRIGHT, (1.0, 0, 0)), *balls)
    path = world.path(scene, world.parameters(0.0, 0.0, e=1.0), [0.2, 1.2])
    moved = (path[:, 1] - path[:, 0])[:, 0]
    np.testing.assert_allclose(moved, [0, 0, 0, 0, 1.0], atol=1e-9)


def test_ball_falls_off_a_ball(world):
    # A ball balanced on another stays only without any push; slightly beside, it must come down.
    scene = world.scene((R, (0, 0, R)), (R, (0.004, 0, 3 * R - 0.0001)))
    path = world.path(scene, world.parameters(e=0.1, mu_r=0.02), [5.0])[:, 0]
    np.testing.assert_allclose(path[:, 2], R, atol=1e-6)
    assert np.linalg.norm(path[0] - path[1]) >= 2 * R - 1e-6


@pytest.mark.parametrize("seed", [3, 5, 9])
def test_pile_of_balls_comes_to_rest_without_overlap(world, seed):
    rng = np.random.default_rng(seed)
    balls = [(R, (*rng.uniform(-0.06, 0.06, 2), 0.1 + 0.12 * k)) for k in range(8)]
    tray = [(0, 0, 1, 0), (1, 0, 0, -0.12), (-1, 0, 0, -0.12), (0, 1, 0, -0.12), (0, -1, 0, -0.12)]
    scene = world.scene(*balls, planes=tray)
    path = world.path(scene, world.parameters(e=0.2, mu_r=0.05), [8.0, 10.0])
    ends = path[:, 1]
    assert np.linalg.norm(path[:, 1] - path[:, 0], axis=1).max() < 2e-3
    gaps = np.linalg.norm(ends[:, None] - ends[None], axis=2)[np.triu_indices(8, 1)] - 2 * R
    assert gaps.min() > -1e-4
    assert ends[:, 2].min() > R - 1e-6


def energies(theta, scene, rollout, times):
    """Upper bound on energy change: total energy at each output time, from finite differences."""
    h = times[1] - times[0]
    mass = np.array([thing.shape.mass(theta.density[0]) for thing in scene.objects])
    positions = rollout.positions[0]
    velocity = np.diff(positions, axis=1) / h
    height = 0.5 * (positions[:, 1:, 2] + positions[:, :-1, 2])
    return (mass[:, None] * (0.5 * (velocity**2).sum(-1) + G * height)).sum(0)


@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 5),
    e=st.floats(0, 1),
    mu=st.floats(0, 1),
    tilt=st.sampled_from([0.0, 0.0, 0.05, 0.2]),
)
@settings(max_examples=300, deadline=None)
def test_energy_never_grows(world, seed, n, e, mu, tilt):
    # E = Σ m v²/2 + I ω²/2 + m g z. A chord's speed never exceeds the mean speed along it, and the
    # rotational energy is left out, so the bound is: translational energy ≤ E(0).
    rng = np.random.default_rng(seed)
    balls = []
    for k in range(n):
        r = rng.uniform(0.03, 0.12)
        at = (-0.75 + 0.36 * k, rng.uniform(-0.5, 0.5), 0.2 + r + rng.uniform(0, 0.5))
        balls.append((r, at, UPRIGHT, rng.normal(size=3) * 2, rng.normal(size=3) * 10))
    planes = np.array([(np.sin(tilt), 0, np.cos(tilt), 0), *ROOM[1:]])
    scene = world.scene(*balls, planes=planes)
    theta = world.parameters(mu_s=mu, mu_d=0.8 * mu, mu_r=0.02, e=e)
    times = np.arange(0, 3, 2e-3)
    rollout = world.roll(scene, theta, times)
    mass = np.array([thing.shape.mass(theta.density[0]) for thing in scene.objects])
    start = sum(
        m
        * (
            0.5 * s.linear_velocity @ s.linear_velocity
            + 0.2 * b[0] ** 2 * s.angular_velocity @ s.angular_velocity
            + G * s.position[2]
        )
        for m, s, b in zip(mass, scene.states, balls, strict=True)
    )
    assert energies(theta, scene, rollout, times).max() <= start * (1 + 1e-6)
    # And nothing leaves the room or enters another ball, but for what a cluster's solver may leave
    # of normal velocity, 1 mm/s over its steps of 1 ms until the contact is settled again.
    x = rollout.positions[0]
    radii = np.array([b[0] for b in balls])
    gaps = x @ planes[:, :3].T - planes[:, 3] - radii[:, None, None]
    assert gaps.min() > -5e-5
    for i in range(n):
        for j in range(i):
            gap = np.linalg.norm(x[i] - x[j], axis=1) - radii[i] - radii[j]
            assert gap.min() > -1e-4


def random_scenes(seed, count):
    rng = np.random.default_rng(seed)
    floor = Environment([Plane(f"p{k}", "floor", p[:3], p[3]) for k, p in enumerate(ROOM)])
    scenes = []
    for _ in range(count):
        n = rng.integers(1, 4)
        objects = [SceneObject(f"b{k}", "ball", Sphere(rng.uniform(0.03, 0.1))) for k in range(n)]
        states = [
            ObjectState(
                (-0.6 + 0.5 * k, rng.uniform(-0.5, 0.5), rng.uniform(0.15, 0.8)),
                UPRIGHT,
                rng.normal(size=3) * 2,
                rng.normal(size=3) * 10,
            )
            for k in range(n)
        ]
        scenes.append(Scene(floor, tuple(objects), tuple(states)))
    return scenes


def test_batch_equals_its_members_for_any_thread_count(world):
    scenes = random_scenes(1, 64)
    theta = world.parameters(mu_r=0.02, e=0.7)
    times = np.linspace(0, 3, 40)
    batch = EventDrivenSimulator(threads=1).rollout(scenes, theta, times)
    threaded = EventDrivenSimulator(threads=3).rollout(scenes, theta, times)
    np.testing.assert_array_equal(batch.positions, threaded.positions)
    np.testing.assert_array_equal(batch.orientations, threaded.orientations)
    for w, scene in enumerate(scenes):
        alone = world.simulator.rollout([scene], theta, times)
        n = len(scene.objects)
        np.testing.assert_array_equal(batch.positions[w, :n], alone.positions[0])
        assert np.isnan(batch.positions[w, n:]).all()


def test_output_times_do_not_change_the_motion(world):
    scene = random_scenes(2, 1)[0]
    theta = world.parameters(mu_r=0.02, e=0.7)
    coarse = world.path(scene, theta, [1.0, 2.0, 3.0])
    fine = world.path(scene, theta, np.arange(1, 3001) / 1000)
    np.testing.assert_allclose(fine[:, [999, 1999, 2999]], coarse, atol=1e-9)


def test_crossed_and_repeated_batches(world):
    scenes = random_scenes(4, 3)
    thetas = [world.parameters(e=e) for e in (0.2, 0.8)]
    times = [0.5, 1.0]
    crossed = world.simulator.rollout_batch(pack_worlds(scenes, thetas[0]).crossed(thetas), times)
    for c, theta in enumerate(thetas):
        alone = world.simulator.rollout(scenes, theta, times)
        np.testing.assert_array_equal(crossed.positions[3 * c : 3 * c + 3], alone.positions)
    one = pack_worlds(scenes[:1], thetas[0])
    states = np.repeat(one.states, 2, axis=0)
    states[1, :, 2] += 0.1
    repeated = world.simulator.rollout_batch(one.repeated(states), times)
    first = world.simulator.rollout(scenes[:1], thetas[0], times)
    np.testing.assert_array_equal(repeated.positions[0], first.positions[0])
    assert (repeated.positions[1] != first.positions[0]).any()


def test_rows_of_times_of_different_length(world):
    scenes = random_scenes(5, 2)
    theta = world.parameters()
    rows = np.array([[0.1, 0.2, 0.3], [0.2, np.nan, np.nan]])
    rollout = world.simulator.rollout_batch(pack_worlds(scenes, theta), rows)
    first = world.simulator.rollout(scenes[:1], theta, rows[0])
    n = len(scenes[0].objects)
    np.testing.assert_array_equal(rollout.positions[0, :n], first.positions[0])
    assert np.isnan(rollout.positions[1, :, 1:]).all()


def test_event_cap_is_reported(world):
    # e = 1 between two walls a hair apart: without a cap this would take 1e7 events.
    walls = [(1, 0, 0, 0), (-1, 0, 0, -2 * R - 1e-6)]
    scene = world.scene((R, (R + 5e-7, 0, 0), UPRIGHT, (1.0, 0, 0)), planes=walls)
    rollout = EventDrivenSimulator(max_events=1000).rollout(
        [scene, *random_scenes(6, 1)], world.parameters(e=1.0), [0.0, 10.0]
    )
    assert rollout.status[0] == WorldStatus.TOO_MANY_EVENTS
    assert np.isnan(rollout.positions[0, 0, 1]).all()
    assert rollout.status[1] == WorldStatus.OK


def test_diverging_world_harms_no_other(world):
    far = world.scene((R, (0, 0, 1.0), UPRIGHT, (1e308, 1e308, -1e308), (1e308, 0, 0)))
    near = world.scene((R, (0, 0, 1.0)))
    theta = world.parameters()
    together = world.simulator.rollout([far, near], theta, [0.5, 1.0])
    alone = world.simulator.rollout([near], theta, [0.5, 1.0])
    assert together.status.tolist() == [WorldStatus.NOT_FINITE, WorldStatus.OK]
    np.testing.assert_array_equal(together.positions[1], alone.positions[0])


@pytest.mark.parametrize(
    ("times", "word"),
    [([], "empty"), ([0.0, 0.0], "increase"), ([-1.0, 1.0], "start at"), ([np.nan], "not finite")],
)
def test_bad_times_are_refused(world, times, word):
    with pytest.raises(InvalidInputError, match=word):
        world.simulator.rollout([world.scene((R, (0, 0, 1)))], world.parameters(), times)


def test_what_it_cannot_express_is_refused(world):
    box = Scene(
        Environment(), (SceneObject("b", "ball", Box((1, 1, 1))),), (ObjectState((0, 0, 0)),)
    )
    with pytest.raises(UnsupportedSceneError, match="not a sphere"):
        world.simulator.rollout([box], world.parameters(), [1.0])
    scene = world.scene((R, (0, 0, 1)))
    feather = SceneObject("f", "ball", Sphere(R), drag_coefficient=0.5)
    with pytest.raises(UnsupportedSceneError, match="stepped"):
        world.simulator.rollout(
            [Scene(scene.environment, (feather,), scene.states)], world.parameters(), [1.0]
        )
    with pytest.raises(InvalidInputError, match="no scenes"):
        world.simulator.rollout([], world.parameters(), [1.0])
    with pytest.raises(UnknownNameError, match="'ball'"):
        world.simulator.rollout([scene], StaticParameters.uniform(["cork", "floor"]), [1.0])
    with pytest.raises(UnknownNameError, match="event_driven"):
        make_simulator("ode")
