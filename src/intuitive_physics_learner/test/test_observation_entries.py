"""Entries of observations in the store: status, weight, reason, order, counts, changes."""

import json
import os
import re
import threading
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.observation import Detections, load_observation
from intuitive_physics_learner import (
    ObservationStore,
    StorageError,
)
from intuitive_physics_learner.store import Assessment, observation_store
from intuitive_physics_learner.store.database import database_path
from intuitive_physics_learner.store.observation_entries import STATUSES


@pytest.fixture(scope="session")
def glide_at(glides):
    def make(id, start=0.0, material="ball"):
        return glides(np.random.default_rng(0), 0.5, materials=(material,), start=start, id=id)

    return make


@pytest.fixture
def break_text(rewrite):
    """Make a function that cuts the text of an observation short."""
    return lambda id: rewrite("UPDATE observations SET json = substr(json, 1, 99) WHERE id = ?", id)


def ids(entries):
    return [entry.id for entry in entries]


def revision(store):
    return store.database.rows("SELECT revision FROM observation_set")[0][0]


def changed_after(store, revision):
    return [entry.id for entry in store.entries() if entry.revision > revision]


def test_entry_agrees_with_its_observation(store, glides):
    observation = glides(
        np.random.default_rng(0), 0.5, (10, 4), ("ball", "cork"), start=7.0, id="a"
    )
    store.add(observation)
    (entry,) = store.entries()
    assert (entry.number, entry.id, entry.start_time) == (1, "a", 7.0)
    assert (entry.first_time, entry.last_time) == observation.time_span
    assert entry.materials == observation.materials == store.materials()
    assert (entry.object_count, entry.point_count, entry.has_detections) == (2, 14, False)
    assert (entry.status, entry.weight, entry.reason) == ("used", 1.0, "")
    assert json.loads(json.dumps(entry.to_dict()))["materials"] == list(observation.materials)


def test_an_unreadable_row_is_marked_kept_and_passed_over(store, glide_at, break_text):
    store.add_all([glide_at(id) for id in "abc"])
    break_text("b")
    assert [observation.id for observation in store.observations()] == ["a", "c"]
    (entry,) = store.entries(statuses=["unreadable"])
    assert (entry.id, entry.weight) == ("b", 0.0)
    assert "not whole JSON" in entry.reason
    assert store.counts() == {"used": 2, "excluded": 0, "doubtful": 0, "unreadable": 1}
    with pytest.raises(StorageError, match="observation b cannot be read"):
        store.observations(["a", "b"])
    with pytest.raises(StorageError, match="observation b cannot be read"):
        store.include(["b"])
    assert [observation.id for observation in store.observations(["c"])] == ["c"]


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "[]",
        "7",
        '{"format": "intuitive_physics/observation/2", "objects": [1]}',
        '{"format": "intuitive_physics/observation/2", "objects": 5, "environment": []}',
    ],
)
def test_no_text_stops_reading(store, glide_at, text, rewrite):
    store.add_all([glide_at("a"), glide_at("b")])
    rewrite("UPDATE observations SET json = ? WHERE id = 'a'", text)
    assert [observation.id for observation in store.observations()] == ["b"]
    assert ids(store.check()) == ["a"]


def test_a_broken_byte_is_one_unreadable_row(store, glide_at, rewrite):
    store.add_all([glide_at("a"), glide_at("b")])
    rewrite("UPDATE observations SET json = CAST(x'7b22ff' AS TEXT) WHERE id = 'a'")
    assert [observation.id for observation in store.observations()] == ["b"]


def test_a_row_that_can_be_read_again_is_used_again(store, glide_at, rewrite, break_text):
    store.add_all([glide_at("a"), glide_at("b", material="cork")])
    break_text("b")
    assert ids(store.check()) == ["b"]
    rewrite("UPDATE observations SET json = ? WHERE id = 'b'", glide_at("b").to_json())
    before = revision(store)
    assert store.check() == []
    assert revision(store) > before
    assert [observation.id for observation in store.observations()] == ["a", "b"]
    assert store.materials() == ("ball", "floor")


def test_the_user_excludes_and_includes(store, glide_at):
    store.add_all([glide_at(id) for id in "abc"])
    before = revision(store)
    assert store.exclude(["a", "c"], "kicked by the cat") == 2
    assert store.exclude(["a"], "kicked by the cat") == 0
    assert [observation.id for observation in store.observations()] == ["b"]
    assert [observation.id for observation in store.observations(["a"])] == ["a"]
    assert ids(store.entries(statuses=["excluded"])) == ["a", "c"]
    assert store.entries(ids=["a"])[0].reason == "kicked by the cat"
    assert changed_after(store, before) == ["a", "c"]
    middle = revision(store)
    assert store.include(["a"]) == 1
    assert changed_after(store, middle) == ["a"]
    assert [observation.id for observation in store.observations()] == ["a", "b"]
    with pytest.raises(UnknownNameError, match="'x'; expected one of the 3"):
        store.exclude(["a", "x"])
    assert store.counts()["excluded"] == 1


def test_doubtful_observation_is_used_again(store, glide_at, break_text):
    store.add_all([glide_at(id) for id in "abcd"])
    store.exclude(["c"])
    break_text("d")
    store.observations()
    before = revision(store)
    doubts = [Assessment(id, 0.1, "touched", "doubtful") for id in "acdx"]
    store.save_online("{}", 0, assessments=[*doubts, Assessment("b", 0.9)])
    assert [(entry.status, entry.weight) for entry in store.entries()] == [
        ("doubtful", 0.1),
        ("used", 0.9),
        ("excluded", 0.0),
        ("unreadable", 0.0),
    ]
    assert [observation.id for observation in store.observations()] == ["b"]
    store.save_online("{}", 0, assessments=[Assessment("a", 0.8)])
    assert [observation.id for observation in store.observations()] == ["a", "b"]
    assert revision(store) == before


@pytest.mark.parametrize(
    ("weight", "status"), [(-0.1, "used"), (1.1, "used"), (float("nan"), "used"), (0.5, "excluded")]
)
def test_assessments_that_are_none(weight, status):
    with pytest.raises(InvalidInputError, match="of observation a is"):
        Assessment("a", weight, status=status)


def test_deletion_is_for_good(store, glide_at):
    store.add_all([glide_at("a"), glide_at("b", material="cork"), glide_at("c")])
    before = revision(store)
    with pytest.raises(UnknownNameError):
        store.delete(["a", "x"])
    assert store.delete(["b", "c"]) == 2
    assert [each.id for each in store.entries()] == ["a"]
    assert store.materials() == ("ball", "floor")
    assert revision(store) > before
    # A number is never given twice, so that who follows the stream misses none.
    store.add(glide_at("d"))
    assert ids(store.entries(after=3)) == ["d"]


def test_lists_are_paged(store, glide_at):
    store.add_all([glide_at(str(n)) for n in range(10)])
    assert ids(store.entries(after=4, limit=3)) == ["4", "5", "6"]
    assert ids(store.entries(newest=True, limit=2)) == ["9", "8"]
    with pytest.raises(UnknownNameError, match="'x'; expected used, excluded"):
        store.entries(statuses=["x"])


@pytest.mark.parametrize("chunk", [1, 3, 100])
def test_observations_one_after_the_other(store, glide_at, monkeypatch, chunk, break_text):
    monkeypatch.setattr(observation_store, "CHUNK", chunk)
    store.add_all([glide_at(str(n)) for n in range(7)])
    break_text("2")
    store.exclude(["4"])
    read = [(entry.number, observation.id) for entry, observation in store.each_observation()]
    assert read == [(1, "0"), (2, "1"), (4, "3"), (6, "5"), (7, "6")]


def test_export_of_used_or_chosen_observations(store, glide_at, tmp_path):
    store.add_all([glide_at(id) for id in "abc"])
    store.exclude(["b"])
    assert store.export(tmp_path / "used") == 2
    assert store.export(tmp_path / "asked", ["b"]) == 1
    (file,) = (tmp_path / "asked").iterdir()
    assert load_observation(file).to_json() == glide_at("b").to_json()
    with pytest.raises(UnknownNameError):
        store.export(tmp_path / "none", ["x"])
    with pytest.raises(InvalidInputError, match="cannot make the folder"):
        store.export(file)


def test_no_id_leads_an_export_out_of_its_folder(store, glide_at, tmp_path):
    ids = ["../up", "/root", "a/b/../../c", "line\nbreak", "käse", "x" * 200, "."]
    store.add_all([glide_at(id) for id in ids])
    folder = tmp_path / "out" / "exported"
    (folder / "000001_..").mkdir(parents=True)
    assert store.export(folder) == len(ids)
    files = list(tmp_path.rglob("*.json"))
    assert {path.parent for path in files} == {folder}
    assert {load_observation(path).id for path in files} == set(ids)


@pytest.mark.parametrize(
    ("template", "namespace", "path"),
    [
        ("/data/x.sqlite3", "/robot", "/data/x.sqlite3"),
        ("/data/{namespace}/x.sqlite3", "/", "/data/x.sqlite3"),
        ("/data/{namespace}/x.sqlite3", "/robots/left", "/data/robots/left/x.sqlite3"),
        ("{namespace}/x.sqlite3", "/", "x.sqlite3"),
        ("~/{namespace}.sqlite3", "/robot", "~/robot.sqlite3"),
    ],
)
def test_each_namespace_has_a_database(template, namespace, path):
    assert str(database_path(template, namespace)) == path


def test_each_session_has_a_database():
    text = str(database_path("/data/{namespace}/{session}.sqlite3", "/robot"))
    assert re.fullmatch(r"/data/robot/\d{8}T\d{6}Z\.sqlite3", text)
    with pytest.raises(InvalidInputError, match=r"placeholder \{sesion\}; expected"):
        database_path("/data/{sesion}.sqlite3", "/")


MATERIALS = st.sampled_from(["ball", "cork", "wood"])
ACTIONS = st.lists(
    st.tuples(st.sampled_from(["add", "exclude", "include", "doubt", "delete"]), MATERIALS),
    max_size=12,
)


@settings(max_examples=15)
@given(actions=ACTIONS)
def test_counts_are_those_of_the_rows(tmp_path_factory, glide_at, actions):
    path = tmp_path_factory.mktemp("counts") / "learner.sqlite3"
    with ObservationStore(path) as store:
        for number, (action, material) in enumerate(actions):
            names = [each.id for each in store.entries()][::2]
            if action == "add":
                store.add(glide_at(str(number), material=material))
            elif action == "doubt":
                doubts = [Assessment(id, 0.2, "", "doubtful") for id in names]
                store.save_online("{}", 0, assessments=doubts)
            else:
                getattr(store, action)(names)
            entries = store.entries()
            counts = Counter(entry.status for entry in entries)
            assert store.counts() == {status: counts[status] for status in STATUSES}
            expected = {name for entry in entries for name in entry.materials}
            assert set(store.materials()) == expected
            assert [observation.id for observation in store.observations()] == [
                entry.id for entry in entries if entry.status == "used"
            ]


def detected(observation, generator, id):
    """An observation perceived from the same frames, with a third of them left out."""
    (ball,) = observation.objects
    times, positions = ball.trajectory.times, ball.trajectory.positions
    kept = np.sort(generator.permutation(len(times))[: 2 * len(times) // 3])
    covariances = np.broadcast_to(1e-6 * np.eye(3), (len(kept), 3, 3))
    detections = Detections(times[kept], positions[kept], covariances, np.zeros((3, 3)))
    return replace(observation, objects=(replace(ball, detections=detections),), id=id)


def test_a_recording_that_is_played_again_adds_nothing(store, glides):
    generator = np.random.default_rng(0)
    observations = [
        glides(generator, 0.5, counts=(40,), start=start, id=f"{start}")
        for start in (10.0, 10.1, 20.0, 1000.0)
    ]
    first = [
        detected(observation, generator, f"first {observation.id}") for observation in observations
    ]
    again = [
        detected(observation, generator, f"again {observation.id}") for observation in observations
    ]
    assert store.add_all(first) == 4
    assert store.add_all(again) == 0
    assert not any(store.add(observation) for observation in again)
    with ObservationStore(store.path.with_name("both.sqlite3")) as both:
        assert both.add_all([*first, *again]) == 4


def test_a_writer_of_idle_priority_does_not_stand_still_with_the_lock(store):
    policies = []

    def write():
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        with store.database.writing():
            policies.append(os.sched_getscheduler(0))
        policies.append(os.sched_getscheduler(0))

    thread = threading.Thread(target=write)
    thread.start()
    thread.join()
    within, after = policies
    assert after == os.SCHED_IDLE
    # Who lacks the right stays idle and goes on.
    assert within == os.SCHED_OTHER or os.geteuid() != 0
