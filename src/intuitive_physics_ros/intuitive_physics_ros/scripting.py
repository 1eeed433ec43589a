"""For scripts and tests: nodes as processes, and a peer that calls, waits and listens."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.processes import ChildProcess

REPEAT_AFTER = 2.0
"""s after which a request is sent again: a server drops its answer when it has not discovered the
client yet, which can be later than the client sees the service."""


class PeerTimeoutError(IntuitivePhysicsError):
    """Another node did not appear, answer or send in time."""


class Peer:
    """Makes a node with a context of its own and spins it while something is waited for.

    Parameters
    ----------
    name : of the node
    timeout : s that each wait lasts at most, unless it names another limit
    """

    def __init__(self, name: str, timeout: float = 20.0) -> None:
        self._context = Context()
        rclpy.init(context=self._context, args=[])
        self.node = rclpy.create_node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._timeout = timeout
        self._clients: dict[str, Any] = {}

    def spin_until(self, holds: Callable[[], Any], what: str, timeout: float | None = None) -> Any:
        """Spin until `holds()` is true, and return what it answered.

        Raises
        ------
        PeerTimeoutError
            When that takes longer than the time-out; `what` says what was waited for.
        """
        limit = self._timeout if timeout is None else timeout
        deadline = time.monotonic() + limit
        while not (answer := holds()):
            if time.monotonic() > deadline:
                raise PeerTimeoutError(f"waited {limit:.0f} s in vain for {what}")
            self._executor.spin_once(timeout_sec=0.02)
        return answer

    def spin_for(self, seconds: float) -> None:
        """Spin for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=max(0.0, min(0.02, end - time.monotonic())))

    def call(self, kind: type, name: str, request: Any, timeout: float | None = None) -> Any:
        """Call a service and return its response.

        The request is sent again while there is no answer, so it must be one that may come twice.
        """
        client = self._client(kind, name)
        self.spin_until(client.service_is_ready, f"the service {name}", timeout)
        return self.ask(lambda: client.call_async(request), f"an answer of {name}", timeout)

    def ask(self, send: Callable[[], Any], what: str, timeout: float | None = None) -> Any:
        """Send a request, again while there is no answer, and return the first.

        Parameters
        ----------
        send : sends it and returns the future of its answer
        what : is waited for
        timeout : s, instead of the peer's own

        Raises
        ------
        PeerTimeoutError
            When that takes longer than the time-out.
        """
        sent: list[Any] = []
        next_at = -math.inf

        def answer() -> Any:
            nonlocal next_at
            if time.monotonic() > next_at:
                sent.append(send())
                next_at = time.monotonic() + REPEAT_AFTER
            return next((future for future in sent if future.done()), None)

        return self.spin_until(answer, what, timeout).result()

    def send(self, kind: type, name: str, request: Any) -> Any:
        """Send a request to a service once, and return the future of its response.

        The response can be lost unless the service has answered a `call` of this peer before.
        """
        client = self._client(kind, name)
        self.spin_until(client.service_is_ready, f"the service {name}")
        return client.call_async(request)

    def _client(self, kind: type, name: str) -> Any:
        """Keep one client for each service: once an answer came, the server knows it."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        return self._clients[name]

    def listen(self, kind: type, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
        """Return a list to which every message on a topic is appended as it arrives."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def publisher(self, kind: type, topic: str, qos: QoSProfile | int = 10) -> Any:
        """Return a publisher once a subscriber is connected to it."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.spin_until(publisher.get_subscription_count, f"listeners on {topic}")
        return publisher

    def close(self) -> None:
        """Destroy the node and its context."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def __enter__(self) -> Peer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class LifecycleManager(Peer):
    """Leads nodes through their states, each by its name."""

    def state(self, node: str) -> str:
        """Return the state of a node, such as "inactive"."""
        return self.call(GetState, f"/{node}/get_state", GetState.Request()).current_state.label

    def change(self, node: str, label: str) -> bool:
        """Ask a node for a transition, such as "activate"; return whether it succeeded.

        The request is sent once: a second one would meet the next state.
        """
        # An answer of the node shows that it has discovered this peer.
        self.state(node)
        request = ChangeState.Request(transition=Transition(label=label))
        future = self.send(ChangeState, f"/{node}/change_state", request)
        self.spin_until(future.done, f"an answer of {node} to {label}")
        return future.result().success


class NodeProcess(ChildProcess):
    """One node, running, and what it has written so far.

    Parameters
    ----------
    module : with the node's `main`, such as "intuitive_physics_predictor.nodes.predictor_node"
    arguments : after `--ros-args`, such as ["-p", "rate:=50.0"]
    first : Python that is executed before the node starts
    options : of `ChildProcess`
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str] = (),
        *,
        first: str = "",
        **options: Any,
    ) -> None:
        ros_arguments = ["--ros-args", *arguments] if arguments else []
        # The module is run as the installed executable would run it.
        run = (
            f"{first}\n"
            "from intuitive_physics_ros.lifecycle.start_node import run_module\n"
            f"raise SystemExit(run_module({module!r}))"
        )
        command = [sys.executable, "-u", "-c", run, *ros_arguments]
        super().__init__(command, name=module, **options)
