"""What goes into a message and comes out again is the same; what is wrong is named."""

import math
import pickle
from copy import deepcopy
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ParameterBounds, StaticPrimitive
from intuitive_physics_msgs.msg import Shape as ShapeMessage
from rclpy.serialization import deserialize_message, serialize_message

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_count
from intuitive_physics.observation import Detections, Observation, ObservedObject, SeenSpin
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.parameter_space import DEFAULT_BOUNDS, Bounds
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_ros import conversions as to

NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1).filter(str.strip)
NUMBERS = st.floats(-1e6, 1e6)
LENGTHS = st.floats(1e-3, 1e3)
SHAPES = st.one_of(
    st.builds(Sphere, LENGTHS),
    st.builds(Box, st.tuples(LENGTHS, LENGTHS, LENGTHS)),
    st.builds(Capsule, LENGTHS, LENGTHS),
)


def vectors(n=3, elements=NUMBERS):
    return arrays(np.float64, n, elements=elements)


DIRECTIONS = vectors().filter(lambda v: np.linalg.norm(v) > 1e-3)
QUATERNIONS = (
    vectors(4).filter(lambda q: np.linalg.norm(q) > 1e-3).map(lambda q: q / np.linalg.norm(q))
)
COVARIANCES = vectors((12, 12), st.floats(-10.0, 10.0)).map(lambda a: a @ a.T)
STATES = st.builds(ObjectState, vectors(), QUATERNIONS, vectors(), vectors(), COVARIANCES)
OBJECTS = st.builds(SceneObject, NAMES, NAMES, SHAPES)
PLANES = st.builds(
    Plane, NAMES, NAMES, DIRECTIONS, NUMBERS, st.one_of(st.none(), vectors((4, 3)), vectors((3, 3)))
)
SPIN_SPREADS = st.builds(SpinSpread, LENGTHS, st.floats(0.0, 1e6), LENGTHS)
BOXES = st.builds(StaticBox, NAMES, NAMES, vectors(), QUATERNIONS, vectors(3, LENGTHS))


@st.composite
def environments(draw):
    primitives = draw(
        st.lists(st.one_of(PLANES, BOXES), max_size=4, unique_by=lambda primitive: primitive.id)
    )
    return Environment(
        [p for p in primitives if isinstance(p, Plane)],
        [p for p in primitives if isinstance(p, StaticBox)],
        draw(vectors()),
        draw(NAMES),
    )


@st.composite
def observations(draw):
    start = draw(st.floats(0.0, 2e9))
    objects = []
    for item in draw(st.lists(OBJECTS, min_size=1, max_size=2, unique_by=lambda o: o.id)):
        steps = draw(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=5))
        times = start + np.cumsum(steps)
        positions = draw(vectors((len(steps), 3)))
        objects.append(ObservedObject(item, Trajectory(times, positions), draw(STATES)))
    return Observation(draw(environments()), tuple(objects), start, draw(NAMES))


@st.composite
def learned_parameters(draw):
    materials = draw(st.lists(NAMES, min_size=1, max_size=3, unique=True))
    m = len(materials)
    upper = np.triu_indices(m)
    coefficients = np.zeros((4, m, m))
    for i, j in zip(*upper, strict=True):
        high, low = sorted(draw(st.tuples(st.floats(0, 2), st.floats(0, 2))), reverse=True)
        values = (high, low, draw(st.floats(0, 1)), draw(st.floats(0, 1)))
        coefficients[:, i, j] = coefficients[:, j, i] = values
    size = parameter_count(m)
    return LearnedParameters(
        StaticParameters(materials, draw(vectors(m, LENGTHS)), coefficients),
        draw(vectors(size, st.one_of(st.just(math.nan), st.floats(0, 1e6)))),
        draw(arrays(bool, size)),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.one_of(st.just(math.nan), st.floats(0, 1e3))),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.text(st.characters(codec="utf-8", exclude_characters="\0"))),
        [draw(st.sampled_from([(math.nan, math.nan), (0.25, 1.0)])) for _ in range(size)],
        draw(st.one_of(st.none(), posteriors(materials))),
        initial_spins=InitialSpins(
            draw(st.dictionaries(st.sampled_from(materials), SPIN_SPREADS, max_size=m))
        ),
    )


@st.composite
def posteriors(draw, materials):
    size = parameter_count(len(materials))
    rank = draw(st.integers(0, size))
    return ParameterPosterior(
        materials,
        draw(vectors(size, st.floats(0, 1))),
        draw(arrays(float, (rank, size), elements=st.floats(-1e6, 1e6))),
        draw(st.sampled_from([{}, {"density": Bounds(10.0, 20.0, "linear")}])),
        [draw(st.sampled_from([(math.nan, math.nan), (0.25, 1.0)])) for _ in range(size)],
    )


def over_the_wire(message):
    """What the other end gets."""
    return deserialize_message(serialize_message(message), type(message))


def assert_same_state(a, b):
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_allclose(a.orientation, b.orientation, atol=1e-15)
    np.testing.assert_array_equal(a.linear_velocity, b.linear_velocity)
    np.testing.assert_array_equal(a.angular_velocity, b.angular_velocity)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-12, atol=1e-12)


def assert_same_environment(a, b):
    assert a.frame_id == b.frame_id
    np.testing.assert_array_equal(a.gravity, b.gravity)
    assert [(p.id, p.material, p.offset) for p in a.planes] == [
        (p.id, p.material, p.offset) for p in b.planes
    ]
    for p, q in zip(a.planes, b.planes, strict=True):
        np.testing.assert_allclose(p.normal, q.normal, atol=1e-15)
        assert (p.boundary is None) == (q.boundary is None)
        if p.boundary is not None:
            np.testing.assert_array_equal(p.boundary, q.boundary)
    assert [(p.id, p.material) for p in a.boxes] == [(p.id, p.material) for p in b.boxes]
    for p, q in zip(a.boxes, b.boxes, strict=True):
        np.testing.assert_array_equal(p.center, q.center)
        np.testing.assert_allclose(p.orientation, q.orientation, atol=1e-15)
        np.testing.assert_array_equal(p.edge_lengths, q.edge_lengths)


@given(SHAPES)
def test_shape_comes_back(shape):
    assert to.shape_from_message(over_the_wire(to.shape_to_message(shape))) == shape


@given(environments())
def test_environment_comes_back(environment):
    message = over_the_wire(to.environment_to_message(environment, version=7))
    assert message.version == 7
    assert_same_environment(to.environment_from_message(message), environment)


@given(st.lists(st.tuples(OBJECTS, STATES), max_size=3))
def test_object_states_come_back(pairs):
    objects, states = [p[0] for p in pairs], [p[1] for p in pairs]
    message = over_the_wire(to.object_states_to_message(objects, states, frame_id="world"))
    got_objects, got_states = to.object_states_from_messages(message.objects)
    assert list(got_objects) == objects
    for got, state in zip(got_states, states, strict=True):
        assert_same_state(got, state)


def test_detections_of_a_frame_come_back():
    ball, state = SceneObject("ball", "rubber", Sphere(0.1)), ObjectState((0.0, 0.0, 1.0))
    spin = SeenSpin([1.0, -2.0, 3.0], np.diag([1.0, 2.0, 3.0]), 12.0)
    plain, painted = (
        Detections([12.5], [[1.0, 2.0, 3.0]], [np.diag([1.0, 2.0, 3.0])], 0.5 * np.eye(3), shown)
        for shown in (None, spin)
    )
    message = over_the_wire(
        to.object_states_to_message(
            [ball] * 3, [state] * 3, frame_id="a", detections=[plain, None, painted]
        )
    )
    first, nothing, last = to.detections_from_messages(message, 12.5)
    assert nothing is None
    assert first.to_dict() == plain.to_dict()
    assert last.to_dict() == painted.to_dict()
    message.detections[2].spin_covariance = [1.0] * 5
    with pytest.raises(InvalidInputError, match=r"detections\[2\].spin_covariance: has 5 numbers"):
        to.detections_from_messages(message, 12.5)
    message.detections = message.detections[:1]
    with pytest.raises(InvalidInputError, match="1 detections of 3 objects; expected one for each"):
        to.detections_from_messages(message, 12.5)
    message.detections = []
    assert to.detections_from_messages(message, 12.5) == (None,) * 3


@given(environments(), OBJECTS, STATES)
def test_scene_is_read_from_its_parts(environment, item, state):
    scene = to.scene_from_messages(
        to.environment_to_message(environment), [to.object_state_to_message(item, state)]
    )
    assert_same_environment(scene.environment, environment)
    assert scene.objects == (item,)
    assert_same_state(scene.states[0], state)


@given(observations())
def test_observation_comes_back(observation):
    got = to.observation_from_message(over_the_wire(to.observation_to_message(observation)))
    assert got.id == observation.id
    # A double holds the seconds of today to 2.4e-7 s, a stamp to 1e-9 s.
    assert got.start_time == pytest.approx(observation.start_time, abs=5e-7, rel=0)
    assert_same_environment(got.environment, observation.environment)
    for a, b in zip(got.objects, observation.objects, strict=True):
        assert a.object == b.object
        assert_same_state(a.initial_state, b.initial_state)
        np.testing.assert_allclose(a.trajectory.times, b.trajectory.times, atol=1e-6, rtol=0)
        np.testing.assert_array_equal(a.trajectory.positions, b.trajectory.positions)


@given(learned_parameters())
def test_static_parameters_come_back(learned):
    message = over_the_wire(to.static_parameters_to_message(learned))
    assert_same_parameters(to.static_parameters_from_message(message), learned)


@given(learned_parameters(), st.randoms())
def test_pairs_may_come_in_any_order(learned, random):
    message = to.static_parameters_to_message(learned)
    random.shuffle(message.pairs)
    for pair in message.pairs:
        if random.random() < 0.5:
            pair.material_a, pair.material_b = pair.material_b, pair.material_a
    assert_same_parameters(to.static_parameters_from_message(message), learned)


def assert_same_parameters(a, b):
    assert a.materials == b.materials
    np.testing.assert_array_equal(a.parameters.density, b.parameters.density)
    np.testing.assert_array_equal(a.parameters.coefficients, b.parameters.coefficients)
    np.testing.assert_array_equal(a.standard_deviations, b.standard_deviations)
    np.testing.assert_array_equal(a.intervals, b.intervals)
    np.testing.assert_array_equal(a.identified, b.identified)
    np.testing.assert_equal(a.cost, b.cost)
    assert a.initial_spins == b.initial_spins
    assert (a.posterior is None) == (b.posterior is None)
    if a.posterior is not None:
        np.testing.assert_array_equal(a.posterior.mean, b.posterior.mean)
        np.testing.assert_array_equal(a.posterior.factor, b.posterior.factor)
        np.testing.assert_array_equal(a.posterior.intervals, b.posterior.intervals)
        assert a.posterior.bounds == b.posterior.bounds
    assert (a.version, a.observation_count, a.method) == (b.version, b.observation_count, b.method)


@given(
    st.dictionaries(
        st.sampled_from(["density", "static_friction", "restitution"]),
        st.builds(
            lambda ends, scale: Bounds(min(ends), max(ends), scale),
            st.tuples(LENGTHS, LENGTHS),
            st.sampled_from(["linear", "logarithmic"]),
        ),
    )
)
def test_bounds_come_back(bounds):
    assert to.bounds_from_messages(to.bounds_to_messages(bounds)) == bounds


@given(st.floats(0.0, 2**31 - 1))
def test_seconds_come_back(seconds):
    stamp = over_the_wire(to.stamp_from_seconds(seconds))
    assert to.seconds_from_stamp(stamp) == pytest.approx(seconds, abs=5e-7, rel=0)


@given(st.integers(0, 2**31 - 2), st.integers(0, 999_999_999))
def test_a_stamp_comes_back_to_the_nanosecond(sec, nanosec):
    stamp = Time(sec=sec, nanosec=nanosec)
    seconds = to.seconds_from_stamp(stamp)
    assert abs(seconds - Fraction(10**9 * sec + nanosec, 10**9)) < 2.5e-7
    for same in (seconds, pickle.loads(pickle.dumps(seconds)), deepcopy(seconds)):
        assert to.stamp_from_seconds(same) == stamp
    # A moment that was calculated from it is the nearest to what it is.
    assert to.stamp_from_seconds(seconds + 0.0) == to.stamp_from_seconds(float(seconds))


@pytest.mark.parametrize("seconds", [-1.0, 2.0**31, math.nan, math.inf])
def test_seconds_no_stamp_can_hold(seconds):
    with pytest.raises(InvalidInputError, match="time is"):
        to.stamp_from_seconds(seconds)


# What is wrong is named: (what makes it wrong, what the message must say).


@pytest.mark.parametrize(
    ("kind", "dimensions", "complaint"),
    [
        (0, [1.0], "kind: is 0; expected 1 .sphere."),
        (9, [], "kind: is 9"),
        (ShapeMessage.SPHERE, [], "dimensions: has 0 numbers; expected 1"),
        (ShapeMessage.BOX, [1.0], "dimensions: has 1 numbers; expected 3"),
        (ShapeMessage.CAPSULE, [0.1, -1.0], "dimensions: capsule length is -1"),
        (ShapeMessage.SPHERE, [math.nan], "dimensions: has 1 numbers that are not finite"),
    ],
)
def test_wrong_shape(kind, dimensions, complaint):
    with pytest.raises(InvalidInputError, match=complaint):
        to.shape_from_message(ShapeMessage(kind=kind, dimensions=dimensions))


def plane_message(**changes):
    fields = {"kind": StaticPrimitive.PLANE, "id": "floor", "material": "wood"}
    return StaticPrimitive(**{**fields, "normal": Vector3(z=1.0), **changes})


@pytest.mark.parametrize(
    ("primitives", "complaint"),
    [
        ([plane_message(kind=7)], r"primitives\[0\]: kind is 7"),
        ([plane_message(), plane_message(id="")], r"primitives\[1\]: plane id is ''"),
        ([plane_message(normal=Vector3())], r"primitives\[0\]: normal of plane floor"),
        ([plane_message(offset=math.inf)], r"primitives\[0\]: offset of plane floor is inf"),
        ([plane_message(boundary=[Point()])], "boundary of plane floor has 1 corners"),
        ([plane_message(), plane_message()], "environment has the ids"),
        ([plane_message(kind=StaticPrimitive.BOX)], "edge lengths of box floor"),
    ],
)
def test_wrong_environment(primitives, complaint):
    with pytest.raises(InvalidInputError, match=complaint):
        to.environment_from_message(EnvironmentMessage(primitives=primitives))


def object_message():
    return to.object_state_to_message(
        SceneObject("ball", "rubber", Sphere(0.1)), ObjectState((0, 0, 1))
    )


def spoil(message, path, value):
    *parents, last = path.split(".")
    for parent in parents:
        message = getattr(message, parent)
    setattr(message, last, value)


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("pose.pose.position.x", math.nan, r"objects\[1\]: position has 1 values"),
        ("pose.pose.orientation.w", 2.0, r"objects\[1\]: orientation has norm 2"),
        ("twist.twist.linear.y", math.inf, r"objects\[1\]: linear velocity"),
        ("pose.covariance", np.full(36, math.nan), r"objects\[1\]\.pose\.covariance: has 36"),
        ("twist.covariance", -np.eye(6).ravel(), r"objects\[1\]: state covariance has the eigen"),
        ("shape.kind", 0, r"objects\[1\]\.shape\.kind: is 0"),
        ("id", " ", r"objects\[1\]: object id is ' '"),
    ],
)
def test_wrong_object_state(path, value, complaint):
    wrong = object_message()
    spoil(wrong, path, value)
    with pytest.raises(InvalidInputError, match=complaint):
        to.object_states_from_messages([object_message(), wrong])


def test_scene_wants_objects_and_each_id_once():
    environment = to.environment_to_message(Environment())
    with pytest.raises(InvalidInputError, match=r"^scene has no objects"):
        to.scene_from_messages(environment, [])
    with pytest.raises(InvalidInputError, match="expected each once"):
        to.scene_from_messages(environment, [object_message(), object_message()])


def observation_message():
    ball = ObservedObject(
        SceneObject("ball", "rubber", Sphere(0.1)),
        Trajectory([5.1, 5.2], [(0, 0, 1), (0, 0, 0.9)]),
        ObjectState((0, 0, 1)),
    )
    return to.observation_to_message(Observation(Environment(), (ball,), 5.0, "first"))


def test_wrong_observation():
    for path, value, complaint in [
        ("times", [0.1], r"objects\[0\]\.positions: has 6 numbers; expected 3"),
        ("times", [0.2, 0.1], r"objects\[0\]: trajectory times goes from"),
        ("positions", [math.nan] * 6, r"objects\[0\]\.positions: has 6 numbers that are not fin"),
        ("initial_state.material", "", r"objects\[0\]\.initial_state: material of object ball"),
    ]:
        message = observation_message()
        spoil(message.objects[0], path, value)
        with pytest.raises(InvalidInputError, match=complaint):
            to.observation_from_message(message)
    for path, value, complaint in [
        ("id", " ", "^observation id is ' '"),
        ("objects", [], "^scene has no objects"),
        ("header.frame_id", "camera", "environment: is in the frame 'world'"),
        ("environment.gravity.z", math.nan, "environment: gravity has 1"),
    ]:
        message = observation_message()
        spoil(message, path, value)
        with pytest.raises(InvalidInputError, match=complaint):
            to.observation_from_message(message)


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("materials", ["a", "a"], "materials are .* expected each name once"),
        ("materials", ["a"], "densities: has 2 numbers; expected 1"),
        ("densities", [500.0, math.inf], "densities: has 1 numbers that are not finite"),
        ("density_standard_deviations", [], "density_standard_deviations: has 0 elements"),
        ("density_identified", [True], "density_identified: has 1 elements; expected 2"),
        ("pairs", [], r"pairs: lack the pair of \['a'\]"),
        ("cost", -1.0, "cost is -1"),
    ],
)
def test_wrong_static_parameters(path, value, complaint):
    message = to.static_parameters_to_message(LearnedParameters.defaults(["a", "b"]))
    spoil(message, path, value)
    with pytest.raises(InvalidInputError, match=complaint):
        to.static_parameters_from_message(message)


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("posterior_mean", [0.5], "posterior_mean: has 1 numbers; expected 14"),
        ("posterior_mean", [2.0] * 14, "expected coordinates from 0 to 1"),
        ("posterior_rank", 3, "posterior_factor: has 28 numbers; expected 42"),
        ("posterior_factor", [math.nan] * 28, "posterior_factor: has 28 numbers that are not fin"),
        ("posterior_bounds", [to.bounds_to_messages(DEFAULT_BOUNDS)[0]] * 2, "each once"),
        ("posterior_lower_ends", [], "posterior_lower_ends: has 0 elements; expected 14"),
    ],
)
def test_wrong_posterior(path, value, complaint):
    factor = np.eye(14)[:2]
    defaults = LearnedParameters.defaults(["a", "b"])
    posterior = ParameterPosterior(["a", "b"], np.full(14, 0.5), factor)
    message = to.static_parameters_to_message(replace(defaults, posterior=posterior))
    spoil(message, path, value)
    with pytest.raises(InvalidInputError, match=complaint):
        to.static_parameters_from_message(message)


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("spin_deviations", [2.0], "spin_deviations: has 1 elements; expected 2"),
        ("stated_spin_deviations", [], "stated_spin_deviations: has 0 elements; expected 2"),
        ("spin_deviations", [0.0, 1.0], "initial spins of a: standard deviation .* is 0"),
        ("spin_counts", [-1.0, math.nan], "initial spins of a: effective number of throws is -1"),
    ],
)
def test_wrong_initial_spins(path, value, complaint):
    spins = InitialSpins({"a": SpinSpread(2.0, 5.0, 10.0)})
    defaults = replace(LearnedParameters.defaults(["a", "b"]), initial_spins=spins)
    message = to.static_parameters_to_message(defaults)
    spoil(message, path, value)
    with pytest.raises(InvalidInputError, match=complaint):
        to.static_parameters_from_message(message)


def test_wrong_pair():
    message = to.static_parameters_to_message(LearnedParameters.defaults(["a", "b"]))
    message.pairs.append(message.pairs[0])
    with pytest.raises(InvalidInputError, match="pairs: are 4; expected 3"):
        to.static_parameters_from_message(message)
    message.pairs.pop()
    message.pairs[1].restitution = 1.5
    with pytest.raises(InvalidInputError, match=r"has restitution 1\.5; expected"):
        to.static_parameters_from_message(message)


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (ParameterBounds(kind="colour"), r"bounds\[0\]: kind is 'colour'"),
        (ParameterBounds(kind="density", scale=5), r"bounds\[0\]: scale is 5"),
        (ParameterBounds(kind="density", lower=2.0, upper=1.0), "expected lower ≤ upper"),
        (ParameterBounds(kind="density", upper=math.nan), "upper bound is nan"),
    ],
)
def test_wrong_bounds(message, complaint):
    with pytest.raises(InvalidInputError, match=complaint):
        to.bounds_from_messages([message])
