"""Only parameters that J cannot depend on are left out of a search."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import ParameterSpace, parameter_vector
from intuitive_physics.scene import Environment
from intuitive_physics_learner import (
    ActiveSpace,
    LearningOptions,
    TrajectoryCost,
    active_parameters,
    learn,
)


def active_names(observations, materials):
    active = active_parameters(observations, materials)
    return {n for n, yes in zip(parameter_names(materials), active, strict=True) if yes}


def coefficients(a, b):
    kinds = ("static_friction", "dynamic_friction", "rolling_friction", "restitution")
    return {f"{kind}[{a}, {b}]" for kind in kinds}


def test_lone_objects(glides):
    generator = np.random.default_rng(0)
    observed = [glides(generator, 0.5), glides(generator, 0.5, materials=("cork",))]
    expected = coefficients("ball", "floor") | coefficients("floor", "cork")
    assert active_names(observed, ("ball", "floor", "cork", "stone")) == expected


def test_objects_together(glides):
    observed = [glides(np.random.default_rng(0), 0.5, (3, 4, 5), ("ball", "cork", "ball"))]
    expected = {"density[ball]", "density[cork]"}
    for pair in (("ball", "floor"), ("floor", "cork"), ("ball", "cork"), ("ball", "ball")):
        expected |= coefficients(*pair)
    assert active_names(observed, ("ball", "floor", "cork")) == expected


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_the_cost_depends_on_no_other(event_driven, throws, seed):
    observed = throws(2, 0)
    materials = ("ball", "floor", "glass")
    cost = TrajectoryCost(observed, event_driven, materials)
    active = active_parameters(observed, materials)
    space = ParameterSpace(materials)
    generator = np.random.default_rng(seed)
    point, other = generator.random((2, space.size))
    other[active] = point[active]
    first, second = cost.distances([space.to_parameters(point), space.to_parameters(other)])
    np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-9)


def test_the_space_of_active_parameters_moves_only_those():
    space = ParameterSpace(("a", "b"))
    theta = StaticParameters.uniform(("a", "b"))
    active = np.zeros(space.size, dtype=bool)
    active[[4, 9]] = True
    searched = ActiveSpace(space, active, theta)
    assert searched.size == 2
    moved = searched.to_parameters([0.25, 0.75])
    np.testing.assert_allclose(searched.to_unit(moved), [0.25, 0.75])
    changed = ~np.isclose(parameter_vector(moved), parameter_vector(theta))
    assert set(np.flatnonzero(changed)) == {4, 9}


def test_objects_in_empty_space_teach_nothing(glide, glides):
    observed = replace(glides(np.random.default_rng(0), 0.5), environment=Environment())
    with pytest.raises(InvalidInputError, match="anything it could touch"):
        learn([observed], glide, LearningOptions())
