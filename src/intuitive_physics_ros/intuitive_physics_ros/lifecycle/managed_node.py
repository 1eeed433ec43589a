"""A node with the states of ROS 2: unconfigured, inactive, active, finalized.

=============  ====================================================================
transition     what it does
=============  ====================================================================
configure      opens files and begins to load what takes long; nothing is heard or said yet
activate       subscribes, publishes, offers services
deactivate     ends all that; what is known is kept
cleanup        closes files and forgets what is known
shutdown       both of the latter; the node can only be destroyed then
=============  ====================================================================

Unless its parameter `autostart` is false, a node leads itself into the active state.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any

from rclpy.action import ActionServer
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.guard_condition import GuardCondition
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_ros.diagnostics import Diagnostics, Level, Status
from intuitive_physics_ros.lifecycle.kernel_loading import KernelLoading, spare_collections
from intuitive_physics_ros.parameters import Parameter, declare_parameters
from intuitive_physics_ros.rclpy_internals import AnsweringLifecycleNode
from intuitive_physics_ros.silence import CLOCK, ClockCheck
from intuitive_physics_ros.unexpected_errors import unexpected_errors

AUTOSTART = Parameter(
    "autostart",
    True,
    "configure and activate itself at the start; false leaves both to a lifecycle manager",
)
"""Parameter of every managed node."""

LAST_ANSWERS = 0.2
"""s after deactivation for which services are still there, to refuse what was asked before."""

STOP_PATIENCE = 0.5
"""s that a deactivation waits for its threads at most, all together. Meanwhile the node answers
nobody, and with the farewell to subscribers that must stay well below a second."""


class ManagedNode(AnsweringLifecycleNode):
    """Leads the work of a node, which its subclass defines, through the states.

    A subclass defines `configure`, `activate`, `deactivate` and `cleanup`. What the second of them
    makes on the node (publishers, subscriptions, services, actions, timers, checks) is destroyed
    once the third has returned; services and actions a moment later, so that requests under way are
    answered.

    Parameters
    ----------
    name : of the node
    parameters : that it declares
    warm_up : calls the kernels that it needs, in a thread from its configuration on; None: none

    Attributes
    ----------
    configured, active : whether it is; what is active is configured
    kernels : those that `warm_up` calls; what needs them waits for them, and no transition does
    diagnostics : to which `activate` adds checks

    Raises
    ------
    InvalidInputError
        When a parameter has a value it cannot have.
    """

    def __init__(
        self,
        name: str,
        parameters: Iterable[Parameter],
        warm_up: Callable[[], None] | None = None,
    ) -> None:
        super().__init__(name)
        try:
            self._declared = declare_parameters(self, [AUTOSTART, *parameters])
        except BaseException:
            # Nobody gets this node, who could destroy it.
            super().destroy_node()
            raise
        self.configured = self.active = False
        self._failure: Exception | None = None
        self._patient_until = 0.0
        self._lasting: set[Any] = set()
        self._leaving: list[Service | ActionServer] = []
        self._leave_timer: Timer | None = None
        self.diagnostics = Diagnostics(self)
        self.diagnostics.add("state", self._check_state)
        self.diagnostics.add("clock", ClockCheck(self))
        self.kernels = KernelLoading(self, warm_up)
        if warm_up is not None:
            self.diagnostics.add("kernels", self.kernels.check)
        self._lasting_checks = self.diagnostics.names

    def configure(self) -> None:
        """Open files; what takes long is begun in a thread."""
        raise NotImplementedError

    def activate(self) -> None:
        """Make what hears, answers and publishes."""
        raise NotImplementedError

    def deactivate(self) -> None:
        """Stop threads and processes, and publish the last; what is known is kept."""
        raise NotImplementedError

    def cleanup(self) -> None:
        """Close files and forget what is known."""
        raise NotImplementedError

    def patience(self) -> float:
        """Return the s that `deactivate` may still wait for threads."""
        return max(0.0, self._patient_until - time.monotonic())

    def values(self) -> dict[str, Any]:
        """Return the parameters by their names."""
        return {name: self.get_parameter(name).value for name in self._declared}

    def start(self) -> None:
        """Configure and activate, where the parameter `autostart` says so.

        Raises
        ------
        Exception
            What `configure` or `activate` raised.
        """
        if not self._declared[AUTOSTART.name]:
            self.get_logger().info("waits to be configured, as autostart is false")
            return
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() is not TransitionCallbackReturn.SUCCESS:
                raise self._failure or RuntimeError("a transition failed without a reason")

    def destroy_node(self) -> None:
        """Deactivate and clean up, then destroy the node."""
        self._end()
        self._leave()
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; a failure leaves the node unconfigured."""
        try:
            self.configure()
        except Exception as error:
            return self._failed(error, "configuring")
        self.configured = True
        self.kernels.start()
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; a failure leaves the node inactive."""
        self._leave()
        self._lasting = set(_entities(self))
        try:
            self.activate()
        except Exception as error:
            failed = self._failed(error, "activating")
            self._destroy_what_came()
            return failed
        self.active = True
        # Once in the life of a process; kernels that come later have it done once more.
        if self.kernels.is_loaded and gc.get_freeze_count() == 0:
            spare_collections()
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate."""
        self._deactivate()
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        self._end()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and clean up, from whatever state."""
        self._end()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up after an unexpected error; the node can be configured again."""
        self._end()
        return TransitionCallbackReturn.SUCCESS

    def _failed(self, error: Exception, doing: str) -> TransitionCallbackReturn:
        self._failure = error
        if self._declared[AUTOSTART.name]:
            # `start` raises it.
            return TransitionCallbackReturn.FAILURE
        if isinstance(error, IntuitivePhysicsError):
            self.get_logger().error(f"{doing} failed: {error}")
            return TransitionCallbackReturn.FAILURE
        unexpected_errors(self).report(error, doing)
        return TransitionCallbackReturn.ERROR

    def _end(self) -> None:
        self._deactivate()
        if self.configured:
            self.configured = False
            self.cleanup()

    def _deactivate(self) -> None:
        if self.active:
            self.active = False
            self._patient_until = time.monotonic() + STOP_PATIENCE
            self.deactivate()
            self._destroy_what_came()

    def _destroy_what_came(self) -> None:
        self.diagnostics.keep(self._lasting_checks)
        for entity in _entities(self):
            if entity in self._lasting or _is_clock(entity):
                continue
            if isinstance(entity, Service | ActionServer):
                self._leaving.append(entity)
            else:
                _destroy(self, entity)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._leave_timer = self.create_timer(LAST_ANSWERS, self._leave, clock=steady)

    def _leave(self) -> None:
        """Destroy what stayed to answer."""
        if self._leave_timer is not None:
            self.destroy_timer(self._leave_timer)
            self._leave_timer = None
        for entity in self._leaving:
            _destroy(self, entity)
        self._leaving.clear()

    def _check_state(self) -> Status:
        if self.active:
            return Status(Level.OK, "active")
        return Status(Level.OK, "inactive" if self.configured else "unconfigured")


def _entities(node: Node) -> list[Any]:
    """Return what was made on a node, those that use others first."""
    servers = [entity for entity in node.waitables if isinstance(entity, ActionServer)]
    made = (node.subscriptions, node.services, node.clients, node.timers, node.guards)
    return [*servers, *chain.from_iterable(made), *node.publishers]


def _is_clock(entity: Any) -> bool:
    """Whether it is rclpy's own subscription to simulated time, in whatever namespace."""
    return str(getattr(entity, "topic_name", "")).endswith(CLOCK)


def _destroy(node: Node, entity: Any) -> None:
    """Destroy an entity by the method of the node for its kind; actions destroy themselves."""
    destroys: dict[type, Callable[[Any], object]] = {
        Subscription: node.destroy_subscription,
        Service: node.destroy_service,
        Client: node.destroy_client,
        Timer: node.destroy_timer,
        GuardCondition: node.destroy_guard_condition,
        Publisher: node.destroy_publisher,
        ActionServer: ActionServer.destroy,
    }
    destroys[next(kind for kind in destroys if isinstance(entity, kind))](entity)
