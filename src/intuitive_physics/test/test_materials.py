"""θ_s, its count (Eqs. 1, 3) and its search space."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.materials import (
    StaticParameters,
    material_pairs,
    parameter_count,
    parameter_names,
)
from intuitive_physics.parameter_space import Bounds, ParameterSpace, parameter_vector

NAMES = ("cork", "steel", "floor")
UNIT = arrays(float, parameter_count(3), elements=st.floats(0.0, 1.0))


@pytest.mark.parametrize(("materials", "count"), [(1, 5), (2, 14), (11, 275), (21, 945)])
def test_parameter_count_of_the_paper(materials, count):
    names = [str(k) for k in range(materials)]
    assert parameter_count(materials) == count
    assert len(parameter_names(names)) == count
    assert len(set(parameter_names(names))) == count


@given(UNIT)
def test_every_point_of_the_cube_is_valid_and_reads_back(unit):
    # The map is one to one wherever dynamic friction has room between its bounds.
    space = ParameterSpace(NAMES)
    theta = space.to_parameters(unit)
    mu_s, mu_d, _, _ = theta.coefficients
    assert (mu_d <= mu_s).all()
    again = space.to_parameters(space.to_unit(theta))
    np.testing.assert_allclose(parameter_vector(again), parameter_vector(theta), rtol=1e-9)


@given(UNIT)
def test_pairs_are_symmetric_and_named_like_the_vector(unit):
    theta = ParameterSpace(NAMES).to_parameters(unit)
    vector = dict(zip(parameter_names(NAMES), parameter_vector(theta), strict=True))
    for a, b in material_pairs(NAMES):
        assert theta.pair(a, b) == theta.pair(b, a)
        for name, value in theta.pair(a, b).items():
            assert vector[f"{name}[{a}, {b}]"] == value
    assert vector["density[steel]"] == theta.density[1]


@given(UNIT)
def test_plain_data_reads_back(unit):
    theta = ParameterSpace(NAMES).to_parameters(unit)
    again = StaticParameters.from_dict(theta.to_dict())
    np.testing.assert_array_equal(parameter_vector(again), parameter_vector(theta))


def test_scales():
    # Half way on a logarithmic scale is the geometric mean, on a linear one the mean.
    space = ParameterSpace(
        ("a",), {"density": Bounds(10, 1000, "logarithmic"), "restitution": Bounds(0.2, 0.8)}
    )
    theta = space.to_parameters(np.full(space.size, 0.5))
    assert theta.density[0] == pytest.approx(100.0)
    assert theta.coefficients[3, 0, 0] == pytest.approx(0.5)


def test_other_order_of_materials_is_the_same_point():
    rng = np.random.default_rng(0)
    theta = ParameterSpace(NAMES).to_parameters(rng.uniform(size=parameter_count(3)))
    other = ParameterSpace(NAMES[::-1])
    swapped = other.to_parameters(other.to_unit(theta))
    for a, b in material_pairs(NAMES):
        assert swapped.pair(a, b) == pytest.approx(theta.pair(a, b))


def test_extending_keeps_what_is_known():
    theta = StaticParameters.uniform(["cork", "floor"], restitution=0.9, density=111.0)
    wider = theta.extended(["steel", "floor", "cork"])
    assert wider.pair("cork", "floor")["restitution"] == 0.9
    assert wider.pair("steel", "floor")["restitution"] == 0.5
    assert wider.density.tolist() == [500.0, 111.0, 111.0]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda t: t.with_pair("a", "b", dynamic_friction=0.9), "dynamic ≤ static"),
        (lambda t: t.with_pair("a", "b", dynamic_friction=-0.1), "0 ≤ dynamic"),
        (lambda t: t.with_pair("a", "b", restitution=1.2), "restitution"),
        (lambda t: t.with_pair("a", "b", rolling_friction=-1), "rolling"),
        (lambda t: t.with_pair("a", "b", static_friction=float("nan")), "finite"),
        (lambda t: t.with_pair("a", "c", restitution=0.1), "'c'"),
        (lambda t: t.with_pair("a", "b", bounce=0.1), "bounce"),
        (lambda t: t.with_density("a", -1.0), "density"),
        (lambda t: t.with_density("a", 0.0), "density"),
        (lambda t: StaticParameters(["a", "a"], t.density, t.coefficients), "each name once"),
        (lambda t: StaticParameters(["a"], t.density, t.coefficients), "shape"),
        (lambda t: StaticParameters.from_dict({"density": {"a": 1.0}, "pairs": []}), "missing"),
        (lambda t: StaticParameters.from_dict({}), "lack"),
        (lambda t: Bounds(1.0, 0.0), "lower ≤ upper"),
        (lambda t: Bounds(0.0, 1.0, "logarithmic"), "above 0"),
        (lambda t: Bounds(0.0, 1.0, "cubic"), "cubic"),
        (lambda t: ParameterSpace(("a",), {"bounce": Bounds(0, 1)}), "bounce"),
        (lambda t: ParameterSpace(("a",), {"restitution": Bounds(0, 2)}), "at most 1"),
        (lambda t: ParameterSpace(("a",)).to_parameters([0.5]), "shape"),
    ],
)
def test_bad_parameters_are_refused(change, word):
    theta = StaticParameters.uniform(["a", "b"])
    with pytest.raises(IntuitivePhysicsError, match=word):
        change(theta)
