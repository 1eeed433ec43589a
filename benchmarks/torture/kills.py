"""Nodes that are killed at random instants, under load: what was answered is there afterwards."""

from __future__ import annotations

import signal
import sqlite3
import time
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.msg import ResultCode
from intuitive_physics_msgs.srv import AddObservation, SetStaticParameters

from benchmarks.command import report_progress
from benchmarks.torture.early_end import check_deaths, in_one_line, noted
from benchmarks.torture.nodes import (
    LEARNER,
    PATIENCE,
    PERCEPTION,
    PREDICTOR,
    last_words,
    thrown_ball,
)
from benchmarks.torture.suite import Suite, running_suite
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_bringup.connections import module
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.errors import StorageError
from intuitive_physics_ros.conversions import observation_to_message, static_parameters_to_message
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError

# s for which a node lives at most after its first answer, or the first prediction
LONGEST_LIFE = 2.0
OTHERS_EVERY = 5  # one kill in this many is of perception or the predictor, which store nothing
OTHERS = (PERCEPTION, PREDICTOR)  # killed in turn
GIVEN_EVERY = 5  # observations added for each version of the static parameters that is given


@dataclass
class Kept:
    """What a learner has answered, over all of its lives."""

    ids: set[str] = field(default_factory=set)  # of observations
    version: int = 0  # newest of the static parameters

    def __len__(self) -> int:
        return len(self.ids) + self.version


@dataclass
class Kills:
    """What kills did."""

    kills: int = 0  # how many there were
    answered: int = 0  # observations and versions that were answered
    lost: int = 0  # of these, what was not there afterwards
    # databases that were damaged afterwards, and how
    corrupted: list[str] = field(default_factory=list)
    # learners that did not answer within `PATIENCE` after the next start, and others without which
    # nothing was predicted by then
    not_back: int = 0
    deaths: list[str] = field(default_factory=list)  # nodes that ended without being killed
    failures: list[str] = field(default_factory=list)  # what ended it early


def measure_kills(folder: Path, count: int, seed: int, rng: np.random.Generator) -> Kills:
    """Kill the learner, and then the others, `count` times in all."""
    found = Kills()
    others = count // OTHERS_EVERY
    with noted(found.failures):
        _kill_learners(folder, count - others, found, rng)
    report_progress(f"{others} kills of the other nodes, which see and predict")
    with noted(found.failures), running_suite(folder, seed) as suite:
        _kill_others(suite, others, found, rng)
    return found


def _kill_learners(folder: Path, count: int, found: Kills, rng: np.random.Generator) -> None:
    database, kept = folder / "killed.sqlite3", Kept()
    while found.kills < count:
        if found.kills % 20 == 0:
            report_progress(f"kill {found.kills + 1} of {count}")
        known = len(kept)
        _kill_learner(database, kept, found, rng)
        found.kills += 1
        found.answered += len(kept) - known
        if not _is_whole(database, kept, found):
            # What comes after shall not be lost in the same damage.
            database, kept = folder / f"after_kill_{found.kills}.sqlite3", Kept()
        check_deaths(found.deaths)


def _kill_others(suite: Suite, count: int, found: Kills, rng: np.random.Generator) -> None:
    """Kill perception and predictor in turn while what they see is predicted from."""
    for number in range(count):
        time.sleep(rng.uniform(0.0, LONGEST_LIFE))
        _note_deaths(suite, found)
        killed = OTHERS[number % len(OTHERS)]
        suite.nodes.processes[killed].stop(signal.SIGKILL)
        found.kills += 1
        _note_deaths(suite, found, killed)
        found.not_back += not suite.predictions.wait(suite.camera.time, PATIENCE)
    _note_deaths(suite, found)


def _note_deaths(suite: Suite, found: Kills, killed: str = "") -> None:
    """Start again what has died, and note what was not killed."""
    known = len(suite.nodes.deaths)
    died = suite.nodes.revive()
    new = suite.nodes.deaths[known:]
    found.deaths += [words for name, words in zip(died, new, strict=True) if name != killed]
    check_deaths(found.deaths)


def _kill_learner(database: Path, kept: Kept, found: Kills, rng: np.random.Generator) -> None:
    """Add observations and give parameters until the learner is killed."""
    arguments = ["-p", f"database:={database}"]
    with NodeProcess(module(LEARNER), arguments) as learner, Peer("killer") as peer:
        _load(peer, kept, found, rng)
        if not learner.is_running:
            found.deaths.append(last_words(LEARNER, learner))
        learner.stop(signal.SIGKILL)


def _load(peer: Peer, kept: Kept, found: Kills, rng: np.random.Generator) -> None:
    """Give a learner work until it is to be killed, or has stopped answering."""
    number = len(kept.ids) + 1
    try:
        _ask(peer, number, kept, PATIENCE)
    except PeerTimeoutError:
        found.not_back += 1
        return
    end = time.monotonic() + rng.uniform(0.0, LONGEST_LIFE)
    with suppress(PeerTimeoutError):
        while time.monotonic() < end:
            number += 1
            _ask(peer, number, kept, LONGEST_LIFE)
        # The last request is under way when it is killed.
        if number % GIVEN_EVERY:
            request = AddObservation.Request(
                observation=observation_to_message(thrown_ball(number + 1))
            )
            peer.send(AddObservation, f"/{LEARNER}/add_observation", request)
            time.sleep(rng.uniform(0.0, 0.02))


def _ask(peer: Peer, number: int, kept: Kept, timeout: float) -> None:
    """Have the learner keep one thing more, and note it once it has answered."""
    if number % GIVEN_EVERY == 0:
        given = static_parameters_to_message(LearnedParameters.defaults(["rubber", "wood"]))
        answer = peer.call(
            SetStaticParameters,
            f"/{LEARNER}/set_static_parameters",
            SetStaticParameters.Request(static_parameters=given),
            timeout,
        )
        if answer.result.value == ResultCode.OK:
            kept.version = max(kept.version, answer.version)
    one = thrown_ball(number)
    request = AddObservation.Request(observation=observation_to_message(one))
    answer = peer.call(AddObservation, f"/{LEARNER}/add_observation", request, timeout)
    if answer.result.value == ResultCode.OK:
        kept.ids.add(one.id)


def _is_whole(database: Path, kept: Kept, found: Kills) -> bool:
    """Whether a database is undamaged; note what was answered and is not in it."""
    try:
        with closing(sqlite3.connect(database)) as connection:
            ((state,),) = connection.execute("PRAGMA integrity_check").fetchall()
        with ObservationStore(database) as store:
            lost = kept.ids - {entry.id for entry in store.entries()}
            found.lost += len(lost) + max(0, kept.version - store.newest_version())
    except (sqlite3.Error, StorageError) as error:
        state = in_one_line(error)
    else:
        kept.ids -= lost
    if state != "ok":
        found.corrupted.append(f"{database.name} after kill {found.kills}: {state}")
    return bool(state == "ok")
