"""Bad input is refused with what was got and what was expected, before anything is simulated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import (
    IntuitivePhysicsError,
    InvalidInputError,
    UnknownNameError,
    UnsupportedSceneError,
)
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation import make_simulator, pack_worlds
from intuitive_physics.state import ObjectState

from .laws_scenes import (
    BULLET,
    EVENT_DRIVEN,
    LYING_ALONG_X,
    STEPPED,
    UPRIGHT,
    Body,
    coefficients,
    engines,
    make_scene,
    quaternion,
)

NAN, INF = float("nan"), float("inf")
BALL = Body(Sphere(0.05), (0, 0, 1.0))


@pytest.mark.parametrize(
    ("make", "got"),
    [
        (lambda: ObjectState((0, 0, 0), (0, 0, 0, 2.0)), "norm 2"),
        (lambda: ObjectState((0, 0, 0), (0, 0, 0, 0)), "norm 0"),
        (lambda: ObjectState((0, 0, NAN)), "not finite"),
        (lambda: ObjectState((0, 0)), r"shape \(2,\)"),
        (lambda: ObjectState((0, 0, 0), UPRIGHT, (INF, 0, 0)), "not finite"),
        (lambda: ObjectState((0, 0, 0), covariance=-np.eye(12)), "eigenvalue"),
        (lambda: ObjectState((0, 0, 0), covariance=np.triu(np.ones((12, 12)))), "symmetric"),
        (lambda: Plane("", "ground", (0, 0, 1), 0.0), "plane id"),
        (lambda: Plane("p", "ground", (0, 0, 0), 0.0), "direction"),
        (lambda: Plane("p", "ground", (0, 0, 1), 0.0, [(0, 0, 0)]), "corners"),
        (lambda: StaticBox("b", "ground", (0, 0, 0), UPRIGHT, (1, 0, 1)), "above zero"),
        (lambda: StaticBox("b", "ground", (0, 0, 0), (1, 1, 0, 0), (1, 1, 1)), "norm 1.41421"),
        (lambda: SceneObject("o", "body", Sphere(1.0), drag_coefficient=-1.0), "is -1"),
        (lambda: SceneObject("o", "body", Sphere(1.0), magnus_coefficient=NAN), "nan"),
        (lambda: SceneObject("o", "body", Box((1, 1, 1)), inertia_factor=0.0), "above zero"),
        (lambda: SceneObject("o", "body", Sphere(1.0), inertia_factor=1.7), "at most 5/3"),
        (lambda: SceneObject("o", "body", Sphere(1.0), mass_centre=(0, 0, 0.1)), "0 for a sphere"),
        (lambda: SceneObject("o", "body", Box((1, 1, 1)), mass_centre=(0, 0, 0.6)), "inside"),
        (lambda: SceneObject("o", "body", Capsule(0.1, 1.0), mass_centre=(0, 0, NAN)), "not fin"),
        (lambda: SceneObject("o", "", Sphere(1.0)), "''"),
        (lambda: SceneObject("o", "body", "ball"), "'ball'"),
        (lambda: Environment([], air_density=-1.2), "is -1.2"),
        (lambda: Environment([], gravity=(0, 0, NAN)), "not finite"),
        (lambda: Scene(Environment(), (), ()), "no objects"),
        (lambda: Scene(Environment(), (SceneObject("o", "body", Sphere(1)),), ()), "one state"),
        (lambda: make_scene(BALL, planes=[Plane("body", "ground", (0, 0, 1), 0)] * 2), "each once"),
    ],
)
def test_bad_values_are_refused_where_they_are_given(make, got):
    with pytest.raises(InvalidInputError, match=got) as refusal:
        make()
    assert "expected" in str(refusal.value)


@pytest.mark.parametrize(
    ("times", "got"),
    [
        ([], "empty"),
        ([0.5, 0.5], "goes from 0.5 to 0.5"),
        ([0.5, 0.4], "goes from 0.5 to 0.4"),
        ([-0.1, 1.0], "start at -0.1"),
        ([NAN], "not finite"),
        ([0.0, INF], "not finite"),
        ([[0.1, 0.2]] * 2, r"shape \(2, 2\)"),
        ([[0.2, 0.1]], "do not strictly increase"),
        ([[NAN, 0.1]], "do not strictly increase"),
        ("soon", "times"),
    ],
)
@engines()
def test_bad_times_are_refused(engine, times, got):
    worlds = pack_worlds([make_scene(BALL)], coefficients())
    with pytest.raises(InvalidInputError, match=got):
        engine.simulator.rollout_batch(worlds, times)


@engines()
def test_bad_batches_are_refused(engine):
    scene, theta = make_scene(BALL), coefficients()
    with pytest.raises(InvalidInputError, match="no scenes; expected at least one"):
        engine.simulator.rollout([], theta, [1.0])
    with pytest.raises(InvalidInputError, match="2 times θ_s for 1 scenes"):
        engine.simulator.rollout([scene], [theta, theta], [1.0])
    with pytest.raises(UnknownNameError, match="'body'; expected one of cork, ground"):
        engine.simulator.rollout([scene], StaticParameters.uniform(["cork", "ground"]), [1.0])
    with pytest.raises(UnknownNameError, match="'ground'"):
        engine.simulator.rollout([scene], StaticParameters.uniform(["body"]), [1.0])
    other = StaticParameters.uniform(["ground", "body"])
    with pytest.raises(InvalidInputError, match="as in the others"):
        engine.simulator.rollout([scene, scene], [theta, other], [1.0])


FLAT = Box((0.4, 0.4, 0.1))
ROD = Capsule(0.03, 0.3)
POST = Box((0.06, 0.06, 0.36))
SHEET = Plane("sheet", "ground", (0, 0, 1), 0, [(-1, -1, 0), (1, -1, 0), (0, 1, 0)])
# What overlaps by more than a quarter of the smaller inradius, and the two names.
OVERLAPPING = {
    "sphere in floor": (make_scene(Body(Sphere(0.05), (0, 0, 0.03))), "body_0", "plane_0"),
    "box in floor": (make_scene(Body(FLAT, (0, 0, 0.03))), "body_0", "plane_0"),
    "corner in floor": (
        make_scene(Body(FLAT, (0, 0, 0.1), quaternion((0, 0.9, 0)))),
        "body_0",
        "plane_0",
    ),
    "capsule's end in floor": (make_scene(Body(ROD, (0, 0, 0.15))), "body_0", "plane_0"),
    "under the floor": (make_scene(Body(Sphere(0.05), (0, 0, -1.0))), "body_0", "plane_0"),
    "sphere in sheet": (
        make_scene(Body(Sphere(0.05), (0, 0, 0.02)), planes=[SHEET]),
        "body_0",
        "sheet",
    ),
    "box through sheet": (
        make_scene(Body(POST, (0, 0, 0.05)), planes=[SHEET]),
        "body_0",
        "sheet",
    ),
    "capsule through sheet": (
        make_scene(Body(ROD, (0, 0, 0.05)), planes=[SHEET]),
        "body_0",
        "sheet",
    ),
    "sphere in sphere": (
        make_scene(BALL, Body(Sphere(0.1), (0.12, 0, 1.0))),
        "body_0",
        "body_1",
    ),
    "sphere within box": (make_scene(BALL, Body(FLAT, (0, 0, 1.0))), "body_0", "body_1"),
    "boxes crossed": (
        make_scene(
            Body(Box((1.0, 0.1, 0.1)), (0, 0, 1.0)), Body(Box((0.1, 1.0, 0.1)), (0, 0, 1.02))
        ),
        "body_0",
        "body_1",
    ),
    "boxes edge in edge": (
        make_scene(
            Body(Box((1.0, 0.1, 0.1)), (0, 0, 1.0), quaternion((np.pi / 4, 0, 0))),
            Body(Box((0.1, 1.0, 0.1)), (0, 0, 1.1), quaternion((0, np.pi / 4, 0))),
        ),
        "body_0",
        "body_1",
    ),
    "capsules crossed": (
        make_scene(
            Body(ROD, (0, 0, 1.0), LYING_ALONG_X), Body(ROD, (0, 0, 1.04), quaternion((1.57, 0, 0)))
        ),
        "body_0",
        "body_1",
    ),
    "capsule in box": (
        make_scene(Body(ROD, (0.19, 0, 1.0), LYING_ALONG_X), Body(FLAT, (0, 0, 1.05))),
        "body_0",
        "body_1",
    ),
    "sphere in static box": (
        make_scene(BALL, boxes=[((0, 0, 0.8), (1, 1, 0.36))]),
        "body_0",
        "box_0",
    ),
    "box in static box": (
        make_scene(Body(FLAT, (0, 0, 1.0)), boxes=[((0.3, 0, 1.0), (0.4, 1, 1))]),
        "body_0",
        "box_0",
    ),
}


@pytest.mark.parametrize(("scene", "first", "second"), OVERLAPPING.values(), ids=OVERLAPPING.keys())
def test_an_overlapping_start_is_refused_with_both_names(scene, first, second):
    with pytest.raises(InvalidInputError) as refusal:
        STEPPED.simulator.rollout([scene], coefficients(), [0.1])
    assert repr(first) in str(refusal.value)
    assert repr(second) in str(refusal.value)
    assert "move them apart" in str(refusal.value)


def test_an_overlap_is_told_in_numbers_and_with_its_scene():
    # Centres 3 cm above the floor, radius 5 cm: 2 cm deep, of which a quarter of 5 cm is allowed.
    deep = OVERLAPPING["sphere in floor"][0]
    with pytest.raises(InvalidInputError, match=r"scene 1: .* by 20 mm .* at most 12\.5 mm"):
        STEPPED.simulator.rollout([make_scene(BALL), deep, deep], coefficients(), [0.1])


def test_packed_worlds_are_parted_and_not_refused():
    worlds = pack_worlds([OVERLAPPING["sphere in floor"][0]], coefficients())
    rollout = STEPPED.simulator.rollout_batch(worlds, [0.0])
    np.testing.assert_allclose(rollout.positions[0, 0, 0], (0, 0, 0.05), atol=1e-4)


def test_the_other_engines_refuse_an_overlapping_start_too():
    scene = OVERLAPPING["sphere in sphere"][0]
    for engine in (EVENT_DRIVEN, BULLET):
        with pytest.raises(InvalidInputError, match="body_1"):
            engine.simulator.rollout([scene], coefficients(), [0.1])


# What overlaps by less, as noisy states of bodies at rest do half of the time, or not at all.
TOUCHING = {
    "sphere in floor": make_scene(Body(Sphere(0.05), (0, 0, 0.042))),
    "box in floor": make_scene(Body(FLAT, (0, 0, 0.042))),
    "capsule in floor": make_scene(Body(ROD, (0, 0, 0.025), LYING_ALONG_X)),
    "stack": make_scene(Body(FLAT, (0, 0, 0.05)), Body(FLAT, (0, 0, 0.145))),
    "bounding spheres only": make_scene(
        Body(Box((1.0, 0.1, 0.1)), (0, 0, 1.0)), Body(Box((0.1, 1.0, 0.1)), (0, 0, 1.11))
    ),
    "edge over edge": make_scene(
        Body(Box((1.0, 0.1, 0.1)), (0, 0, 1.0), quaternion((np.pi / 4, 0, 0))),
        Body(Box((0.1, 1.0, 0.1)), (0, 0, 1.15), quaternion((0, np.pi / 4, 0))),
    ),
    "beside a sheet": make_scene(Body(Sphere(0.05), (2, 0, 0.01)), planes=[SHEET]),
    "box past the edge of a sheet": make_scene(Body(POST, (0, -1.05, 0.05)), planes=[SHEET]),
    "capsule past the edge of a sheet": make_scene(Body(ROD, (0, -1.05, 0.05)), planes=[SHEET]),
    "capsule on a sheet": make_scene(Body(ROD, (0, 0, 0.175)), planes=[SHEET]),
}


@pytest.mark.parametrize("scene", TOUCHING.values(), ids=TOUCHING.keys())
def test_a_touch_or_a_little_overlap_is_no_mistake(scene):
    rollout = STEPPED.simulator.rollout([scene], coefficients(), [0.5])
    assert rollout.status[0] == 0
    # And what is lifted out is not thrown: no more than a few centimetres a second.
    for k, state in enumerate(scene.states):
        assert rollout.positions[0, k, 0, 2] < state.position[2] + 0.03


@given(st.floats(0.0, 0.04), st.floats(1e-3, 1.0), st.sampled_from(["floor", "box", "sheet"]))
def test_what_never_moves_does_not_set_the_limit(overlap, thickness, kind):
    ball = Body(Sphere(0.05), (0, 0, 0.05 - overlap))
    slab = ((0, 0, -0.5 * thickness), (1, 1, thickness))
    scene = {
        "floor": lambda: make_scene(ball),
        "box": lambda: make_scene(ball, planes=(), boxes=[slab]),
        "sheet": lambda: make_scene(ball, planes=[SHEET]),
    }[kind]()
    if overlap > 0.0126:
        with pytest.raises(InvalidInputError, match=r"at most 12\.5 mm"):
            STEPPED.simulator.rollout([scene], coefficients(), [0.01])
    elif overlap < 0.0124:
        STEPPED.simulator.rollout([scene], coefficients(), [0.01])


@given(st.floats(0.0, 0.12), st.sampled_from([0.05, 0.1]))
def test_the_limit_of_overlap_is_a_quarter_of_the_smaller_radius(overlap, other):
    scene = make_scene(BALL, Body(Sphere(other), (0.05 + other - overlap, 0, 1.0)), planes=())
    if overlap > 0.0126:
        with pytest.raises(InvalidInputError, match="body_0"):
            STEPPED.simulator.rollout([scene], coefficients(), [0.01])
    elif overlap < 0.0124:
        STEPPED.simulator.rollout([scene], coefficients(), [0.01])


INEXPRESSIBLE = {
    "bullet sheet": (BULLET, make_scene(BALL, planes=[SHEET]), "sheet.*stepped"),
    "bullet drag": (
        BULLET,
        make_scene(BALL, Body(Sphere(0.05), (1, 0, 1), air={"drag_coefficient": 0.5})),
        "object 1 .*drag.*stepped",
    ),
    "bullet Magnus": (
        BULLET,
        make_scene(Body(Sphere(0.05), (0, 0, 1), air={"magnus_coefficient": 0.5})),
        "Magnus.*stepped",
    ),
}


@pytest.mark.parametrize(
    ("engine", "scene", "words"), INEXPRESSIBLE.values(), ids=INEXPRESSIBLE.keys()
)
def test_what_an_engine_cannot_express_it_refuses_and_names_the_one_that_can(engine, scene, words):
    with pytest.raises(UnsupportedSceneError, match=words):
        engine.simulator.rollout([scene], coefficients(), [0.1])
    assert STEPPED.simulator.rollout([scene], coefficients(), [0.1]).status[0] == 0


def test_unknown_engines_are_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"'ode'; expected one of .*stepped"):
        make_simulator("ode")


@pytest.mark.parametrize(
    "make",
    [
        lambda: type(STEPPED.simulator)(time_step=0.0),
        lambda: type(STEPPED.simulator)(time_step=-0.01),
        lambda: type(STEPPED.simulator)(time_step=NAN),
        lambda: type(STEPPED.simulator)(threads=0),
        lambda: type(EVENT_DRIVEN.simulator)(threads=0),
        lambda: type(BULLET.simulator)(time_step=NAN),
        lambda: type(BULLET.simulator)(time_step=1.0),
    ],
)
def test_bad_engine_options_are_refused(make):
    with pytest.raises(IntuitivePhysicsError, match="expected"):
        make()
