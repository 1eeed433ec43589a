"""All uses of private parts of rclpy in the suite, and nothing else.

`test_rclpy_internals.py` fails with the name of what is gone when a release of rclpy changes it.
"""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter

RCLError: type[Exception] = rclpy_implementation.RCLError
"""Exception of rcl, for instance when its arguments cannot be parsed."""


def parameter_overrides(node: Node) -> MutableMapping[str, Parameter]:
    """Return the parameters that the command line or a file gave, declared or not, by name.

    Without them a message could not say what the user wrote, nor that a name is unknown, and a
    whole number could not be taken for a double: what is put here is what is declared.
    """
    overrides: MutableMapping[str, Parameter] = getattr(node, "_parameter_overrides", {})
    return overrides


def release(entity: Any) -> None:
    """Let what an executor waits for be waited for again after its handler has raised.

    A message that cannot be taken raises before rclpy has given its callback group free again; no
    callback of that group would ever run after it.

    Parameters
    ----------
    entity : subscription, service, timer or the like, as an executor hands it out
    """
    if not getattr(entity, "_executor_event", False):
        return
    entity._executor_event = False
    group = entity.callback_group
    if isinstance(group, MutuallyExclusiveCallbackGroup) and not group.can_execute(entity):
        group.ending_execution(entity)


def refuse_unknown_types(node: Node) -> None:
    """Have a node refuse to set parameters to values of a type that does not exist.

    rclpy's own services raise, and whoever asked waits for ever.
    """
    for service in node.services:
        if service.srv_type in (SetParameters, SetParametersAtomically):
            service.callback = partial(_set_if_known, service.callback)


def _set_if_known(set_all: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    types = {kind.value for kind in Parameter.Type}
    unknown = next(
        (parameter for parameter in request.parameters if parameter.value.type not in types), None
    )
    if unknown is None:
        return set_all(request, response)
    refused = SetParametersResult(
        successful=False,
        reason=f"parameter {unknown.name!r} has the type {unknown.value.type}; "
        "expected one of rcl_interfaces/msg/ParameterType",
    )
    if isinstance(response, SetParameters.Response):
        response.results = [refused] * len(request.parameters)
    else:
        response.result = refused
    return response


class AnsweringLifecycleNode(LifecycleNode):
    """Answers a request for a transition that its state does not have, or that does not exist.

    rclpy's own raises in the callback of `~/change_state`, and whoever asked waits for ever.

    Once destroyed it has left the middleware, which rclpy's own never does: it leaves its DDS
    participant to the end of the process, where threads of the middleware that still run made it
    crash or hang.
    """

    def destroy_node(self) -> None:
        """Destroy the node and its state machine, which holds on to rcl's node."""
        super().destroy_node()
        state_machine: Any = self._state_machine
        state_machine.destroy_when_not_in_use()

    def _LifecycleNodeMixin__on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        parent: Any = super()
        try:
            answered: ChangeState.Response = parent._LifecycleNodeMixin__on_change_state(
                request, response
            )
        except RCLError:
            asked = request.transition.label or request.transition.id
            self.get_logger().error(
                f"the transition {asked!r} is refused; expected one of ~/get_available_transitions"
            )
            response.success = False
            return response
        return answered
