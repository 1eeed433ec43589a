"""θ_s with its uncertainty: survives JSON and YAML, grows with new materials, checks itself."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace, parameter_vector
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread


@st.composite
def learned_parameters(draw):
    materials = draw(st.permutations(["wood", "steel", "cork"]))[: draw(st.integers(1, 3))]
    generator = np.random.default_rng(draw(st.integers(0, 1000)))
    space = ParameterSpace(tuple(materials))
    deviations = generator.random(space.size)
    deviations[generator.random(space.size) < 0.5] = np.nan
    intervals = np.sort(generator.random((space.size, 2)), axis=1)
    intervals[generator.random(space.size) < 0.5] = np.nan
    return LearnedParameters(
        space.to_parameters(generator.random(space.size)),
        deviations,
        generator.random(space.size) < 0.5,
        draw(st.integers(0, 100)),
        draw(st.sampled_from([float("nan"), 0.0, 0.25])),
        draw(st.integers(0, 100)),
        draw(st.sampled_from(["", "cma_es"])),
        intervals,
        initial_spins=InitialSpins(
            {name: SpinSpread(*generator.uniform(0.1, 50.0, 3)) for name in materials[1:]}
        ),
    )


def assert_same(a, b):
    assert a.to_dict() == b.to_dict()
    assert a.materials == b.materials
    np.testing.assert_array_equal(parameter_vector(a.parameters), parameter_vector(b.parameters))
    np.testing.assert_array_equal(a.standard_deviations, b.standard_deviations)
    np.testing.assert_array_equal(a.identified, b.identified)
    np.testing.assert_array_equal(a.intervals, b.intervals)


@given(learned_parameters())
def test_json_and_yaml_give_it_back(learned):
    text = json.dumps(learned.to_dict(), allow_nan=False, sort_keys=True)
    assert_same(learned, LearnedParameters.from_dict(json.loads(text)))
    # YAML sorts keys by default; the order of the materials must not suffer.
    assert_same(
        learned, LearnedParameters.from_dict(yaml.safe_load(yaml.safe_dump(learned.to_dict())))
    )


@given(learned_parameters(), st.permutations(["wood", "steel", "cork", "glass"]))
def test_more_materials_and_back(learned, materials):
    wider = learned.extended(tuple(materials))
    assert wider.identified.sum() == learned.identified.sum()
    assert_same(learned, wider.extended(learned.materials))


def test_files_from_before_there_were_intervals_are_read():
    data = LearnedParameters.defaults(["ball"]).to_dict()
    del data["intervals"]
    assert np.isnan(LearnedParameters.from_dict(data).intervals).all()


def test_defaults():
    learned = LearnedParameters.defaults(["ball", "floor"])
    assert learned.version == 0
    assert np.isnan(learned.cost)
    assert not learned.identified.any()
    assert np.isnan(learned.standard_deviations).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"standard_deviations": [0.1] * 4}, r"shape \(4,\); expected \(5,\)"),
        ({"standard_deviations": [-0.1] * 5}, "expected finite numbers ≥ 0"),
        ({"identified": "yes"}, "identified"),
        ({"intervals": [[0.0, 1.0]]}, r"shape \(1, 2\); expected \(5, 2\)"),
        ({"intervals": [[1.0, 0.0]] * 5}, "expected two finite numbers, the lower one first"),
        (
            {"intervals": [[0.0, float("nan")]] * 5},
            "expected two finite numbers, the lower one first",
        ),
        ({"intervals": "wide"}, "expected 5 pairs of numbers"),
        ({"version": -1}, "version is -1"),
        ({"version": 1.5}, "version is 1.5"),
        ({"cost": -1.0}, "cost is -1"),
        ({"observation_count": True}, "observation count is True"),
    ],
)
def test_nonsense_is_refused(change, message):
    good = {
        "parameters": StaticParameters.uniform(["ball"]),
        "standard_deviations": [0.1] * 5,
        "identified": [True] * 5,
        "version": 1,
        "cost": 0.1,
        "observation_count": 1,
        "method": "random",
    }
    with pytest.raises(InvalidInputError, match=message):
        LearnedParameters(**{**good, **change})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "something/else"}, "format 'something/else'"),
        ({"version": None}, "version is None"),
        ({"parameters": {}}, "cannot be read"),
        ({"materials": ["cork"]}, "expected those of the materials"),
        ({"identified": ["weight[ball]"]}, r"'weight\[ball\]' is said to be identified"),
        ({"standard_deviations": {}}, "cannot be read"),
        ({"intervals": {"weight[ball]": [0.0, 1.0]}}, r"'weight\[ball\]' is said to be"),
        ({"intervals": {"density[ball]": 1.0}}, "intervals"),
    ],
)
def test_files_with_nonsense_are_refused(change, message):
    data = {**LearnedParameters.defaults(["ball"]).to_dict(), **change}
    with pytest.raises(InvalidInputError, match=message):
        LearnedParameters.from_dict(data)
