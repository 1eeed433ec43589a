"""A database never holds what the next start cannot read, and starts where an older one does."""

from __future__ import annotations

import json
import stat
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import InputLimits, limits, use_limits
from intuitive_physics.scene import Environment, Plane
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.errors import DatabaseFullError, UnreadableVersionError
from intuitive_physics_learner.store import CurrentParameters
from intuitive_physics_learner.store.observation_entries import UNREADABLE, USED
from intuitive_physics_learner.store.room import Room


@pytest.fixture(autouse=True)
def few_materials():
    """A limit of four materials."""
    before = limits()
    use_limits(replace(before, most_materials=4))
    yield
    use_limits(before)


@pytest.fixture
def of_materials(glides):
    """Make an observation with so many floors, each of a material of its own, and a box."""

    def make(name, *materials):
        observation = glides(np.random.default_rng(0), 0.5, id=name)
        planes = observation.environment.planes[:1]
        more = [
            Plane(f"{name} {i}", material, (0, 0, 1), -9.0) for i, material in enumerate(materials)
        ]
        environment = Environment([*planes, *more], (), observation.environment.gravity)
        return replace(observation, environment=environment, start_time=observation.start_time)

    return make


@pytest.fixture
def thrown(glides):
    """Make the observation of a number."""
    return lambda number: glides(np.random.default_rng(number), 0.5, id=f"throw {number}")


def test_an_observation_with_too_many_materials_is_not_stored(path, of_materials):
    with ObservationStore(path) as store:
        with pytest.raises(InvalidInputError, match="materials of observation a: got 7"):
            store.add(of_materials("a", *"vwxyz"))
        assert store.count() == 0
        assert store.add(of_materials("b", "x"))
        before = store.materials()
        with pytest.raises(InvalidInputError, match="together with these: got 5"):
            store.add(of_materials("c", "y", "z"))
        assert (store.count(), store.materials()) == (1, before)
        assert store.add(of_materials("d", "y"))


def test_materials_of_learned_versions_count(path, of_materials):
    with ObservationStore(path) as store:
        store.add(of_materials("a", "x"))
        with pytest.raises(InvalidInputError, match="got 5"):
            store.add_parameters(LearnedParameters.defaults(["u", "v"]))
        store.add_parameters(LearnedParameters.defaults(["u"]))
        with pytest.raises(InvalidInputError, match="got 5"):
            store.add(of_materials("b", "y"))
        assert CurrentParameters(store).extended() is not None


def test_a_database_with_too_many_materials_starts_and_keeps_them_aside(path, of_materials):
    use_limits(InputLimits())
    with ObservationStore(path) as store:
        store.add(of_materials("first", "x"))
        store.add(of_materials("large", *(f"material {i}" for i in range(29))))
        store.add(of_materials("last", "x"))
    use_limits(InputLimits(most_materials=4))
    with ObservationStore(path) as store:
        assert len(store.materials()) == 3
        status = {entry.id: (entry.status, entry.reason) for entry in store.entries()}
        assert status["first"][0] == status["last"][0] == USED
        assert status["large"][0] == UNREADABLE
        assert "its 31 materials are too many" in status["large"][1]
        assert len(store.observations()) == 2
        assert CurrentParameters(store).extended() is not None
        assert [entry.id for entry in store.check()] == ["large"]
    use_limits(InputLimits())
    with ObservationStore(path) as store:
        assert store.check() == []
        assert store.count(USED) == 3


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "[" * 100_000,
        "not JSON",
        json.dumps(
            {**LearnedParameters.defaults(["a"]).to_dict(), "materials": list("abcdefghij")}
        ),
        '{"format": 1e999}',
    ],
)
def test_a_version_that_cannot_be_read_is_kept_aside(path, text, rewrite):
    with ObservationStore(path) as store:
        store.add_parameters(LearnedParameters.defaults(["ball"]))
        store.add_parameters(LearnedParameters.defaults(["ball", "cube"]))
    rewrite("UPDATE learned_parameters SET json = ? WHERE version = 2", text)
    with ObservationStore(path) as store:
        newest = store.newest_parameters()
        # It has the number of the newest, so that the next version follows it.
        assert (newest.version, newest.materials) == (2, ("ball",))
        assert list(store.unreadable_versions) == [2]
        with pytest.raises(UnreadableVersionError, match="version 2 of the learned parameters"):
            store.parameters(2)
        assert store.add_improvement(newest, on=2).version == 3
        assert store.newest_parameters().version == 3


def test_only_the_owner_reads_a_new_database(path, glides):
    with ObservationStore(path) as store:
        store.add(glides(np.random.default_rng(0), 0.5))
        files = list(path.parent.glob(f"{path.name}*"))
        assert len(files) == 3
        assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}


def test_the_permissions_of_an_old_database_stay(path):
    ObservationStore(path).close()
    path.chmod(0o664)
    ObservationStore(path).close()
    assert stat.S_IMODE(path.stat().st_mode) == 0o664


def test_a_database_has_a_largest_size(path, thrown):
    use_limits(replace(limits(), largest_database=300_000))
    with ObservationStore(path) as store:
        with pytest.raises(DatabaseFullError, match=r"may have 300000, .* raise largest_database"):
            deque(map(store.add, map(thrown, range(1000))), maxlen=0)
        assert 10 < store.count() < 1000
        assert 200_000 < store.room().size <= 300_000
        # Versions of θ_s are few and small, and the last one must not be lost.
        assert store.add_parameters(LearnedParameters.defaults(["x"])).version == 1
        store.delete([each.id for each in store.entries()][:5])
        assert store.add(thrown(2000))
        assert store.room().size <= 310_000
        use_limits(replace(limits(), largest_database=0))
        assert all(store.add(thrown(3000 + number)) for number in range(50))


def test_a_database_warns_of_its_size_and_its_disk_in_time(path):
    room = Room(path, size=890, free=10_000, largest=1000)
    assert room.warning(least_free=10_000) == ""
    assert "10000 bytes free, expected at least 10001; make room" in room.warning(10_001)
    assert "900 of at most 1000 bytes" in replace(room, size=900).warning(0)
    assert replace(room, size=10**12, largest=0).warning(0) == ""
    with ObservationStore(path) as store:
        measured = store.room()
    # Its write-ahead log is in the file once it is closed.
    assert measured.size == path.stat().st_size
    assert measured.free > 0
