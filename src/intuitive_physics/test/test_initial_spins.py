"""How balls are thrown: what is kept of it comes back, and what a guess of a spin is."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread, unknown_spin
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState

BALL = Sphere(0.05)
POSITIVE = st.floats(1e-3, 1e4)
SPREADS = st.builds(SpinSpread, POSITIVE, st.floats(0.0, 1e6), POSITIVE)
SPINS = st.builds(InitialSpins, st.dictionaries(st.sampled_from("abcd"), SPREADS))


def guessed(deviation=10.0, spin=(0.0, 0.0, 0.0)):
    covariance = np.diag(np.repeat([1e-6, 0.0, 1e-4, deviation**2], 3))
    return ObjectState((0, 0, 1), (0, 0, 0, 1), (1, 0, 0), spin, covariance)


@given(SPINS)
def test_they_come_back(spins):
    text = json.dumps(spins.to_dict(), allow_nan=False)
    assert InitialSpins.from_dict(json.loads(text)) == spins
    assert bool(spins) == bool(spins.by_material)


@given(SPINS, SPINS)
def test_what_is_newer_takes_the_place_of_the_same_materials_alone(older, newer):
    both = older.updated(newer).by_material
    assert both == {**older.by_material, **newer.by_material}


@given(SPINS)
def test_they_belong_to_a_version_of_the_parameters(spins):
    defaults = LearnedParameters.defaults(list("abcd"))
    assert not defaults.initial_spins
    data = {**defaults.to_dict(), "initial_spins": spins.to_dict()}
    learned = LearnedParameters.from_dict(json.loads(json.dumps(data)))
    assert learned.initial_spins == spins
    assert learned.to_dict() == data
    wider = learned.extended(["e", *"dcba"])
    assert wider.initial_spins == spins
    assert wider.extended(["a"]).initial_spins == spins.among(["a"])


def test_files_without_them_are_read():
    data = LearnedParameters.defaults(["a"]).to_dict()
    del data["initial_spins"]
    assert not LearnedParameters.from_dict(data).initial_spins


@given(st.floats(0.0, 1e5))
def test_the_error_falls_with_the_number_of_throws(count):
    error = SpinSpread(3.0, count, 10.0).relative_error
    # Without a throw the guess is right to a factor of four; each exact throw has information 6.
    assert error**-2 == pytest.approx(6.0 * count + np.log(4.0) ** -2)


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        ([], "initial spins cannot be read .*expected deviation, count and stated"),
        ({"a": 3.0}, "initial spins cannot be read"),
        ({"a": {"deviation": 1.0, "count": 2.0}}, "initial spins cannot be read .'stated'"),
        ({"a": {"deviation": 0.0, "count": 2.0, "stated": 1.0}}, "deviation of initial spins is 0"),
        ({"a": {"deviation": 1.0, "count": -2.0, "stated": 1.0}}, "number of throws is -2"),
        ({"a": {"deviation": 1.0, "count": 2.0, "stated": "x"}}, "unknown spin is 'x'; expected"),
        ({" ": {"deviation": 1.0, "count": 2.0, "stated": 1.0}}, "material is ' '; expected"),
    ],
)
def test_wrong_data(data, complaint):
    with pytest.raises(InvalidInputError, match=complaint):
        InitialSpins.from_dict(data)


def test_other_materials_than_those_of_the_parameters():
    data = LearnedParameters.defaults(["a"]).to_dict()
    data["initial_spins"] = InitialSpins({"b": SpinSpread(1.0, 2.0, 10.0)}).to_dict()
    with pytest.raises(InvalidInputError, match="initial spins are of 'b'; expected materials"):
        LearnedParameters.from_dict(data)
    with pytest.raises(InvalidInputError, match="initial spins of a are 3; expected a SpinSpread"):
        InitialSpins({"a": 3})


@given(POSITIVE)
def test_a_guess_is_recognised(deviation):
    assert unknown_spin(BALL, guessed(deviation)) == pytest.approx(deviation)


def test_what_was_seen_is_no_guess():
    correlated, uneven = guessed().covariance.copy(), guessed().covariance.copy()
    correlated[6, 9] = correlated[9, 6] = 1e-3
    uneven[9, 9] *= 0.5
    assert unknown_spin(BALL, guessed().with_covariance(correlated)) is None
    assert unknown_spin(BALL, guessed().with_covariance(uneven)) is None
    assert unknown_spin(BALL, guessed(spin=(1.0, 0.0, 0.0))) is None
    assert unknown_spin(BALL, guessed(0.0)) is None
    assert unknown_spin(Box((0.1, 0.1, 0.1)), guessed()) is None
