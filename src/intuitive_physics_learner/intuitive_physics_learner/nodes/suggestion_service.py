"""The learner node's service that suggests the most informative throws."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from intuitive_physics_msgs.msg import ResultCode, SuggestedThrow
from intuitive_physics_msgs.srv import Suggest
from numpy.typing import NDArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_learner.design import AboutMotion, Suggestion, SuggestionRequest
from intuitive_physics_learner.nodes.learning_services import refusal
from intuitive_physics_ros.background import Background
from intuitive_physics_ros.conversions import (
    object_state_to_message,
    region_from_message,
    scene_from_messages,
)
from intuitive_physics_ros.result_codes import ok_result

TIME_LIMIT = "suggestion_time_limit"
"""Name of the node's parameter."""

MakeSuggestions = Callable[[SuggestionRequest, StopFlag], list[Suggestion]]
"""Takes a request and a flag that it stops by, and returns the best throws."""


class SuggestionService:
    """Offers `~/suggest`, which is answered by a thread beside the node, one request at a time."""

    def __init__(self, node: Node, make: MakeSuggestions) -> None:
        self._node = node
        self._make = make
        self._background = Background(node, "suggestions")
        self._busy = False
        node.create_service(
            Suggest, "~/suggest", self._on_suggest, callback_group=ReentrantCallbackGroup()
        )

    def stop(self, patience: float) -> bool:
        """Cancel the request under way; return whether it has ended within `patience` s."""
        return self._background.stop(patience)

    async def _on_suggest(
        self, request: Suggest.Request, response: Suggest.Response
    ) -> Suggest.Response:
        if self._busy:
            response.result = ResultCode(
                value=ResultCode.BUSY,
                message="another suggestion is being made; wait for its answer",
            )
            return response
        self._busy = True
        try:
            asked = _request(request)
            began = time.monotonic()
            limit = self._node.get_parameter(TIME_LIMIT).value
            suggestions = await self._background.run(
                lambda stop: self._make(asked, stop),
                time_limit=limit,
                remedy=f"not all throws were judged; raise {TIME_LIMIT}",
            )
            _fill(response, suggestions)
            response.computation_time = time.monotonic() - began
            response.result = ok_result()
        except Exception as error:
            response.result = refusal(self._node, error, "a suggestion")
        finally:
            self._busy = False
        return response


def _request(message: Suggest.Request) -> SuggestionRequest:
    query = None
    if message.objects and message.about:
        raise InvalidInputError(
            "parameters and a query are asked about; expected about or objects to be empty"
        )
    if message.objects:
        region = region_from_message(message.region) if message.region.kind else None
        scene = scene_from_messages(message.environment, message.objects)
        query = AboutMotion(scene, message.object_id, message.time, region)
    return SuggestionRequest(
        about=tuple(message.about),
        query=query,
        object=message.thrown or None,
        position=_range(message.position, "position"),
        linear_velocity=_range(message.linear_velocity, "linear_velocity"),
        angular_velocity=_range(message.angular_velocity, "angular_velocity"),
        count=message.count or SuggestionRequest.count,
        seed=message.seed,
    )


def _range(numbers: Sequence[float], name: str) -> NDArray[np.float64] | None:
    if len(numbers) not in (0, 6):
        raise InvalidInputError(f"{name} has {len(numbers)} numbers; expected none or 6")
    return np.reshape(np.array(numbers), (3, 2)) if len(numbers) else None


def _fill(response: Suggest.Response, suggestions: Sequence[Suggestion]) -> None:
    response.header.frame_id = suggestions[0].throw.environment.frame_id
    response.asked = list(suggestions[0].asked)
    response.standard_deviations = suggestions[0].before.tolist()
    response.throws = [
        SuggestedThrow(
            objects=[
                object_state_to_message(thrown.object, state)
                for thrown, state in zip(each.throw.cast, each.throw.states, strict=True)
            ],
            information=each.gain,
            standard_deviations=each.after.tolist(),
        )
        for each in suggestions
    ]
