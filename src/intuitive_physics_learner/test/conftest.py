"""A store, an engine simple enough to check by hand, thrown balls."""

import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import Rollout, Simulator, WorldStatus, make_simulator
from intuitive_physics.simulation.rigid_bodies.world import MOST_PLANES
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ObservationStore, TrajectoryCost

from .cases import task_of


class GlideSimulator(Simulator):
    """Objects glide straight, slowed by the restitution e of their pair with the floor.

    x(t) = x(0) + f(e) v t, f(e) = e unless given; where e > 0.99 a world fails half-way. Density
    and friction do nothing.
    """

    name = "glide"

    def __init__(self, effect=lambda e: e):
        self._effect = effect

    def _rollout(self, worlds, times, orientations):
        floors = worlds.plane_materials[worlds.environment_index, 0]
        sets = worlds.parameter_index[:, None]
        e = worlds.coefficients[sets, 3, worlds.object_materials, floors[:, None]]
        factor = self._effect(e)
        v, x = worlds.states[..., 7:10], worlds.states[..., 0:3]
        t = np.broadcast_to(times, (worlds.size, times.shape[1]))
        positions = x[:, :, None] + factor[..., None, None] * v[:, :, None] * t[:, None, :, None]
        failed = (e > 0.99).any(axis=1)
        positions[failed, :, times.shape[1] // 2 :] = np.nan
        status = np.where(failed, WorldStatus.TOO_MANY_EVENTS, WorldStatus.OK)
        turns = np.repeat(worlds.states[:, :, None, 3:7], times.shape[1], axis=2)
        return Rollout(positions, turns if orientations else None, status)


class FoldedGlideSimulator(GlideSimulator):
    """Objects glide as fast for one of two restitutions, and bend a little more for the larger.

    A scan meets the true one.
    """

    wrong, true, bend = 0.7, 0.38, 0.02

    def __init__(self):
        super().__init__(lambda e: 0.8 + 0.5 * (e - self.wrong) * (e - self.true))

    def _rollout(self, worlds, times, orientations):
        rollout = super()._rollout(worlds, times, orientations)
        floors = worlds.plane_materials[worlds.environment_index, 0]
        sets = worlds.parameter_index[:, None]
        e = worlds.coefficients[sets, 3, worlds.object_materials, floors[:, None]]
        rollout.positions[..., 2] += self.bend * e[..., None] * np.asarray(times)[:, None] ** 2
        return rollout


@pytest.fixture
def path(tmp_path):
    """Path of a database that does not exist yet, nor its folder."""
    return tmp_path / "new" / "folder" / "learner.sqlite3"


@pytest.fixture
def store(path):
    with ObservationStore(path) as opened:
        yield opened


@pytest.fixture
def rewrite(path):
    """Make a function that executes a statement on the database, as another program would."""

    def execute(sql, *values):
        with closing(sqlite3.connect(path)) as file, file:
            file.execute(sql, values)

    return execute


FLOOR = Environment([Plane("floor", "floor", [0, 0, 1], 0.0)])


@pytest.fixture(scope="session")
def glide():
    return GlideSimulator()


@pytest.fixture(scope="session")
def folded_glide():
    return FoldedGlideSimulator()


@pytest.fixture(scope="session")
def folded(folded_glide):
    """Make observations of that glide, with noise and with noisy initial positions."""

    def make(generator):
        ball = SceneObject("ball", "ball", Sphere(0.05))
        position, velocity = [0.0, 0.0, 1.0], generator.normal(size=3)
        covariance = np.diag(np.repeat([1.0, 0.0, 0.0, 0.0], 3)) * 0.002**2
        state = ObjectState(position, linear_velocity=velocity, covariance=covariance)
        times = 0.04 * np.arange(1, 13)
        true = StaticParameters.uniform(("ball", "floor"), restitution=folded_glide.true)
        scene = Scene(FLOOR, (ball,), (state,))
        (positions,) = folded_glide.rollout([scene], true, times).positions[0]
        track = Trajectory(times, positions + generator.normal(0.0, 0.002, positions.shape))
        return Observation(FLOOR, (ObservedObject(ball, track, state),), 0.0)

    return make


@pytest.fixture(scope="session")
def event_driven():
    return make_simulator("event_driven")


@pytest.fixture(scope="session")
def glides():
    """Make an observation in which objects of given materials glided with restitution e."""

    def make(generator, e, counts=(10,), materials=("ball",), start=0.0, id=None):
        objects = []
        for j, (count, material) in enumerate(zip(counts, materials, strict=True)):
            thing = SceneObject(f"object {j}", material, Sphere(0.05))
            state = ObjectState(generator.normal(size=3), linear_velocity=generator.normal(size=3))
            times = np.cumsum(generator.uniform(0.01, 0.1, count))
            positions = state.position + e * times[:, None] * state.linear_velocity
            objects.append(ObservedObject(thing, Trajectory(start + times, positions), state))
        given = {} if id is None else {"id": id}
        return Observation(FLOOR, tuple(objects), start, **given)

    return make


@pytest.fixture(scope="session")
def gliding_task():
    """Make a task to learn e from one ball for each given e, x(t) = x(0) + f(e) v t.

    Initial velocities are known exactly. A task has four active parameters, of which only e, the
    last, has an effect; it begins at e = 0.5. Points are 0.04 s apart.
    """

    def make(restitutions, effect=lambda e: e, position_deviation=0.0, noise=0.0, count=12):
        generator = np.random.default_rng(0)
        ball = SceneObject("ball", "ball", Sphere(0.05))
        times = 0.04 * np.arange(1, count + 1)
        covariance = np.diag(np.repeat([1.0, 0.0, 0.0, 0.0], 3)) * position_deviation**2
        observed = []
        for e in restitutions:
            position, velocity = generator.normal(size=(2, 3))
            state = ObjectState(position, linear_velocity=velocity, covariance=covariance)
            positions = position + effect(np.array(e)) * times[:, None] * velocity
            positions += generator.normal(0.0, noise, positions.shape)
            track = ObservedObject(ball, Trajectory(times, positions), state)
            observed.append(Observation(FLOOR, (track,), 0.0))
        cost = TrajectoryCost(observed, GlideSimulator(effect))
        return task_of(cost, StaticParameters.uniform(cost.materials, restitution=0.5))

    return make


@pytest.fixture(scope="session")
def boxed(glides):
    """Observe a box among more planes than the engines can step, of which the last is bounded."""
    observation = glides(np.random.default_rng(0), 0.5, id="boxed")
    (ball,) = observation.objects
    box = SceneObject("box", "ball", Box((0.1, 0.2, 0.3)))
    square = np.array([[-1.0, -1, -9], [1, -1, -9], [1, 1, -9], [-1, 1, -9]])
    planes = [Plane(f"floor {k}", "floor", [0, 0, 1], -1.0 - k) for k in range(MOST_PLANES)]
    planes.append(Plane("sheet", "floor", [0, 0, 1], -9.0, boundary=square))
    return replace(
        observation,
        environment=Environment([*FLOOR.planes, *planes]),
        objects=(ObservedObject(box, ball.trajectory, ball.initial_state),),
    )


TRUE_PARAMETERS = StaticParameters.uniform(["ball", "floor"]).with_pair(
    "ball",
    "floor",
    static_friction=0.35,
    dynamic_friction=0.2,
    rolling_friction=0.02,
    restitution=0.7,
)


@pytest.fixture(scope="session")
def true_parameters():
    return TRUE_PARAMETERS


@pytest.fixture(scope="session")
def throws(event_driven):
    """Observe balls thrown on a floor so flat that they slide on it for a while."""

    def make(count, seed, noise=0.0, state_noise=0.0, times=60):
        generator = np.random.default_rng(seed)
        return [_throw(event_driven, generator, noise, state_noise, times) for _ in range(count)]

    return make


def _throw(simulator, generator, noise, state_noise, count):
    ball = SceneObject("ball", "ball", Sphere(0.05))
    position = [0.0, 0.0, generator.uniform(0.3, 0.8)]
    velocity = [*generator.uniform(2.0, 5.0, 2), generator.uniform(-0.5, 0.5)]
    state = ObjectState(position, linear_velocity=velocity)
    times = np.arange(count) / 30.0
    rollout = simulator.rollout([Scene(FLOOR, (ball,), (state,))], TRUE_PARAMETERS, times)
    points = rollout.positions[0, 0] + generator.normal(0.0, noise, (count, 3))
    covariance = np.diag(np.repeat([1.0, 0.0, 25.0, 0.0], 3)) * state_noise**2
    believed = ObjectState(
        position + generator.normal(0.0, state_noise, 3),
        linear_velocity=velocity + generator.normal(0.0, 5.0 * state_noise, 3),
        covariance=covariance,
    )
    return Observation(FLOOR, (ObservedObject(ball, Trajectory(times, points), believed),), 0.0)
