"""What must hold for any spheres among bounded planes and static boxes."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import WorldStatus
from intuitive_physics.simulation.core.engines import EventDrivenSimulator
from intuitive_physics.state import ObjectState

G = 9.81
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ROOM = [(0, 0, 1, 0), (1, 0, 0, -1), (-1, 0, 0, -1), (0, 1, 0, -1), (0, -1, 0, -1)]
TIMES = np.arange(0, 3, 2e-3)


def quaternion(rng, tilt):
    vector = np.array([*rng.normal(size=3) * tilt, 1.0])
    return vector / np.linalg.norm(vector)


def random_sheet(rng, k):
    """A regular polygon of 3 to 6 corners, tilted a little."""
    turn = rotation_matrix(quaternion(rng, 0.15))
    center = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(0.15, 0.5)])
    corners = rng.integers(3, 7)
    angles = rng.uniform(0, 6.28) + np.arange(corners) * 2 * np.pi / corners
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], 1) * rng.uniform(0.1, 0.5)
    normal = turn[:, 2]
    return Plane(f"sheet{k}", "floor", normal, normal @ center, ring @ turn.T + center)


def random_box(rng, k):
    """A box on the floor or in the air, upright or not."""
    center = np.array([*rng.uniform(-0.7, 0.7, 2), rng.uniform(0.0, 0.3)])
    tilt = rng.choice([0.0, 0.3, 1.0])
    return StaticBox(f"box{k}", "floor", center, quaternion(rng, tilt), rng.uniform(0.05, 0.5, 3))


def random_scene(rng):
    planes = [Plane(f"p{k}", "floor", p[:3], p[3]) for k, p in enumerate(ROOM)]
    planes += [random_sheet(rng, k) for k in range(rng.integers(0, 3))]
    boxes = [random_box(rng, k) for k in range(rng.integers(0, 4))]
    balls = rng.integers(1, 4)
    radii = rng.uniform(0.02, 0.1, balls)
    states = [
        ObjectState(
            (-0.6 + 0.5 * k, rng.uniform(-0.5, 0.5), rng.uniform(0.7, 1.2)),
            UPRIGHT,
            rng.normal(size=3) * 2,
            rng.normal(size=3) * 10,
        )
        for k in range(balls)
    ]
    objects = [SceneObject(f"b{k}", "ball", Sphere(r)) for k, r in enumerate(radii)]
    return Scene(Environment(planes, boxes), tuple(objects), tuple(states))


def random_parameters(rng):
    mu = rng.uniform(0, 1)
    return StaticParameters.uniform(
        ["ball", "floor"],
        static_friction=mu,
        dynamic_friction=rng.uniform(0.5, 1) * mu,
        rolling_friction=rng.choice([0.0, 0.02, 0.1]),
        restitution=rng.choice([0.0, 0.3, 0.6, 0.9, 1.0]),
    )


def gaps(scene, x):
    """Signed distance of every sphere from every plane without edge and box: (O, T) each."""
    radii = np.array([thing.shape.radius for thing in scene.objects])[:, None]
    for plane in scene.environment.planes:
        if plane.boundary is None:
            yield plane.signed_distances(x) - radii
    for solid in scene.environment.boxes:
        local = np.abs((x - solid.center) @ rotation_matrix(solid.orientation))
        beyond = local - 0.5 * solid.edge_lengths
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        yield outside + np.minimum(beyond.max(-1), 0.0) - radii
    for i in range(len(x)):
        for j in range(i):
            yield np.linalg.norm(x[i] - x[j], axis=1) - radii[i] - radii[j]


def check_laws(scene, theta, positions):
    # Σ m v²/2 + I ω²/2 + m g z never grows. The speed along a chord never exceeds the mean speed
    # on it, and the turning is left out later on, so what is compared is a lower bound.
    mass = np.array([thing.shape.mass(theta.density[0]) for thing in scene.objects])
    radius = np.array([thing.shape.radius for thing in scene.objects])
    v0 = np.array([s.linear_velocity for s in scene.states])
    w0 = np.array([s.angular_velocity for s in scene.states])
    z0 = np.array([s.position[2] for s in scene.states])
    moving = 0.5 * (v0**2).sum(1) + 0.2 * radius**2 * (w0**2).sum(1)
    start = (mass * (moving + G * z0)).sum()
    velocity = np.diff(positions, axis=1) / np.diff(TIMES)[:, None]
    height = 0.5 * (positions[:, 1:, 2] + positions[:, :-1, 2])
    energy = (mass[:, None] * (0.5 * (velocity**2).sum(-1) + G * height)).sum(0)
    assert energy.max() <= start * (1 + 1e-5)
    # What a cluster's solver may leave of normal velocity, 1 mm/s, over its steps of 1 ms, and what
    # goes round a ball or an edge in such a step.
    for gap in gaps(scene, positions):
        assert gap.min() > -1e-4


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=200)
def test_energy_never_grows_and_nothing_enters_anything(seed):
    rng = np.random.default_rng(seed)
    scene, theta = random_scene(rng), random_parameters(rng)
    rollout = EventDrivenSimulator().rollout([scene], theta, TIMES, orientations=False)
    assert rollout.status[0] == WorldStatus.OK
    check_laws(scene, theta, rollout.positions[0])
