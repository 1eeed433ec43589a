"""What is too large is refused before anything is made in proportion to it."""

from __future__ import annotations

import json
import tracemalloc
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import InputLimits, check_limit, limits, use_limits
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject, load_observation
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory

LITTLE = 20_000_000
"""bytes: of what a refusal may take at most, while what is refused would take gigabytes."""


@contextmanager
def little_memory():
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < LITTLE
    finally:
        tracemalloc.stop()


@pytest.fixture
def own_limits():
    """Limits that a test sets are its own."""
    before = limits()
    yield use_limits
    use_limits(before)


def observed(material="ball", times=(0.0, 0.1, 0.2)):
    return ObservedObject(
        SceneObject("ball", material, Sphere(0.05)),
        Trajectory(times, np.zeros((len(times), 3))),
        ObjectState((0, 0, 1)),
    )


def test_the_largest_is_taken_and_one_more_refused(own_limits):
    own_limits(InputLimits(most_materials=3))
    check_limit("most_materials", 3, "materials")
    with pytest.raises(InvalidInputError, match=r"got 4, expected at most 3; .*most_materials"):
        check_limit("most_materials", 4, "materials")
    with pytest.raises(InvalidInputError, match=r"at most 600 s"):
        check_limit("longest_observation", float("nan"), "duration")


NAMES = [f"material {i}" for i in range(20_000)]


@pytest.mark.parametrize(
    ("read", "data"),
    [
        (StaticParameters.from_dict, {"density": dict.fromkeys(NAMES, 1.0), "pairs": []}),
        (
            LearnedParameters.from_dict,
            {
                **LearnedParameters.defaults(["ball"]).to_dict(),
                "materials": NAMES,
                "parameters": {"density": dict.fromkeys(NAMES, 1.0), "pairs": []},
            },
        ),
        (
            ParameterPosterior.from_dict,
            {"materials": NAMES, "mean": [], "factor": [], "bounds": {}, "intervals": {}},
        ),
    ],
)
def test_many_materials_are_counted_before_their_pairs_are_made(read, data):
    with little_memory(), pytest.raises(InvalidInputError, match="got 20000, expected at most"):
        read(data)


def test_an_observation_is_of_a_size_to_learn_from(own_limits):
    one = Observation(Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]), (observed(),), 0.0)
    one.check_limits()
    assert Observation.from_json(one.to_json()).id == one.id
    longer = replace(one, objects=(observed(times=(0.0, 0.1, 1e6)),), id="")
    with pytest.raises(InvalidInputError, match=r"s from begin to end .* got 1e\+06"):
        Observation.from_json(longer.to_json())
    for few, words in (
        (InputLimits(most_materials=1), "materials of observation"),
        (InputLimits(most_points=2), "points of observation"),
        (InputLimits(most_primitives=1), None),
    ):
        own_limits(few)
        if words is None:
            Observation.from_json(one.to_json())
        else:
            with pytest.raises(InvalidInputError, match=words):
                Observation.from_json(one.to_json())


def test_texts_are_measured_before_they_are_parsed(own_limits, tmp_path):
    own_limits(InputLimits(longest_text=1000))
    file = tmp_path / "observation.json"
    file.write_text("[" * 1001)
    for read in (lambda: load_observation(file), lambda: Observation.from_json("[" * 1001)):
        with pytest.raises(InvalidInputError, match="got 1001, expected at most 1000 bytes"):
            read()


def test_json_of_many_levels_is_one_clear_error():
    with pytest.raises(InvalidInputError, match="too many levels"):
        Observation.from_json("[" * 100_000)


def test_environments_have_so_many_parts_at_most(own_limits):
    planes = [Plane(f"plane {i}", "floor", (0, 0, 1), -float(i)) for i in range(3)]
    data = json.loads(json.dumps(Environment(planes).to_dict()))
    own_limits(InputLimits(most_primitives=2))
    with pytest.raises(InvalidInputError, match="planes and boxes: got 3"):
        Environment.from_dict(data)


def test_names_are_short():
    with pytest.raises(InvalidInputError, match="of 1000000 characters; expected at most 256"):
        SceneObject("ball", "b" * 1_000_000, Sphere(0.05))


@pytest.mark.parametrize("name", ["\0", "ball\0", "ball\0of another"])
def test_names_have_no_nul_at_which_a_database_would_end_them(name):
    with pytest.raises(InvalidInputError, match="expected a name without NUL"):
        SceneObject("ball", name, Sphere(0.05))
    with pytest.raises(InvalidInputError, match="expected a name without NUL"):
        StaticParameters.uniform([name])
