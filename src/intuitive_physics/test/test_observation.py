"""States, scenes and observations: checked on the way in, whole on the way out."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.observation import (
    Observation,
    ObservedObject,
    load_observation,
    save_observation,
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


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: ObjectState((0, 0)), "shape"),
        (lambda: ObjectState((0, 0, np.nan)), "finite"),
        (lambda: ObjectState((0, 0, 0), (0, 0, 0, 2)), "norm"),
        (lambda: ObjectState((0, 0, 0), covariance=-np.eye(12)), "eigenvalue"),
        (lambda: ObjectState((0, 0, 0), covariance=np.triu(np.ones((12, 12)))), "symmetric"),
        (lambda: Plane("", "m", (0, 0, 1), 0), "plane id"),
        (lambda: Plane("p", "m", (0, 0, 0), 0), "direction"),
        (lambda: Plane("p", "m", (0, 0, 1), 0, [(0, 0, 0)]), "corners"),
        (lambda: StaticBox("b", "m", (0, 0, 0), (0, 0, 0, 1), (1, 0, 1)), "edge lengths"),
        (lambda: Environment([Plane("p", "m", (0, 0, 1), 0)] * 2), "each once"),
        (lambda: SceneObject("a", "", Sphere(1)), "material"),
        (lambda: SceneObject("a", "m", "ball"), "Sphere"),
        (lambda: Scene(Environment(), (), ()), "no objects"),
        (lambda: Scene(Environment(), (SceneObject("a", "m", Sphere(1)),), ()), "one state"),
    ],
)
def test_bad_parts_are_refused(make, word):
    with pytest.raises(IntuitivePhysicsError, match=word):
        make()


def test_materials_of_a_scene_are_listed_once():
    environment = Environment([Plane("p", "wood", (0, 0, 1), 0), Plane("q", "wood", (0, 1, 0), 0)])
    objects = (SceneObject("a", "cork", Sphere(1)), SceneObject("b", "cork", Box((1, 1, 1))))
    scene = Scene(environment, objects, (ObjectState((0, 0, 0)), ObjectState((3, 0, 0))))
    assert scene.materials == ("cork", "wood")
