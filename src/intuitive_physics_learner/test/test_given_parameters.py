"""Values that a user gives: priors, values that are held, starts."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import (
    DEFAULT_BOUNDS,
    Bounds,
    ParameterSpace,
    parameter_vector,
)
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, learn
from intuitive_physics_learner.given_parameters import GIVEN_AS, given_parameters
from intuitive_physics_learner.search.search_space import ActiveSpace

from .cases import MATERIALS, E, rerouted

NAMES = parameter_names(MATERIALS)
STATIC = NAMES.index("static_friction[ball, floor]")
DYNAMIC = NAMES.index("dynamic_friction[ball, floor]")


def options(iterations=300, **others):
    return LearningOptions(criteria=ConvergenceCriteria(iterations), **others)


def values(deviations=None, **coefficients):
    """θ_s with the given coefficients of ball and floor, and standard deviations by index."""
    parameters = StaticParameters.uniform(MATERIALS).with_pair("ball", "floor", **coefficients)
    sigma = np.full(len(NAMES), np.nan)
    for index, deviation in (deviations or {}).items():
        sigma[index] = deviation
    identified = np.zeros(len(NAMES), dtype=bool)
    return LearnedParameters(parameters, sigma, identified, 0, np.nan, 0, "")


@pytest.fixture(scope="module")
def noisy_glides(glides):
    """Observations of e = 0.7 with noise."""
    generator = np.random.default_rng(3)
    observations = []
    for _ in range(3):
        observation = glides(generator, 0.7, counts=(10,))
        noise = generator.normal(0.0, 0.1, (10, 3))
        observations.append(rerouted(observation, lambda _, positions, n=noise: positions + n))
    return observations


def restitution(learned):
    return learned.parameters.pair("ball", "floor")["restitution"]


def test_a_prior_adds_its_information_to_that_of_the_observations(glide, noisy_glides):
    flat = learn(noisy_glides, glide, options()).learned
    prior = given_parameters(values({E: 0.05}, restitution=0.7))
    both = learn(noisy_glides, glide, options(), previous=prior).learned
    restitution = flat.posterior.information[E, E]
    assert both.posterior.information[E, E] == pytest.approx(restitution + 1 / 0.05**2, rel=0.02)
    assert both.given.to_dict() == prior.given.to_dict()
    again = learn(noisy_glides, glide, options(), previous=both).learned
    # The observations are the same, so nothing is learned twice.
    assert again.posterior.information[E, E] == pytest.approx(restitution + 1 / 0.05**2, rel=0.02)


def test_a_sharp_prior_is_stronger_than_noisy_observations(glide, noisy_glides):
    assert abs(restitution(learn(noisy_glides, glide, options()).learned) - 0.6) > 0.02
    prior = given_parameters(values({E: 1e-4}, restitution=0.6))
    learned = learn(noisy_glides, glide, options(), previous=prior).learned
    assert restitution(learned) == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize("method", ["levenberg_marquardt", "cma_es", "random"])
def test_held_values_are_not_searched(event_driven, throws, method):
    held = given_parameters(
        values(restitution=0.6, static_friction=0.45, rolling_friction=0.03),
        "fixed",
        ["restitution[floor, ball]", "static_friction[ball,floor]"],
    )
    learned = learn(throws(4, 1), event_driven, options(200, method=method), previous=held).learned
    pair = learned.parameters.pair("ball", "floor")
    assert (pair["restitution"], pair["static_friction"]) == (0.6, 0.45)
    assert pair["dynamic_friction"] != 0.4
    assert pair["dynamic_friction"] <= 0.45
    assert learned.identified[E]
    assert learned.standard_deviations[E] == 0.0
    assert learned.given.fixed[[E, STATIC]].all()
    assert learned.given.fixed.sum() == 2
    drawn = learned.posterior.space.to_values(learned.posterior.draw(50, np.random.default_rng(0)))
    assert drawn[:, E] == pytest.approx(np.full(50, 0.6), abs=1e-4)


def test_nothing_left_to_search_is_an_error(glide, glides):
    held = given_parameters(values(), "fixed")
    with pytest.raises(InvalidInputError, match="held"):
        learn([glides(np.random.default_rng(0), 0.5)], glide, options(), previous=held)


def test_values_outside_the_bounds_are_an_error():
    with pytest.raises(
        InvalidInputError, match=r"rolling_friction\[ball, floor\] is 0.5; expected 0.0001 to 0.2"
    ):
        given_parameters(values(rolling_friction=0.5))
    wide = {"rolling_friction": Bounds(1e-4, 1.0, "logarithmic")}
    assert given_parameters(values(rolling_friction=0.5), bounds=wide).given is None
    # A value that is not given may be what it is.
    given_parameters(values(rolling_friction=0.5), "fixed", ["restitution[ball, floor]"])


@pytest.mark.parametrize("as_what", ["prior", "fixed"])
def test_given_values_outside_the_bounds_of_a_search_are_an_error(glide, glides, as_what):
    result = given_parameters(values({E: 0.01}, restitution=0.9), as_what, [NAMES[E]])
    narrow = options(bounds={"restitution": Bounds(0.2, 0.8)})
    with pytest.raises(
        InvalidInputError, match=r"restitution\[ball, floor\] is 0.9; .* 0.2 to 0.8"
    ):
        learn([glides(np.random.default_rng(0), 0.5)], glide, narrow, previous=result)


def test_a_start_may_be_left(glide, glides):
    start = given_parameters(values({E: 1e-5}, restitution=0.6), "start")
    assert start.given is None
    observations = [glides(np.random.default_rng(0), 0.5)]
    assert restitution(
        learn(observations, glide, options(), previous=start).learned
    ) == pytest.approx(0.5, abs=1e-3)


def test_a_new_gift_replaces_that_of_its_parameters_only():
    first = given_parameters(values({E: 0.05, STATIC: 0.02}, restitution=0.6))
    later = values(restitution=0.3, rolling_friction=0.05)
    second = given_parameters(later, "fixed", [NAMES[E]], newest=first)
    pair = second.parameters.pair("ball", "floor")
    assert (pair["restitution"], pair["rolling_friction"]) == (0.3, 0.01)
    assert np.flatnonzero(second.given.fixed).tolist() == [E]
    assert second.given.prior.information[STATIC, STATIC] == pytest.approx(
        first.given.prior.information[STATIC, STATIC]
    )
    third = given_parameters(later, "start", [NAMES[E]], newest=second)
    assert not third.given.fixed.any()
    assert not third.given.prior.information[E].any()


def test_other_materials_may_come():
    first = given_parameters(values({E: 0.05}, restitution=0.6))
    ice = StaticParameters.uniform(("ice", "floor")).with_density("ice", 917.0)
    size = len(parameter_names(ice.materials))
    fresh = LearnedParameters(ice, [np.nan] * size, [False] * size, 0, np.nan, 0, "")
    both = given_parameters(fresh, "fixed", ["density[ice]"], newest=first)
    assert both.materials == ("ball", "floor", "ice")
    assert both.parameters.density.tolist() == [500.0, 500.0, 917.0]
    names = parameter_names(both.materials)
    assert both.given.fixed[names.index("density[ice]")]
    e = names.index("restitution[ball, floor]")
    assert both.given.prior.information[e, e] == pytest.approx(1 / 0.05**2)


@pytest.mark.parametrize(
    ("as_what", "names", "error"),
    [
        ("guess", [], "guess"),
        ("fixed", ["restitution[ball, sky]"], "sky"),
        ("fixed", ["bounciness[ball, floor]"], "bounciness"),
        ("prior", ["density"], "density"),
    ],
)
def test_unknown_names(as_what, names, error):
    with pytest.raises(UnknownNameError, match=error):
        given_parameters(values(), as_what, names)


def test_a_prior_without_width_is_held():
    exact = LearnedParameters(
        values().parameters, np.zeros(14), np.arange(14) == E, 0, np.nan, 0, ""
    )
    version = given_parameters(exact)
    assert np.flatnonzero(version.given.fixed).tolist() == [E]
    assert not version.given.prior.factor.size


def test_a_posterior_of_other_values_is_an_error():
    version = given_parameters(values({E: 0.05}, restitution=0.6))
    again = given_parameters(version).posterior
    assert again.information == pytest.approx(version.posterior.information)
    moved = replace(version, parameters=values(restitution=0.7).parameters)
    with pytest.raises(InvalidInputError, match=r"restitution\[ball, floor\] is at 0.7 .* at 0.6"):
        given_parameters(moved)
    # Given by itself, a value has no posterior.
    given_parameters(moved, "prior", [NAMES[E]])


def test_a_one_sided_interval_is_a_wide_prior():
    ends = np.full((14, 2), np.nan)
    ends[E] = [0.4, 1.0]
    identified = np.arange(14) == E
    sigma = np.where(identified, 0.02, np.nan)
    sided = LearnedParameters(
        values(restitution=0.5).parameters, sigma, identified, 0, np.nan, 0, "", ends
    )
    version = given_parameters(sided)
    variance = 0.02**2 + 0.6**2 / 12
    assert version.given.prior.information[E, E] == pytest.approx(1 / variance)
    assert version.posterior.intervals[E].tolist() == [0.4, 1.0]


@settings(max_examples=50)
@given(
    st.lists(st.floats(0.0, 1.0), min_size=14, max_size=14),
    st.lists(st.one_of(st.just(np.nan), st.floats(1e-4, 10.0)), min_size=14, max_size=14),
    st.sampled_from(GIVEN_AS),
    st.sets(st.sampled_from(NAMES)),
)
def test_given_values_become_the_posterior(unit, deviations, as_what, names):
    parameters = ParameterSpace(MATERIALS).to_parameters(unit)
    raw = LearnedParameters(parameters, deviations, np.zeros(14, bool), 0, np.nan, 0, "")
    # One friction of a pair alone may contradict the other one.
    names |= {name.replace("dynamic", "static") for name in names}
    names |= {name.replace("static", "dynamic") for name in names}
    version = given_parameters(raw, as_what, sorted(names))
    chosen = np.array([not names or name in names for name in NAMES])
    got, wanted = parameter_vector(version.parameters), parameter_vector(parameters)
    assert (got[chosen] == wanted[chosen]).all()
    if as_what == "fixed":
        assert (version.given.fixed == chosen).all()
    # A standard deviation that is large beside the bounds says nothing.
    elif as_what == "start" or not np.isfinite(deviations)[chosen].any():
        assert version.given is None
    assert (
        LearnedParameters.from_dict(json.loads(json.dumps(version.to_dict()))).to_dict()
        == version.to_dict()
    )


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 1.0), min_size=14, max_size=14), st.floats(0.0, 1.0))
def test_static_friction_that_is_held_does_not_follow_dynamic_friction(unit, dynamic):
    space = ParameterSpace(MATERIALS)
    start = space.to_parameters(unit)
    active = np.arange(14) == DYNAMIC
    coefficients = ActiveSpace(space, active, start).to_parameters([dynamic]).pair("ball", "floor")
    held = start.pair("ball", "floor")["static_friction"]
    assert coefficients["static_friction"] == held
    assert coefficients["dynamic_friction"] == min(dynamic, held)
    assert DEFAULT_BOUNDS["dynamic_friction"] == Bounds(0.0, 1.0)
