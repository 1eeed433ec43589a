"""Nodes that are killed at random instants, under load: nothing acknowledged may be lost."""

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

from benchmarks.command import Outcome, report_progress
from benchmarks.results.result import Column
from benchmarks.running_nodes import LEARNER, PERCEPTION, PREDICTOR
from benchmarks.torture.early_end import check_deaths, in_one_line, noted
from benchmarks.torture.learner import (
    Acknowledged,
    Learner,
    adding_request,
    lost_observations,
    running_learner,
)
from benchmarks.torture.nodes import PATIENCE, last_words, thrown_ball
from benchmarks.torture.part import SEED, row_table
from benchmarks.torture.suite import Suite, running_suite
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.errors import StorageError
from intuitive_physics_ros.conversions import static_parameters_to_message
from intuitive_physics_ros.scripting import PeerTimeoutError

LONGEST_LIFE = 2.0  # s for which a node lives at most after its first answer or prediction
OTHERS_EVERY = 5  # one kill in this many is of perception or the predictor, which store nothing
OTHERS = (PERCEPTION, PREDICTOR)  # killed in turn
GIVEN_EVERY = 5  # observations added for each version of the static parameters that is given


@dataclass
class Kills:
    """The effects of kills."""

    kills: int = 0
    answered: int = 0  # observations and versions that were acknowledged
    lost: int = 0  # acknowledged observations and versions that were not there afterwards
    corrupted: list[str] = field(default_factory=list)  # damaged databases, and how
    # Learners that did not answer within `PATIENCE` after the next start, and other nodes after
    # whose start nothing was predicted by then
    not_back: int = 0
    deaths: list[str] = field(default_factory=list)  # of nodes that were not killed
    failures: list[str] = field(default_factory=list)  # early ends


def kill(folder: Path, count: int, rng: np.random.Generator) -> Outcome:
    """Kill the learner, and then perception and the predictor, `count` times in all."""
    kills = Kills()
    others = count // OTHERS_EVERY
    with noted(kills.failures):
        _kill_learners(folder, count - others, kills, rng)
    report_progress(f"{others} kills of the other nodes, which see and predict")
    with noted(kills.failures), running_suite(folder, SEED) as suite:
        _kill_others(suite, others, kills, rng)
    return _part(kills, count)


def _part(kills: Kills, count: int) -> Outcome:
    figures = {"kills": kills.kills, "lost": kills.lost, "corrupted": len(kills.corrupted)}
    table = row_table(
        "Killed at random instants, under load",
        "Four in five are of the learner while it is given observations and parameters, the "
        "others of perception and the predictor while they see and predict a camera's throws.",
        [
            (Column("kills"), kills.kills),
            (Column("answered"), kills.answered),
            (Column("lost"), kills.lost),
            (Column("corrupted"), len(kills.corrupted)),
            (Column("not back"), kills.not_back),
            (Column("died by themselves"), len(kills.deaths)),
        ],
        [*kills.corrupted, *kills.deaths, *kills.failures],
    )
    missed = [
        f"{value} {name}; expected none"
        for name, value in (("lost", kills.lost), ("not back after a kill", kills.not_back))
        if value
    ]
    missed += [f"corrupted: {damage}" for damage in kills.corrupted]
    if kills.kills < count:
        missed.append(f"{kills.kills} kills; expected {count}")
    return Outcome([table], figures, complaints=[*missed, *kills.deaths, *kills.failures])


def _kill_learners(folder: Path, count: int, kills: Kills, rng: np.random.Generator) -> None:
    database, acknowledged = folder / "killed.sqlite3", Acknowledged()
    while kills.kills < count:
        if kills.kills % 20 == 0:
            report_progress(f"kill {kills.kills + 1} of {count}")
        before = len(acknowledged)
        with running_learner(database, acknowledged) as learner:
            _load(learner, kills, rng)
            if not learner.process.is_running:
                kills.deaths.append(last_words(LEARNER, learner.process))
            learner.process.stop(signal.SIGKILL)
        kills.kills += 1
        kills.answered += len(acknowledged) - before
        if not _is_whole(database, acknowledged, kills):
            # Later observations shall not be lost in the same damage.
            database = folder / f"after_kill_{kills.kills}.sqlite3"
            acknowledged = Acknowledged()
        check_deaths(kills.deaths)


def _load(learner: Learner, kills: Kills, rng: np.random.Generator) -> None:
    """Give a learner work until it is to be killed, or has stopped answering."""
    number = len(learner.acknowledged.ids) + 1
    try:
        _give(learner, number, PATIENCE)
    except PeerTimeoutError:
        kills.not_back += 1
        return
    end = time.monotonic() + rng.uniform(0.0, LONGEST_LIFE)
    with suppress(PeerTimeoutError):
        while time.monotonic() < end:
            number += 1
            _give(learner, number, LONGEST_LIFE)
        # The last request is under way when it is killed.
        if number % GIVEN_EVERY:
            request = adding_request(thrown_ball(number + 1))
            learner.peer.send(AddObservation, f"/{LEARNER}/add_observation", request)
            time.sleep(rng.uniform(0.0, 0.02))


def _give(learner: Learner, number: int, timeout: float) -> None:
    """Give a learner an observation, and now and then static parameters before it."""
    if number % GIVEN_EVERY == 0:
        given = static_parameters_to_message(LearnedParameters.defaults(["rubber", "wood"]))
        request = SetStaticParameters.Request(static_parameters=given)
        service = f"/{LEARNER}/set_static_parameters"
        answer = learner.peer.call(SetStaticParameters, service, request, timeout)
        if answer.result.value == ResultCode.OK:
            acknowledged = learner.acknowledged
            acknowledged.version = max(acknowledged.version, answer.version)
    learner.add(thrown_ball(number), timeout)


def _is_whole(database: Path, acknowledged: Acknowledged, kills: Kills) -> bool:
    """Return whether a database is undamaged; count its lost observations and versions."""
    try:
        with closing(sqlite3.connect(database)) as connection:
            ((state,),) = connection.execute("PRAGMA integrity_check").fetchall()
        lost = lost_observations(database, acknowledged)
        with ObservationStore(database) as store:
            kills.lost += len(lost) + max(0, acknowledged.version - store.newest_version())
        acknowledged.ids -= lost
    except (sqlite3.Error, StorageError) as error:
        state = in_one_line(error)
    if state != "ok":
        kills.corrupted.append(f"{database.name} after kill {kills.kills}: {state}")
    return bool(state == "ok")


def _kill_others(suite: Suite, count: int, kills: Kills, rng: np.random.Generator) -> None:
    """Kill perception and predictor in turn while they see and predict throws."""
    for number in range(count):
        time.sleep(rng.uniform(0.0, LONGEST_LIFE))
        _note_deaths(suite, kills)
        killed = OTHERS[number % len(OTHERS)]
        suite.nodes.processes[killed].stop(signal.SIGKILL)
        kills.kills += 1
        _note_deaths(suite, kills, killed)
        kills.not_back += not suite.predictions.wait(suite.camera.time, PATIENCE)
    _note_deaths(suite, kills)


def _note_deaths(suite: Suite, kills: Kills, killed: str = "") -> None:
    """Start dead nodes again, and note those that were not killed."""
    before = len(suite.nodes.deaths)
    died = suite.nodes.revive()
    new = suite.nodes.deaths[before:]
    kills.deaths += [words for name, words in zip(died, new, strict=True) if name != killed]
    check_deaths(kills.deaths)
