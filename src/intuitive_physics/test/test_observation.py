"""States, scenes and observations: checked on the way in, whole on the way out."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.observation import (
    Detections,
    Observation,
    ObservedObject,
    SeenSpin,
    load_observation,
    save_observation,
    symmetric_matrices,
    unique_numbers,
)
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory


def make_observation(seed: int, points: int = 5) -> Observation:
    rng = np.random.default_rng(seed)
    environment = Environment(
        [
            Plane("floor", "room", rng.normal(size=3), rng.normal()),
            Plane("table", "wood", (0, 0, 1), 0.7, [(0, 0, 0.7), (1, 0, 0.7), (0, 1, 0.7)]),
        ],
        [StaticBox("step", "wood", rng.normal(size=3), (0, 0, 0, 1), (1, 2, 3))],
        rng.normal(size=3),
        "lab",
    )
    root = rng.normal(size=(12, 12))
    seen = ObservedObject(
        SceneObject("ball", "cork", Sphere(0.1)),
        Trajectory(np.cumsum(rng.uniform(0.01, 0.1, points)), rng.normal(size=(points, 3))),
        ObjectState(rng.normal(size=3), covariance=root @ root.T),
    )
    return Observation(environment, (seen,), 0.0)


@st.composite
def detections(draw):
    """Any number of points with covariances of any size, singular ones among them."""
    count = draw(st.integers(1, 12))
    steps = draw(arrays(np.float64, count, elements=st.floats(1e-3, 10.0)))
    positions = draw(arrays(np.float64, (count, 3), elements=st.floats(-1e3, 1e3)))
    roots = draw(arrays(np.float64, (count + 1, 3, 3), elements=st.floats(-1.0, 1.0)))
    squares = roots @ roots.swapaxes(1, 2)
    shown = draw(st.one_of(st.none(), seen_spins()))
    return Detections(np.cumsum(steps), positions, squares[:-1], squares[-1], shown)


@st.composite
def seen_spins(draw):
    mean = draw(arrays(np.float64, 3, elements=st.floats(-300.0, 300.0)))
    root = draw(arrays(np.float64, (3, 3), elements=st.floats(-1.0, 1.0)))
    return SeenSpin(mean, root @ root.T + np.eye(3), draw(st.floats(-1.0, 1.0)))


def with_detections(seen: Observation, detected: Detections | None) -> Observation:
    (one,) = seen.objects
    return replace(seen, objects=(replace(one, detections=detected),))


@given(st.integers(0, 2**31), st.one_of(st.none(), detections()))
def test_detections_read_back_to_the_last_bit(seed, detected):
    seen = with_detections(make_observation(seed), detected)
    read = Observation.from_json(seen.to_json())
    assert read.to_json() == seen.to_json()
    got = read.objects[0].detections
    assert (got is None) == (detected is None)
    if got is not None:
        for name in ("times", "positions", "covariances", "bias"):
            np.testing.assert_array_equal(getattr(got, name), getattr(detected, name))
        assert (got.spin is None) == (detected.spin is None)
        if got.spin is not None:
            assert got.spin.to_dict() == detected.spin.to_dict()


def test_six_numbers_determine_a_symmetric_matrix():
    matrix = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]])
    assert unique_numbers(matrix).tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    stack = np.stack([matrix, 2.0 * matrix])
    np.testing.assert_array_equal(symmetric_matrices(unique_numbers(stack)), stack)


def good_detections() -> dict[str, list]:
    return Detections([0.1, 0.2], np.zeros((2, 3)), [np.eye(3)] * 2, np.eye(3)).to_dict()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"times": [0.2, 0.1]}, "strictly increase"),
        ({"times": []}, "at least one time"),
        ({"positions": [[0, 0, 0]]}, r"shape \(1, 3\); expected \(2, 3\)"),
        ({"positions": [[0, 0, 0], [0, 0, None]]}, "not finite"),
        ({"covariances": [[1, 0, 0, 1, 0, 1]]}, r"shape \(1, 3, 3\); expected \(2, 3, 3\)"),
        ({"covariances": [[1, 0, 0, 1, 0, 1], [1, 2, 0, 1, 0, 1]]}, "index 1"),
        ({"covariances": [[1, 0, 0, 1, 0]] * 2}, r"expected \(any, 6\)"),
        ({"bias": [1, 0, 0, -1, 0, 1]}, "eigenvalue"),
        ({"bias": None}, "bias"),
        ({"spin": {"mean": [0, 0, 0]}}, "'covariance'.*expected mean, covariance, since"),
        ({"spin": {"mean": [0, 0], "covariance": np.eye(3), "since": 0}}, r"expected \(3,\)"),
        ({"spin": {"mean": [0, 0, 0], "covariance": np.eye(3), "since": "now"}}, "a number"),
        ({"spin": {"mean": [0, 0, 0], "covariance": np.zeros((3, 3)), "since": 0}}, "singular"),
    ],
)
def test_spoilt_detections_are_refused(change, word):
    with pytest.raises(IntuitivePhysicsError, match=word):
        Detections.from_dict({**good_detections(), **change})


def test_a_skewed_covariance_is_refused():
    skewed = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(IntuitivePhysicsError, match="index 1 a matrix that is not symmetric"):
        Detections([0.1, 0.2], np.zeros((2, 3)), [np.eye(3), skewed], np.eye(3))


def test_missing_parts_of_detections_are_named():
    whole = good_detections()
    del whole["bias"]
    with pytest.raises(IntuitivePhysicsError, match=r"'bias'.*expected times, positions"):
        Detections.from_dict(whole)


@given(st.integers(0, 2**31), st.integers(0, 2**31))
def test_an_id_follows_from_the_content(seed, other):
    seen = make_observation(seed)
    assert make_observation(seed).id == seen.id == Observation.from_json(seen.to_json()).id
    assert (make_observation(other).id == seen.id) == (seed == other)
    assert replace(seen, id="", start_time=-1.0).id != seen.id
    assert replace(seen, start_time=-1.0).id == seen.id


@given(st.integers(0, 2**31), st.integers(1, 40))
def test_json_reads_back_to_the_last_bit(seed, points):
    seen = make_observation(seed, points)
    assert Observation.from_json(seen.to_json()).to_json() == seen.to_json()


def test_files_read_back(tmp_path):
    seen = make_observation(1)
    save_observation(seen, tmp_path / "a.json")
    assert load_observation(tmp_path / "a.json").to_json() == seen.to_json()
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


@given(st.floats(0.0, 1.0))
def test_a_truncated_file_is_one_clear_error(part):
    text = make_observation(2).to_json()
    with pytest.raises(IntuitivePhysicsError, match="whole JSON"):
        Observation.from_json(text[: int(part * (len(text) - 1))])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d.pop("objects"),
        lambda d: d.update(format="other/1"),
        lambda d: d["objects"][0].pop("times"),
        lambda d: d["objects"][0]["times"].reverse(),
        lambda d: d["objects"][0]["object"]["shape"].update(radius=-1),
        lambda d: d["objects"][0]["initial_state"].pop("position"),
        lambda d: d["environment"]["planes"][0].update(normal=[0, 0, 0]),
        lambda d: d["environment"].pop("gravity"),
        lambda d: d.update(start_time=1e9),
        lambda d: d.update(objects=[]),
    ],
)
def test_spoilt_observations_are_refused(spoil):
    data = json.loads(make_observation(3).to_json())
    spoil(data)
    with pytest.raises(IntuitivePhysicsError):
        Observation.from_json(json.dumps(data))


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(IntuitivePhysicsError, match="nowhere"):
        load_observation(tmp_path / "nowhere.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(IntuitivePhysicsError, match="bytes"):
        load_observation(tmp_path / "bytes.json")
    with pytest.raises(IntuitivePhysicsError, match="cannot write"):
        save_observation(make_observation(4), tmp_path / "no" / "folder.json")


def test_materials_of_a_scene_are_listed_once():
    environment = Environment([Plane("p", "wood", (0, 0, 1), 0), Plane("q", "wood", (0, 1, 0), 0)])
    objects = (SceneObject("a", "cork", Sphere(1)), SceneObject("b", "cork", Box((1, 1, 1))))
    scene = Scene(environment, objects, (ObjectState((0, 0, 0)), ObjectState((3, 0, 0))))
    assert scene.materials == ("cork", "wood")
