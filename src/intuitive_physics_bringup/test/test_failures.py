"""A process that fails ends the others; one sentence says why, when all have ended."""

from __future__ import annotations

import pytest

from intuitive_physics_bringup.failures import LOST, Failures

ERROR = "predictor_node: error: rate is 'fast'; expected a number\n"


def running(*, respawn: bool) -> Failures:
    followed = Failures(respawn=respawn)
    for process in ("learner_node-2", "predictor_node-3"):
        followed.started(process)
    return followed


@pytest.mark.parametrize("respawn", [False, True])
def test_failed_start_ends_everything_with_its_own_sentence(respawn):
    followed = running(respawn=respawn)
    followed.heard("predictor_node-3", f"a warning\n{ERROR}")
    assert followed.ended("predictor_node-3", 1)
    assert followed.sentence == ""
    # What ends because of it is no news.
    assert not followed.ended("learner_node-2", -2)
    expected = "predictor_node failed, so everything was ended: rate is 'fast'; expected a number"
    assert followed.sentence == expected


def test_dead_process_is_started_again_or_ends_everything():
    followed = running(respawn=True)
    assert not followed.ended("learner_node-2", -9)
    followed.started("learner_node-2")
    # As a second start may fail for a while, such as while a disk is full.
    followed.heard("learner_node-2", "learner_node: error: the disk is full")
    assert not followed.ended("learner_node-2", 1)
    followed = running(respawn=False)
    assert followed.ended("learner_node-2", -9)
    followed.ended("predictor_node-3", 0)
    assert "learner_node failed, so everything was ended: it died with code -9" in followed.sentence


@pytest.mark.parametrize("code", [0, LOST])
def test_a_clean_end_ends_nothing_else(code):
    followed = running(respawn=False)
    assert not followed.ended("learner_node-2", code)
    followed.ended("predictor_node-3", 0)
    assert followed.sentence == ""
