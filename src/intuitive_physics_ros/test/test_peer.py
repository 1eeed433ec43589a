"""A peer gets its answers, also those that are lost at first."""

from __future__ import annotations

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from intuitive_physics_ros import scripting
from intuitive_physics_ros.scripting import Peer, PeerTimeoutError


@pytest.fixture
def peer():
    with Peer("peer") as peer:
        yield peer


def serve(peer: Peer, name: str, unanswered: int) -> list[int]:
    """Serve the peer itself, leaving the first requests without an answer; return their numbers."""
    requests: list[int] = []

    async def answer(request, response):
        requests.append(len(requests))
        response.message = str(requests[-1])
        if len(requests) <= unanswered:
            await Future()
        return response

    # Without this a request that is left waiting would hold up those behind it.
    peer.node.create_service(Trigger, name, answer, callback_group=ReentrantCallbackGroup())
    return requests


@pytest.mark.parametrize("lost", [1, 3])
def test_a_call_is_repeated_until_it_is_answered(peer, monkeypatch, lost):
    monkeypatch.setattr(scripting, "REPEAT_AFTER", 0.05)
    requests = serve(peer, "/forgetful", unanswered=lost)
    answer = peer.call(Trigger, "/forgetful", Trigger.Request())
    assert int(answer.message) >= lost
    assert len(requests) > lost


def test_answered_call_is_sent_once_by_one_client(peer, monkeypatch):
    monkeypatch.setattr(scripting, "REPEAT_AFTER", 60.0)
    requests = serve(peer, "/prompt", unanswered=0)
    answers = [peer.call(Trigger, "/prompt", Trigger.Request()) for _ in range(3)]
    assert [answer.message for answer in answers] == ["0", "1", "2"]
    assert len(requests) == 3
    assert len(list(peer.node.clients)) == 1


def test_a_service_that_is_not_there_is_named(peer):
    with pytest.raises(PeerTimeoutError, match="the service /nowhere"):
        peer.call(Trigger, "/nowhere", Trigger.Request(), timeout=0.1)


def test_an_answer_that_never_comes_is_named(peer, monkeypatch):
    monkeypatch.setattr(scripting, "REPEAT_AFTER", 0.05)
    serve(peer, "/silent", unanswered=1000)
    with pytest.raises(PeerTimeoutError, match="an answer of /silent"):
        peer.call(Trigger, "/silent", Trigger.Request(), timeout=1.0)
