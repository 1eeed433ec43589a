"""Nothing that was acknowledged is lost, and every way to fail has one clear error."""

import multiprocessing
import os
import resource
import signal
import sqlite3
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.processes import ChildProcess
from intuitive_physics_learner import ObservationStore, StorageError
from intuitive_physics_learner.store import database as database_module
from intuitive_physics_learner.store.database import default_database_path, latest_version
from intuitive_physics_learner.store.online_record import OnlineRecord

PATIENCE = 60.0
"""s to wait for what takes well under one, on a machine that is busy with other things."""


WRITER = """
import sys
from intuitive_physics.observation import Observation
from intuitive_physics.processes import ChildProcess
from intuitive_physics_learner import ObservationStore
from dataclasses import replace
first = Observation.from_json(open(sys.argv[2]).read())
with ObservationStore(sys.argv[1]) as store:
    for number in range(10**9):
        store.add(replace(first, id=f"{sys.argv[3]} {number}"))
        print(number, flush=True)
"""


@pytest.fixture
def observation(glides):
    def make(id):
        return glides(np.random.default_rng(0), 0.5, id=id)

    return make


def start_writer(path, observation, tmp_path, name="writer"):
    text = tmp_path / "observation.json"
    text.write_text(observation("first").to_json())
    writer = ChildProcess([sys.executable, "-c", WRITER, str(path), str(text), name])
    writer.wait_for("0\n", PATIENCE)
    return writer


def acknowledged_by(writer):
    """Return the last number a writer has written, once it has ended."""
    return int([line for line in writer.output.splitlines() if line.isdecimal()][-1])


def test_observations_are_returned_in_order(path, observation):
    some = [observation(id) for id in ("c", "a", "b")]
    with ObservationStore(path) as store:
        assert [store.add(observation) for observation in some] == [True, True, True]
    with ObservationStore(path) as store:
        assert store.count() == 3
        assert [each.id for each in store.entries()] == ["c", "a", "b"]
        assert [observation.to_json() for observation in store.observations()] == [
            observation.to_json() for observation in some
        ]
        assert [observation.id for observation in store.observations(["b", "c"])] == ["c", "b"]
        with pytest.raises(UnknownNameError, match="'x'; expected one of the 3"):
            store.observations(["a", "x"])


def test_the_same_id_is_stored_once(store, observation, glides):
    other = glides(np.random.default_rng(1), 0.5, id="a")
    assert store.add(observation("a"))
    assert not store.add(other)
    assert store.count() == 1
    assert store.observations()[0].to_json() == observation("a").to_json()


def test_parameters_get_growing_versions(path):
    first = LearnedParameters.defaults(["ball", "floor"])
    with ObservationStore(path) as store:
        assert store.newest_parameters() is None
        assert [store.add_parameters(first).version for _ in range(3)] == [1, 2, 3]
    with ObservationStore(path) as store:
        assert store.newest_parameters().version == 3
        assert [store.parameters(version).version for version in (1, 2, 3)] == [1, 2, 3]
        assert store.newest_parameters().materials == ("ball", "floor")


def test_survives_kill_9_at_any_instant(path, observation):
    generator = np.random.default_rng(0)
    first = observation("first")
    acknowledged = []

    def write(number, pipe):
        with ObservationStore(path) as store:
            for n in range(10**9):
                store.add(replace(first, id=f"{number} {n}"))
                os.write(pipe, b".")

    ObservationStore(path).close()
    for number in range(60):
        reader, writer = os.pipe()
        process = multiprocessing.get_context("fork").Process(target=write, args=(number, writer))
        process.start()
        os.close(writer)
        with os.fdopen(reader, "rb", buffering=0) as reports:
            # Opening takes a few ms and a transaction about one, so kills fall into all of it.
            before = len(b"".join(reports.read(1) for _ in range(generator.integers(0, 5))))
            time.sleep(generator.uniform(0.0, 0.005))
            process.kill()
            process.join()
            count = before + len(reports.read())
        acknowledged += [f"{number} {n}" for n in range(count)]
    assert len(acknowledged) > 60
    with ObservationStore(path) as store:
        stored = [each.id for each in store.entries()]
        assert set(acknowledged) <= set(stored)
        # At most the one that was under way comes on top.
        assert len(stored) <= len(acknowledged) + 60
        assert len(store.observations()) == len(stored)


def test_two_processes_and_two_threads_write_at_once(path, observation, tmp_path):
    with start_writer(path, observation, tmp_path) as writer, ObservationStore(path) as store:
        threads = [
            threading.Thread(
                target=lambda k=k: [store.add(observation(f"{k} {n}")) for n in range(20)]
            )
            for k in range(2)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        writer.stop(signal.SIGKILL)
        ids = [each.id for each in store.entries()]
        assert sum(id.startswith("writer") for id in ids) >= 1
        assert {f"{k} {n}" for k in range(2) for n in range(20)} < set(ids)


def filled(path, observation, count=30):
    with ObservationStore(path) as store:
        store.add_all([observation(str(n)) for n in range(count)])
    return path.read_bytes()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda whole: whole[: len(whole) // 2], "is damaged"),
        (lambda whole: whole[:8192] + bytes(8192) + whole[16384:], "is damaged"),
        (lambda whole: np.random.default_rng(0).bytes(20_000), "not an SQLite database"),
    ],
    ids=["truncated", "overwritten", "garbage"],
)
def test_a_spoilt_file_is_refused_and_left_as_it_is(path, observation, spoil, message):
    spoilt = spoil(filled(path, observation))
    path.write_bytes(spoilt)
    with pytest.raises(StorageError, match=message):
        ObservationStore(path)
    assert path.read_bytes() == spoilt


def test_damage_is_detected_by_check_and_by_reading(path, observation):
    whole = bytearray(filled(path, observation, 200))
    middle = len(whole) // 2 // 4096 * 4096
    whole[middle : middle + 40960] = b"\xff" * 40960
    path.write_bytes(whole)
    with ObservationStore(path) as store:
        with pytest.raises(StorageError, match=r"is damaged .*restore a copy"):
            store.check()
        with pytest.raises(StorageError, match=r"is damaged .*restore a copy"):
            store.observations()


def test_database_of_another_program(path, rewrite):
    path.parent.mkdir(parents=True)
    rewrite("CREATE TABLE songs (title TEXT)")
    with pytest.raises(StorageError, match="another program"):
        ObservationStore(path)


@pytest.mark.parametrize("journal_mode", ["wal", "delete"])
def test_a_file_of_a_newer_version_is_refused_and_left_as_it_is(path, observation, journal_mode):
    with ObservationStore(path) as store:
        store.add(observation("old"))
    with sqlite3.connect(path) as newer:
        newer.execute("ALTER TABLE observations ADD COLUMN note TEXT NOT NULL DEFAULT 'none'")
        newer.execute(f"PRAGMA user_version = {latest_version() + 1}")
    newer.execute(f"PRAGMA journal_mode = {journal_mode}")
    newer.close()
    before = path.read_bytes()
    for _ in range(2):
        with pytest.raises(StorageError, match=f"schema version {latest_version() + 1}.*newer one"):
            ObservationStore(path)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_nothing_is_written_to_a_file_that_a_newer_version_migrates_meanwhile(
    path, observation, rewrite
):
    with ObservationStore(path) as store:
        store.add(observation("old"))
        rewrite("CREATE TABLE notes (text TEXT)")
        rewrite(f"PRAGMA user_version = {latest_version() + 1}")
        with pytest.raises(StorageError, match=f"schema version {latest_version() + 1}"):
            store.add(observation("new"))
        assert [each.id for each in store.entries()] == ["old"]


def test_a_file_of_before_the_first_release_is_refused(path, rewrite):
    with ObservationStore(path):
        pass
    rewrite("PRAGMA user_version = 2")
    with pytest.raises(StorageError, match="schema version 2 of a program before the first"):
        ObservationStore(path)


def test_older_schema_is_migrated_and_keeps_its_rows(path, observation, monkeypatch):
    with ObservationStore(path) as store:
        store.add(observation("old"))
    step = ("ALTER TABLE observations ADD COLUMN note TEXT NOT NULL DEFAULT 'none'",)
    monkeypatch.setattr(database_module, "MIGRATIONS", (*database_module.MIGRATIONS, step))
    with ObservationStore(path) as store:
        assert [each.id for each in store.entries()] == ["old"]
    with sqlite3.connect(path) as file:
        assert file.execute("SELECT id, note FROM observations").fetchall() == [("old", "none")]
        assert file.execute("PRAGMA user_version").fetchone() == (latest_version(),)
    file.close()


def test_a_migration_that_fails_changes_nothing(path, observation, monkeypatch):
    with ObservationStore(path) as store:
        store.add(observation("old"))
    steps = ("ALTER TABLE observations ADD COLUMN note TEXT", "SELECT * FROM nowhere")
    with monkeypatch.context() as patched:
        patched.setattr(database_module, "MIGRATIONS", (*database_module.MIGRATIONS, steps))
        with pytest.raises(StorageError, match="nowhere"):
            ObservationStore(path)
    with ObservationStore(path) as store:
        assert [each.id for each in store.entries()] == ["old"]


def test_keeps_where_searches_stand(path):
    state = {"history": [0.1, 1e-300, 1 / 3], "big": 2**127 - 1, "none": None}
    with ObservationStore(path) as store:
        assert store.saved_search("a", 0) == {}
        store.save_search("a", 0, {"seconds": 0.0})
        store.save_search("a", 3, state)
        store.save_search("b", 3, {"seconds": 9.0})
    with ObservationStore(path) as store:
        assert store.saved_search("a", 3) == state
        assert store.saved_search("a", 0) == {}
        assert store.saved_search("b", 3) == {"seconds": 9.0}
        store.delete_search("a")
        store.delete_search("nobody")
        assert store.saved_search("a", 3) == {}
        for n in range(100):
            store.save_search(str(n), 0, state)
        assert store.saved_search("99", 0) == state
        assert store.saved_search("0", 0) == {}


def test_a_checkpoint_that_cannot_be_read_counts_as_none(path, rewrite):
    with ObservationStore(path) as store:
        store.save_search("a", 0, {"seconds": 1.0})
    rewrite("UPDATE searches SET json = '{\"start\": nul'")
    with ObservationStore(path) as store:
        assert store.saved_search("a", 0) == {}


def test_several_observations_are_stored_together_or_not_at_all(store, observation):
    assert store.add_all([observation(id) for id in "abcab"]) == 3
    assert store.add_all([observation(id) for id in "bd"]) == 1
    assert [each.id for each in store.entries()] == ["a", "b", "c", "d"]
    store.database._connection.execute("PRAGMA max_page_count = 1")
    with pytest.raises(StorageError, match="full; make room"):
        store.add_all([observation(str(n)) for n in range(100)])
    assert store.count() == 4


def test_an_improvement_counts_only_on_the_newest_version(store):
    theta = LearnedParameters.defaults(["ball", "floor"])
    assert store.newest_version() == 0
    assert store.save_online("{}", 0, theta)
    assert not store.save_online("[]", 0, theta)
    assert OnlineRecord(store.database).state() == "{}"
    assert store.save_online("1", 1, theta)
    assert store.newest_version() == 2
    assert store.parameters(1).version == 1
    with pytest.raises(UnknownNameError, match="version is 3; expected 1 to 2"):
        store.parameters(3)


def test_full_disk_loses_nothing_that_was_stored(path, observation, tmp_path):
    with ObservationStore(path) as store:
        store.add(observation("before"))
    writer = start_writer(path, observation, tmp_path)
    # No file of this process may grow beyond this any more: what a full disk looks like.
    size = path.parent.joinpath(path.name + "-wal").stat().st_size + 300_000
    resource.prlimit(writer.pid, resource.RLIMIT_FSIZE, (size, size))
    assert writer.wait(PATIENCE) == 1
    assert "StorageError: cannot write" in writer.output
    acknowledged = acknowledged_by(writer)
    with ObservationStore(path) as store:
        expected = ["before", *(f"writer {n}" for n in range(acknowledged + 1))]
        assert [each.id for each in store.entries()][: len(expected)] == expected


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("file/learner.sqlite3", "cannot make the folder"),
        ("/nowhere-at-all/robots/learner.sqlite3", "there is no folder /nowhere-at-all, so none"),
        ("", "cannot open"),
    ],
)
def test_a_place_where_no_database_can_be(tmp_path, place, message):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match=message):
        ObservationStore(tmp_path / place)
    assert not Path("/nowhere-at-all").exists()


def test_locked_by_another_process(path, observation):
    with ObservationStore(path, busy_timeout=0.05) as store:
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StorageError, match="another process"):
            store.add(observation("a"))
        other.execute("ROLLBACK")
        other.close()
        assert store.add(observation("a"))


def test_a_version_that_cannot_be_read(path, rewrite):
    with ObservationStore(path) as store:
        store.add_parameters(LearnedParameters.defaults(["ball"]))
    rewrite("UPDATE learned_parameters SET json = '{}'")
    with ObservationStore(path) as store:
        assert store.newest_parameters() is None
        with pytest.raises(StorageError, match="version 1 of the learned parameters"):
            store.parameters(1)


def test_closed(store):
    store.close()
    with pytest.raises(StorageError, match="open it again"):
        store.count()


def test_database_path_follows_xdg(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_database_path() == tmp_path / "intuitive_physics" / "learner.sqlite3"
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    expected = tmp_path / ".local" / "share" / "intuitive_physics" / "learner.sqlite3"
    assert default_database_path() == expected
