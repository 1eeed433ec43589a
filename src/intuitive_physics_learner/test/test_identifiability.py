"""Parameters that data do not determine are not identified; the others have a true uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import (
    Bounds,
    ParameterSpace,
    parameter_vector,
    parameters_of_vector,
)
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningCancelledError,
    ParameterSearch,
    TrajectoryCost,
    identify,
    make_update_rule,
)
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.cost.wrapped_costs import InterruptibleCost
from intuitive_physics_learner.search.identifiability import identification_trials
from intuitive_physics_learner.search.parameter_axes import ParameterAxes

MATERIALS = ("ball", "floor")
SPACE = ParameterSpace(MATERIALS)


def found_optimum(cost, seed=0, iterations=1500):
    rule = make_update_rule("hybrid_random", SPACE.size, np.random.default_rng(seed))
    search = ParameterSearch(cost.costs, SPACE, rule)
    return search.run(ConvergenceCriteria(iterations)).parameters


def identified_names(result):
    return {n for n, yes in zip(parameter_names(MATERIALS), result.identified, strict=True) if yes}


def with_track(observation, times, positions):
    """The observation of one object, on another track."""
    (thing,) = observation.objects
    return replace(observation, objects=(replace(thing, trajectory=Trajectory(times, positions)),))


def test_only_active_parameters_are_identified(event_driven, throws, true_parameters):
    cost = TrajectoryCost(throws(6, 0, noise=0.003), event_driven, MATERIALS)
    result = identify(cost, SPACE, true_parameters)
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
    result = identify(TrajectoryCost(flight, event_driven, MATERIALS), SPACE, true_parameters)
    assert not result.identified.any()
    assert not result.responsive.any()


def test_a_response_below_the_noise_identifies_nothing(glide, glides):
    # e acts, but less than the noise hides: 0.1 s at about 1 mm/s against 1 m.
    generator = np.random.default_rng(0)
    observation = glides(generator, 0.5, counts=(20,))
    track = observation.objects[0].trajectory
    noisy = track.positions + generator.normal(size=(20, 3))
    cost = TrajectoryCost([with_track(observation, 1e-3 * track.times, noisy)], glide, MATERIALS)
    result = identify(cost, SPACE, StaticParameters.uniform(MATERIALS))
    assert result.responsive.sum() == 1
    assert not result.identified.any()


def test_bounds_that_freeze_a_parameter_leave_nothing_to_identify(
    event_driven, throws, true_parameters
):
    space = ParameterSpace(MATERIALS, {"restitution": Bounds(0.7, 0.7)})
    cost = TrajectoryCost(throws(4, 0, noise=0.003), event_driven, MATERIALS)
    result = identify(cost, space, true_parameters)
    assert not result.responsive[parameter_names(MATERIALS).index("restitution[ball, floor]")]


def test_failed_worlds_do_not_count_as_a_response(glide, glides):
    # Where e > 0.99 the engine fails; a world that starts at rest responds to nothing else.
    observation = glides(np.random.default_rng(0), 0.0)
    (thing,) = observation.objects
    resting = replace(thing, initial_state=ObjectState(thing.initial_state.position))
    cost = TrajectoryCost([replace(observation, objects=(resting,))], glide, MATERIALS)
    result = identify(cost, SPACE, StaticParameters.uniform(MATERIALS))
    assert not result.responsive.any()


def test_standard_deviation_of_a_linear_model(glide, glides):
    # x = x0 + e v t with independent noise s: var(e) = s² / Σ (v t)² by least squares.
    generator = np.random.default_rng(1)
    observation = glides(generator, 0.5, counts=(400,))
    thing = observation.objects[0]
    track = thing.trajectory
    noisy = track.positions + generator.normal(0.0, 0.02, (400, 3))
    cost = TrajectoryCost([with_track(observation, track.times, noisy)], glide, MATERIALS)
    result = identify(cost, SPACE, StaticParameters.uniform(MATERIALS, restitution=0.5))
    leverage = np.outer(track.times, thing.initial_state.linear_velocity)
    expected = 0.02 / np.sqrt(np.square(leverage).sum())
    got = result.standard_deviations[parameter_names(MATERIALS).index("restitution[ball, floor]")]
    # 1200 residuals give the noise to some per cent, chance correlation some more.
    assert 0.8 * expected < got < 1.5 * expected


def test_true_values_lie_within_the_stated_uncertainty(event_driven, throws, true_parameters):
    scores = []
    for seed in range(6):
        observed = throws(8, seed, noise=0.005, state_noise=0.004)
        cost = TrajectoryCost(observed, event_driven, MATERIALS)
        optimum = found_optimum(cost)
        result = identify(cost, SPACE, optimum)
        errors = parameter_vector(optimum) - parameter_vector(true_parameters)
        scores += (errors / result.standard_deviations)[result.identified].tolist()
    # Errors in units of their standard deviation have a root mean square of about one.
    assert len(scores) >= 12
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 2.0


def test_can_be_cancelled(glide, glides):
    cost = TrajectoryCost([glides(np.random.default_rng(0), 0.5)], glide, MATERIALS)
    asked = iter([False, True])
    with pytest.raises(LearningCancelledError, match="cancelled"):
        identify(
            InterruptibleCost(cost, lambda: next(asked)),
            SPACE,
            StaticParameters.uniform(MATERIALS),
        )


@settings(max_examples=50)
@given(data=st.data())
def test_each_axis_moves_one_parameter(data):
    unit = st.floats(0.0, 1.0)
    space = ParameterSpace(("a", "b"))
    point = data.draw(st.lists(unit, min_size=space.size, max_size=space.size))
    theta = space.to_parameters(point)
    axes = ParameterAxes(space, theta)
    assert (axes.lower <= axes.origin + 1e-9).all()
    assert (axes.origin <= axes.upper + 1e-9).all()
    axis = data.draw(st.integers(0, axes.size - 1))
    before = parameter_vector(theta)
    for place in (data.draw(unit), float(axes.origin[axis])):
        after = parameter_vector(axes.moved(axis, place))
        others = np.arange(axes.size) != axis
        np.testing.assert_allclose(after[others], before[others], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(after[axis], before[axis], rtol=1e-9, atol=1e-9)


def test_slopes_are_derivatives():
    theta = StaticParameters.uniform(("a", "b"))
    axes = ParameterAxes(ParameterSpace(("a", "b")), theta)
    for axis in range(axes.size):
        h = 1e-6
        up = parameter_vector(axes.moved(axis, axes.origin[axis] + h))[axis]
        down = parameter_vector(axes.moved(axis, axes.origin[axis] - h))[axis]
        np.testing.assert_allclose((up - down) / (2 * h), axes.slopes[axis], rtol=1e-4)


def test_vector_and_back():
    theta = ParameterSpace(("a", "b", "c")).to_parameters(np.random.default_rng(0).random(27))
    back = parameters_of_vector(theta.materials, parameter_vector(theta))
    assert (back.coefficients == theta.coefficients).all()
    assert (back.density == theta.density).all()


class CountingCost(TrajectoryCost):
    """Counts the trials it is asked for."""

    asked = 0

    def trial_distances(self, trials):
        self.asked += trials.size
        return super().trial_distances(trials)

    def trial_residuals(self, trials):
        self.asked += trials.size
        return super().trial_residuals(trials)


def test_simulations_within_the_stated_number(event_driven, throws, true_parameters):
    observed = throws(6, 0, noise=0.003)
    cost = CountingCost(observed, event_driven, MATERIALS)
    identify(cost, SPACE, true_parameters)
    influence = parameter_influence(observed, MATERIALS)
    assert 0 < cost.asked <= identification_trials(influence)
    # All parameters of all observations would be more.
    assert identification_trials(influence) < 6 * influence.size
