"""Parameters of the learner node, and the options of searches that follow from them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from intuitive_physics_msgs.msg import LearningOptions as LearningOptionsMessage
from intuitive_physics_msgs.msg import ParameterBounds, ResultCode
from intuitive_physics_msgs.srv import SetStaticParameters
from rclpy.node import Node

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import InputLimits
from intuitive_physics.parameter_space import Bounds, ParameterSpace
from intuitive_physics.settings import check_settings, choice, list_settings, number
from intuitive_physics.simulation import ENGINE_GUIDE, SIMULATORS
from intuitive_physics.trajectory import DISTANCE_GUIDE, DISTANCES, MEAN_DISTANCE
from intuitive_physics_learner.cost.cluster import CERTIFICATES_GUIDE, WHERE_GUIDE
from intuitive_physics_learner.given_parameters import FIXED, PRIOR, START
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.methods import DEFAULT_METHOD, JOINT_METHOD, METHODS
from intuitive_physics_learner.online.background_learning import PRIORITIES
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.search.convergence import ConvergenceCriteria
from intuitive_physics_learner.store.database import (
    NAMESPACE,
    PLACEHOLDER_GUIDE,
    default_database_path,
)
from intuitive_physics_learner.store.room import RoomSettings
from intuitive_physics_ros.background import RequestLimits
from intuitive_physics_ros.conversions import bounds_from_messages
from intuitive_physics_ros.parameters import Parameter, setting_parameters
from intuitive_physics_ros.result_codes import RefusedError

ONLINE_PREFIX = "online"
"""Beginning of the names of the parameters of learning in the background."""

MODES = {
    SetStaticParameters.Request.PRIOR: PRIOR,
    SetStaticParameters.Request.FIXED: FIXED,
    SetStaticParameters.Request.START: START,
}
"""Use of given values, by the mode of a request."""


@dataclass(frozen=True)
class RequestedSearchSettings:
    """How a requested search goes where the request leaves it open."""

    method: str = choice(DEFAULT_METHOD, METHODS, "of a requested search")
    distance: str = choice(
        MEAN_DISTANCE, DISTANCES, f"{DISTANCE_GUIDE}; {JOINT_METHOD} has none to choose"
    )
    max_iterations: int = number(2000, 1, 10_000_000, "evaluations of the cost J at most")
    max_iterations_without_gain: int = number(
        0, 0, 10_000_000, "evaluations of J without gain after which a search stops; 0: no limit"
    )
    cost_threshold: float = number(0.0, 0.0, 1000.0, "J below which a search stops", unit="m")
    time_limit: float = number(
        0.0, 0.0, 1e6, "wall time of a search at most; 0: no limit", unit="s"
    )
    search_deadline: float = number(
        86400.0,
        1.0,
        1e6,
        "wall time after which a requested search is cancelled, which stores nothing",
        unit="s",
    )
    seed: int = number(0, 0, 2**62, "of the random numbers of every search")

    def __post_init__(self) -> None:
        check_settings(self)


def node_parameters() -> tuple[Parameter, ...]:
    """Parameters of the node; those that are not read-only count from the next search on."""
    return (
        Parameter(
            "database",
            str(default_database_path().parent / NAMESPACE / default_database_path().name),
            "SQLite file of observations and learned parameters; made where it does not exist. "
            f"{PLACEHOLDER_GUIDE}",
        ),
        Parameter(
            "export_folder",
            "",
            "folder below which ~/export_observations may write, from which relative folders "
            "count; empty: exports/ beside the database; /: anywhere",
        ),
        Parameter(
            "simulator",
            "auto",
            f"engine that simulates candidates. {ENGINE_GUIDE}",
            choices=tuple(SIMULATORS),
        ),
        Parameter(
            "cores",
            0,
            "cores of this machine that a requested search may use; 0: all",
            range=(0, 1024),
        ),
        Parameter("cluster", "", f"where a requested search evaluates J. {WHERE_GUIDE}"),
        Parameter("cluster_certificates", "", CERTIFICATES_GUIDE),
        Parameter(
            "suggestion_time_limit",
            60.0,
            "s of wall time for finding what to throw next at most",
            range=(0.1, 1e6),
            read_only=False,
        ),
        *setting_parameters(RequestedSearchSettings, read_only=False),
        *setting_parameters(RequestLimits, read_only=False),
        *setting_parameters(InputLimits, read_only=False),
        *setting_parameters(RoomSettings, read_only=False),
        *_online_parameters(),
    )


def _online_parameters() -> tuple[Parameter, ...]:
    return (
        Parameter(
            ONLINE_PREFIX,
            True,
            "whether to learn in the background as observations arrive",
            read_only=False,
        ),
        Parameter(
            f"{ONLINE_PREFIX}_cores",
            1,
            "cores that learning in the background uses at most",
            range=(1, os.cpu_count() or 1),
            read_only=False,
        ),
        Parameter(
            f"{ONLINE_PREFIX}_priority",
            "idle",
            "of learning in the background; idle: only time that no other process wants; low: the "
            "smallest share of a busy core, but never none",
            choices=PRIORITIES,
            read_only=False,
        ),
        *(
            replace(parameter, name=f"{ONLINE_PREFIX}_{parameter.name}")
            for parameter in setting_parameters(OnlineOptions, read_only=False)
        ),
    )


def online_options(node: Node) -> OnlineOptions:
    """Return the options of learning in the background."""
    given = {
        setting.name: node.get_parameter(f"{ONLINE_PREFIX}_{setting.name}").value
        for setting in list_settings(OnlineOptions)
    }
    return OnlineOptions(**given)


def learning_options(node: Node, message: LearningOptionsMessage) -> LearningOptions:
    """Return the options of a request; a zero in it stands for the node's parameter."""

    def chosen(name: str) -> Any:
        return getattr(message, name) or node.get_parameter(name).value

    return LearningOptions(
        method=chosen("method"),
        criteria=ConvergenceCriteria(
            max_iterations=chosen("max_iterations"),
            max_iterations_without_gain=chosen("max_iterations_without_gain") or None,
            cost_threshold=chosen("cost_threshold") or None,
            time_limit=chosen("time_limit") or None,
        ),
        seed=chosen("seed"),
        bounds=bounds_of(message.bounds),
        observation_ids=tuple(message.observation_ids),
        distance=node.get_parameter("distance").value,
    )


def bounds_of(messages: Sequence[ParameterBounds]) -> dict[str, Bounds]:
    """Return the bounds by kind of parameter of a request."""
    try:
        bounds = bounds_from_messages(messages)
        # How the bounds of kinds must compare does not depend on the materials.
        ParameterSpace(("any",), bounds)
    except InvalidInputError as error:
        raise RefusedError(ResultCode.INVALID_BOUNDS, str(error)) from None
    return bounds


def mode_of(request: SetStaticParameters.Request) -> str:
    """Return what the values of a request are, one of `GIVEN_AS`."""
    if request.mode not in MODES:
        expected = ", ".join(f"{code} ({as_what})" for code, as_what in MODES.items())
        raise InvalidInputError(f"mode is {request.mode}; expected one of {expected}")
    return MODES[request.mode]
