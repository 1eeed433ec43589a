"""A parameter that could as well have another value is not reported as known."""

import numpy as np

from intuitive_physics.materials import parameter_names
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, TrajectoryCost, learn
from intuitive_physics_learner.joint_search.identifiability import identifiability_of_optimum
from intuitive_physics_learner.methods import JOINT_METHOD

from .cases import task_of

FLOOR = Environment([Plane("floor", "floor", [0, 0, 1], 0.0)])
MATERIALS = ("ball", "floor")
PAIR = parameter_names(MATERIALS).index("dynamic_friction[ball, floor]")


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
    task = task_of(cost, found := replace_pair(true_parameters, 0.29))
    result = identifiability_of_optimum(task, found)
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
