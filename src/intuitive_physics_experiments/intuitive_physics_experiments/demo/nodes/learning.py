"""Call the learn action and watch it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from intuitive_physics_msgs.action import LearnParameters
from intuitive_physics_msgs.msg import ResultCode
from numpy.typing import NDArray
from rclpy.action import ActionClient

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_experiments.demo.progress import Progress
from intuitive_physics_ros.conversions import static_parameters_from_message
from intuitive_physics_ros.peer import Peer

ACTION = "/learner_node/learn_parameters"


@dataclass(frozen=True, eq=False)
class Learned:
    """Answer of the learner.

    Parameters
    ----------
    parameters : θ_s with its uncertainty
    cost_history : (iterations,) m, best J after each iteration
    seconds : it took
    """

    parameters: LearnedParameters
    cost_history: NDArray[np.float64]
    seconds: float


def learner_client(peer: Peer) -> ActionClient:
    """Return a client of the learn action, to be made well before it is used.

    A server drops its answer when it has not discovered the client yet, and a goal cannot be sent
    twice: the learner would learn twice.
    """
    return ActionClient(peer.node, LearnParameters, ACTION)


def learn(
    peer: Peer,
    client: ActionClient,
    method: str,
    iterations: int,
    seed: int,
    progress: Progress,
    timeout: float = 120.0,
) -> Learned:
    """Learn from all observations the learner has stored.

    Parameters
    ----------
    client : from `learner_client`
    method : update rule
    iterations : evaluations of J at most
    seed : of the search
    timeout : s to wait for the result

    Raises
    ------
    IntuitivePhysicsError
        When the learner refuses, fails or does not answer.
    """
    peer.spin_until(client.server_is_ready, f"the action {ACTION}")
    goal = LearnParameters.Goal()
    goal.options.method = method
    goal.options.max_iterations = iterations
    goal.options.seed = seed

    def show(message: Any) -> None:
        feedback = message.feedback
        text = f"J {1e3 * feedback.best_cost:.1f} mm"
        progress.bar(feedback.iteration, feedback.max_iterations or iterations, text)

    sent = client.send_goal_async(goal, feedback_callback=show)
    peer.spin_until(sent.done, f"the action {ACTION} to take a goal")
    if not sent.result().accepted:
        raise IntuitivePhysicsError("the learner refused to learn; its log says why")
    answer = sent.result().get_result_async()
    peer.spin_until(answer.done, "the learner to finish", timeout)
    progress.end_bar()
    result = answer.result().result
    if result.result.value != ResultCode.OK:
        raise IntuitivePhysicsError(f"learning failed: {result.result.message}")
    return Learned(
        static_parameters_from_message(result.static_parameters),
        np.array(result.cost_history),
        result.computation_time,
    )
