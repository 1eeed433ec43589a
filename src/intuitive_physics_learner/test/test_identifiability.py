"""Parameters that data do not determine are not identified; the others have a true uncertainty."""

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import SimulationStoppedError
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import Bounds, ParameterSpace, parameter_vector
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import (
    ConvergenceCriteria,
    ParameterSearch,
    TrajectoryCost,
    make_update_rule,
)
from intuitive_physics_learner.joint_search.identifiability import identifiability_of_optimum

from .cases import MATERIALS, E, rerouted, task_of

SPACE = ParameterSpace(MATERIALS)


def stated(cost, parameters, space=SPACE):
    """What a search states that began at these parameters and found none better."""
    return identifiability_of_optimum(task_of(cost, parameters, space), parameters)


def found_optimum(cost, seed=0, iterations=1500):
    rule = make_update_rule("hybrid_random", SPACE.size, np.random.default_rng(seed))
    search = ParameterSearch(cost.costs, SPACE, rule)
    return search.run(ConvergenceCriteria(iterations)).parameters


def identified_names(result):
    return {n for n, yes in zip(parameter_names(MATERIALS), result.identified, strict=True) if yes}


def test_only_active_parameters_are_identified(event_driven, throws, true_parameters):
    cost = TrajectoryCost(throws(6, 0, noise=0.003), event_driven, MATERIALS)
    result = stated(cost, true_parameters)
    # A lone sphere's density cancels in its equation of motion, and ball never met ball.
    assert identified_names(result) == {
        "dynamic_friction[ball, floor]",
        "rolling_friction[ball, floor]",
        "restitution[ball, floor]",
    }
    dependent = {n for n, yes in zip(SPACE.names, result.responsive, strict=True) if yes}
    assert all(name.endswith("[ball, floor]") for name in dependent)
    assert (np.isnan(result.standard_deviations) == ~result.identified).all()


def test_nothing_is_identified_in_free_flight(event_driven, throws, true_parameters):
    flight = throws(3, 0, noise=0.003, times=4)
    result = stated(TrajectoryCost(flight, event_driven, MATERIALS), true_parameters)
    assert not result.identified.any()
    assert not result.responsive.any()


def test_a_response_below_the_noise_identifies_nothing(glide, glides):
    # e acts, but less than the noise hides: 0.1 s at about 1 mm/s against 1 m.
    generator = np.random.default_rng(0)
    observation = glides(generator, 0.5, counts=(20,))
    (thing,) = observation.objects
    noisy = thing.trajectory.positions + generator.normal(size=(20, 3))
    slow = replace(thing, trajectory=Trajectory(1e-3 * thing.trajectory.times, noisy))
    cost = TrajectoryCost([replace(observation, objects=(slow,))], glide, MATERIALS)
    result = stated(cost, StaticParameters.uniform(MATERIALS))
    assert result.responsive.sum() == 1
    assert not result.identified.any()


def test_bounds_that_freeze_a_parameter_leave_nothing_to_identify(
    event_driven, throws, true_parameters
):
    space = ParameterSpace(MATERIALS, {"restitution": Bounds(0.7, 0.7)})
    cost = TrajectoryCost(throws(4, 0, noise=0.003), event_driven, MATERIALS)
    result = stated(cost, true_parameters, space)
    assert not result.responsive[E]


def test_failed_worlds_do_not_count_as_a_response(glide, glides):
    # Where e > 0.99 the engine fails; a world that starts at rest responds to nothing else.
    observation = glides(np.random.default_rng(0), 0.0)
    (thing,) = observation.objects
    resting = replace(thing, initial_state=ObjectState(thing.initial_state.position))
    cost = TrajectoryCost([replace(observation, objects=(resting,))], glide, MATERIALS)
    result = stated(cost, StaticParameters.uniform(MATERIALS))
    assert not result.responsive.any()


def test_standard_deviation_of_a_linear_model(glide, glides):
    # x = x0 + e v t with independent noise s: var(e) = s² / Σ (v t)² by least squares.
    generator = np.random.default_rng(1)
    observation = glides(generator, 0.5, counts=(200,))
    thing = observation.objects[0]
    track = thing.trajectory
    noise = generator.normal(0.0, 0.02, (200, 3))
    noisy = rerouted(observation, lambda times, positions: positions + noise)
    cost = TrajectoryCost([noisy], glide, MATERIALS)
    result = stated(cost, StaticParameters.uniform(MATERIALS, restitution=0.5))
    leverage = np.outer(track.times, thing.initial_state.linear_velocity)
    expected = 0.02 / np.sqrt(np.square(leverage).sum())
    got = result.standard_deviations[E]
    # 600 residuals give the noise to some per cent; Huber's loss is flatter than squares.
    assert 0.8 * expected < got < 2.0 * expected


def test_true_values_lie_within_the_stated_uncertainty(event_driven, throws, true_parameters):
    scores = []
    for seed in range(6):
        observed = throws(8, seed, noise=0.005, state_noise=0.004)
        cost = TrajectoryCost(observed, event_driven, MATERIALS)
        optimum = found_optimum(cost)
        result = stated(cost, optimum)
        errors = parameter_vector(optimum) - parameter_vector(true_parameters)
        scores += (errors / result.standard_deviations)[result.identified].tolist()
    # Errors in units of their standard deviation have a root mean square of about one.
    assert len(scores) >= 12
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 2.0


def test_the_distance_to_the_fit_is_part_of_the_uncertainty(gliding_task):
    # A posterior N(m, σ²) is away from u by √(σ² + (m - u)²), root mean square.
    task = gliding_task([0.6, 0.6, 0.6], noise=0.02)
    deviations = [
        identifiability_of_optimum(task, task.searched.to_parameters(point)).standard_deviations[E]
        for point in np.where(np.arange(4) == 3, [[0.6], [0.5]], task.begin)
    ]
    assert deviations[0] < 0.02
    assert deviations[1] == pytest.approx(np.hypot(deviations[0], 0.1), rel=0.1)


def test_observations_that_disagree_leave_much_unknown(gliding_task):
    # Each by itself determines e to 1e-4, and they are 0.3 apart.
    task = gliding_task([0.3, 0.6, 0.9])
    found = task.searched.to_parameters(np.where(np.arange(4) == 3, 0.6, task.begin))
    result = identifiability_of_optimum(task, found)
    assert not result.identified[E] or result.standard_deviations[E] > 0.05


def test_can_be_cancelled(glide, glides):
    flag = StopFlag()
    observed = [glides(np.random.default_rng(0), 0.5)]
    cost = TrajectoryCost(observed, glide.stopped_by(flag), MATERIALS)
    flag.set()
    with pytest.raises(SimulationStoppedError):
        stated(cost, StaticParameters.uniform(MATERIALS))


def test_observations_of_several_objects(glide, glides):
    # Objects glide by their own e, each of which all observations that it has a part in determine.
    generator = np.random.default_rng(0)
    materials = ("ball", "floor", "puck")
    observed = [glides(generator, 0.5, (20, 15), ("ball", "puck")) for _ in range(4)]
    observed.append(glides(generator, 0.5))
    cost = TrajectoryCost(observed, glide, materials)
    parameters = StaticParameters.uniform(materials, restitution=0.5)
    result = stated(cost, parameters, ParameterSpace(materials))
    names = parameter_names(materials)
    assert {name for name, yes in zip(names, result.identified, strict=True) if yes} == {
        "restitution[ball, floor]",
        "restitution[floor, puck]",
    }
