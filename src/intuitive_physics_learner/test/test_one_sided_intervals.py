"""A parameter that could as well have another value is not reported as known."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningOptions,
    TrajectoryCost,
    identify,
    learn,
)
from intuitive_physics_learner.cost.cost_function import FAILED_DISTANCE
from intuitive_physics_learner.methods import JOINT_METHOD
from intuitive_physics_learner.search.one_sided_intervals import is_acceptable
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

FLOOR = Environment([Plane("floor", "floor", [0, 0, 1], 0.0)])
MATERIALS = ("ball", "floor")
PAIR = parameter_names(MATERIALS).index("dynamic_friction[ball, floor]")

rises = st.floats(1e-6, 1.0)


@given(rise=rises, others=st.integers(1, 20))
def test_one_observation_among_indifferent_ones_is_no_agreement(rise, others):
    # d = (x, 0, …, 0): mean x/n, and standard error sqrt(x²/n / n) = x/n. But it counts where it is
    # much worse than it was, x > 0.1 n D.
    alone = np.array([rise, *np.zeros(others)])
    assert is_acceptable(alone, np.full(others + 1, 11.0 * rise / (others + 1)))
    assert not is_acceptable(alone, np.full(others + 1, 9.0 * rise / (others + 1)))


@given(rise=rises, count=st.integers(1, 20))
def test_agreeing_observations_keep_their_weight(rise, count):
    costs = np.full(count, 100.0)
    assert not is_acceptable(np.full(count, rise), costs)
    assert is_acceptable(np.full(count, -rise), costs)
    failed = np.array([FAILED_DISTANCE, *np.full(count, -rise)])
    assert not is_acceptable(failed, np.full(count + 1, 100.0))


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=10), st.randoms())
def test_neither_order_nor_unit_matters(values, random):
    shuffled, costs = random.sample(values, len(values)), np.full(len(values), 0.5)
    if abs(np.mean(values)) > 1e-6:
        first = is_acceptable(np.array(values), costs)
        assert first == is_acceptable(4.0 * np.array(shuffled), 4.0 * costs)


def thrown(simulator, parameters, template, velocity, generator):
    """One of `throws`, thrown again from the same place with another velocity (m/s)."""
    (ball,) = template.objects
    state = ObjectState(ball.initial_state.position, linear_velocity=velocity)
    scene = Scene(template.environment, (ball.object,), (state,))
    times = np.arange(40) / 30.0
    positions = simulator.rollout([scene], parameters, times).positions[0, 0]
    noisy = Trajectory(times[1:], positions[1:] + generator.normal(0.0, 0.003, (39, 3)))
    return Observation(template.environment, (ObservedObject(ball.object, noisy, state),), 0.0)


def test_friction_that_only_has_to_be_large_enough_has_a_one_sided_interval(
    event_driven, throws, true_parameters
):
    # An impact of normal velocity v_n ends the slip s of a sphere where 2/7 s ≤ μ (1 + e) v_n. All
    # of six throws do at the true μ, five at any; the sixth slips a little at the μ found, which is
    # just below what it needs. Its slope there would give μ to ± 0.006.
    generator = np.random.default_rng(3)
    true = replace_pair(true_parameters, 0.5)
    template = throws(1, 0)[0]
    height = template.objects[0].initial_state.position[2] - 0.05
    falling = np.sqrt(2.0 * 9.81 * height)
    slip = 3.5 * 0.3 * (1.0 + 0.7) * falling
    speeds = [*generator.uniform(0.1, 0.4, 5), slip]
    observed = [
        thrown(event_driven, true, template, (speed, 0.0, 0.0), generator) for speed in speeds
    ]
    cost = TrajectoryCost(observed, event_driven, MATERIALS)
    result = identify(cost, ParameterSpace(MATERIALS), replace_pair(true_parameters, 0.29))
    low, high = result.intervals[PAIR]
    assert result.identified[PAIR]
    assert 0.2 < low < 0.29
    assert high == 1.0


def gentle_throw(simulator, parameters, generator):
    """A ball that needs a friction of at most 0.35 to roll on from its first impact."""
    height, need = generator.uniform(0.3, 0.8), generator.uniform(0.1, 0.35)
    slip = 3.5 * need * (1.0 + 0.7) * np.sqrt(2.0 * 9.81 * height)
    ball = SceneObject("ball", "ball", Sphere(0.05))
    state = ObjectState((0.0, 0.0, height + 0.05), linear_velocity=(slip, 0.0, 0.0))
    times = np.arange(40) / 30.0
    positions = simulator.rollout([Scene(FLOOR, (ball,), (state,))], parameters, times).positions
    believed = ObjectState(
        state.position + generator.normal(0.0, 0.01, 3),
        linear_velocity=state.linear_velocity + generator.normal(0.0, 0.05, 3),
        covariance=np.diag(np.repeat([1.0, 0.0, 25.0, 0.0], 3)) * 0.01**2,
    )
    noisy = Trajectory(times, positions[0, 0] + generator.normal(0.0, 0.003, (40, 3)))
    return Observation(FLOOR, (ObservedObject(ball, noisy, believed),), 0.0)


def jointly_learned(observed, simulator):
    options = LearningOptions(JOINT_METHOD, ConvergenceCriteria(700))
    return learn(observed, simulator, options).learned


def test_joint_estimation_has_one_sided_intervals(event_driven, true_parameters):
    # No throw slips at 0.35 or more. An estimate that lets a ball slip by what noise feigns has a
    # slope that gives μ to ± 0.002; the true one is 0.6.
    true = replace_pair(true_parameters, 0.6)
    sided = 0
    for seed in range(6):
        generator = np.random.default_rng(seed)
        observed = [gentle_throw(event_driven, true, generator) for _ in range(8)]
        learned = jointly_learned(observed, event_driven)
        assert learned.identified[PAIR] == np.isfinite(learned.intervals[PAIR]).all()
        if learned.identified[PAIR]:
            sided += 1
            low, high = learned.intervals[PAIR]
            assert 0.1 < low < 0.35
            assert high == 1.0
            ends = learned.posterior.intervals[PAIR]
            assert ends[0] < learned.posterior.mean[PAIR] <= ends[1] == 1.0
        # What is known on both sides has none.
        others = np.delete(learned.intervals, PAIR, axis=0)
        assert np.isnan(others).all()
        assert learned.identified[PAIR + 1 : PAIR + 3].all()
    assert sided >= 1


def test_where_no_ball_slips_is_reached_by_the_slopes_there(event_driven, true_parameters):
    # As above. Slopes where balls slip do not lead their initial states to where none does: the
    # loss seems to rise by more than 4.5, so that μ would be 0.356 ± 0.044.
    generator = np.random.default_rng(7)
    true = replace_pair(true_parameters, 0.6)
    observed = [gentle_throw(event_driven, true, generator) for _ in range(16)]
    learned = jointly_learned(observed, event_driven)
    low, high = learned.intervals[PAIR]
    assert 0.1 < low < 0.36
    assert high == 1.0


def test_joint_estimation_without_interval_of_two_sided_parameters(event_driven, throws):
    learned = jointly_learned(throws(8, 3, 0.003, 0.01), event_driven)
    assert learned.identified[PAIR : PAIR + 3].all()
    assert np.isnan(learned.intervals).all()


def replace_pair(parameters, friction):
    return parameters.with_pair(
        "ball", "floor", static_friction=friction + 0.01, dynamic_friction=friction
    )


def test_dragging_a_friction_brings_the_other_along(true_parameters):
    axes = ParameterAxes(ParameterSpace(MATERIALS), true_parameters)
    for place in np.linspace(0.0, 1.0, 11):
        for axis in (PAIR - 1, PAIR):
            pair = axes.dragged(axis, place).pair("ball", "floor")
            assert pair["dynamic_friction"] <= pair["static_friction"]
        raised = axes.dragged(PAIR, place).pair("ball", "floor")
        assert raised["static_friction"] == max(0.35, raised["dynamic_friction"])
        lowered = axes.dragged(PAIR - 1, place).pair("ball", "floor")
        assert lowered["dynamic_friction"] == min(0.2, lowered["static_friction"])


def test_observations_of_several_objects(glide, glides):
    # Objects glide by their own e: a move of one e is asked of all observations it has a part in.
    generator = np.random.default_rng(0)
    materials = ("ball", "floor", "puck")
    observed = [glides(generator, 0.5, (20, 15), ("ball", "puck")) for _ in range(4)]
    observed.append(glides(generator, 0.5))
    space = ParameterSpace(materials)
    cost = TrajectoryCost(observed, glide, materials)
    result = identify(cost, space, StaticParameters.uniform(materials, restitution=0.5))
    names = parameter_names(materials)
    assert {name for name, yes in zip(names, result.identified, strict=True) if yes} == {
        "restitution[ball, floor]",
        "restitution[floor, puck]",
    }
