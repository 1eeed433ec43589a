"""Nodes that are killed at random instants, under load: what was answered is there afterwards."""

from __future__ import annotations

import signal
import sqlite3
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.msg import ResultCode
from intuitive_physics_msgs.srv import AddObservation, SetStaticParameters

from benchmarks.command import report_progress
from benchmarks.torture.nodes import PATIENCE, PERCEPTION, PREDICTOR, thrown_ball
from benchmarks.torture.suite import Suite, running_suite
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_bringup.connections import module
from intuitive_physics_learner import ObservationStore
from intuitive_physics_ros.conversions import observation_to_message, static_parameters_to_message
from intuitive_physics_ros.scripting import NodeProcess, Peer, PeerTimeoutError

LONGEST_LIFE = 2.0
"""s for which a node lives at most after its first answer, or the first prediction."""

OTHERS_EVERY = 5
"""One kill in this many is of perception or the predictor, which store nothing."""

OTHERS = (PERCEPTION, PREDICTOR)
"""Killed in turn."""

GIVEN_EVERY = 5
"""Observations added for each version of the static parameters that is given."""


@dataclass
class Kept:
    """What a learner has answered, over all of its lives.

    Parameters
    ----------
    ids : of observations
    version : newest of the static parameters
    """

    ids: set[str] = field(default_factory=set)
    version: int = 0


@dataclass
class Kills:
    """What kills did.

    Parameters
    ----------
    kills : how many there were
    answered : observations and versions that were answered
    lost : of these, what was not there afterwards
    corrupted : databases that were damaged afterwards
    not_back : learners that did not answer within `PATIENCE` after the next start, and others
        without which nothing was predicted by then
    died : nodes that ended without being killed
    """

    kills: int = 0
    answered: int = 0
    lost: int = 0
    corrupted: int = 0
    not_back: int = 0
    died: int = 0


def measure_kills(folder: Path, count: int, seed: int, rng: np.random.Generator) -> Kills:
    """Kill the learner, and then the others, `count` times in all.

    Parameters
    ----------
    folder : for the databases and the rendered throws
    seed : of the throws
    """
    found, kept = Kills(), Kept()
    database = folder / "killed.sqlite3"
    others = count // OTHERS_EVERY
    while found.kills < count - others:
        if found.kills % 20 == 0:
            report_progress(f"kill {found.kills + 1} of {count}")
        _kill_learner(database, kept, found, rng)
        _check(database, kept, found)
        found.kills += 1
    report_progress(f"{others} kills of the other nodes, which see and predict")
    with running_suite(folder, seed) as suite:
        _kill_others(suite, others, found, rng)
    found.answered = len(kept.ids) + kept.version
    return found


def _kill_others(suite: Suite, count: int, found: Kills, rng: np.random.Generator) -> None:
    """Kill perception and predictor in turn while what they see is predicted from."""
    for number in range(count):
        time.sleep(rng.uniform(0.0, LONGEST_LIFE))
        suite.nodes.processes[OTHERS[number % len(OTHERS)]].stop(signal.SIGKILL)
        found.kills += 1
        suite.nodes.revive()
        found.not_back += not suite.predictions.wait(suite.camera.time, PATIENCE)
    suite.nodes.revive()
    found.died += len(suite.nodes.deaths) - count


def _kill_learner(database: Path, kept: Kept, found: Kills, rng: np.random.Generator) -> None:
    """Add observations and give parameters until the learner is killed."""
    arguments = ["-p", f"database:={database}"]
    with NodeProcess(module("learner_node"), arguments) as learner, Peer("killer") as peer:
        number = len(kept.ids)
        end = None
        while end is None or time.monotonic() < end:
            number += 1
            try:
                _ask(peer, number, kept, PATIENCE if end is None else LONGEST_LIFE)
            except PeerTimeoutError:
                found.not_back += end is None
                break
            if end is None:
                end = time.monotonic() + rng.uniform(0.0, LONGEST_LIFE)
        # The last request is under way when it is killed.
        if number % GIVEN_EVERY:
            request = AddObservation.Request(
                observation=observation_to_message(thrown_ball(number + 1))
            )
            peer.send(AddObservation, "/learner_node/add_observation", request)
            time.sleep(rng.uniform(0.0, 0.02))
        learner.stop(signal.SIGKILL)


def _ask(peer: Peer, number: int, kept: Kept, timeout: float) -> None:
    """Have the learner keep one thing more, and note it once it has answered."""
    if number % GIVEN_EVERY == 0:
        given = static_parameters_to_message(LearnedParameters.defaults(["rubber", "wood"]))
        answer = peer.call(
            SetStaticParameters,
            "/learner_node/set_static_parameters",
            SetStaticParameters.Request(static_parameters=given),
            timeout,
        )
        if answer.result.value == ResultCode.OK:
            kept.version = max(kept.version, answer.version)
    one = thrown_ball(number)
    request = AddObservation.Request(observation=observation_to_message(one))
    answer = peer.call(AddObservation, "/learner_node/add_observation", request, timeout)
    if answer.result.value == ResultCode.OK:
        kept.ids.add(one.id)


def _check(database: Path, kept: Kept, found: Kills) -> None:
    """Look whether what was answered is in the database."""
    with closing(sqlite3.connect(database)) as connection:
        ((state,),) = connection.execute("PRAGMA integrity_check").fetchall()
    found.corrupted += state != "ok"
    with ObservationStore(database) as store:
        lost = kept.ids - {entry.id for entry in store.entries()}
        found.lost += len(lost) + max(0, kept.version - store.newest_version())
        kept.ids -= lost
