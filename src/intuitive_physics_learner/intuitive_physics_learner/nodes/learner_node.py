"""The learner as a ROS node: observations in, versions of θ_s out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from intuitive_physics_msgs.msg import ResultCode
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from intuitive_physics_msgs.srv import GetStaticParameters, SetStaticParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter as RosParameter

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import InputLimits
from intuitive_physics.settings import list_settings
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_learner.cost.cluster import CostMaker
from intuitive_physics_learner.design import suggest_from_store
from intuitive_physics_learner.errors import StorageError
from intuitive_physics_learner.given_parameters import given_parameters
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.nodes.learning_services import (
    RequestedSearches,
    Work,
    answered_beside,
)
from intuitive_physics_learner.nodes.observation_services import (
    BUSY_TIMEOUT,
    ObservationServices,
    written,
)
from intuitive_physics_learner.nodes.parameters import (
    ONLINE_PREFIX,
    bounds_of,
    mode_of,
    node_parameters,
    online_options,
)
from intuitive_physics_learner.nodes.suggestion_service import SuggestionService
from intuitive_physics_learner.online.background_learning import BackgroundLearning
from intuitive_physics_learner.online.worker import COMPILING, FAILED, LEARNING
from intuitive_physics_learner.store import CurrentParameters, ObservationStore
from intuitive_physics_learner.store.database import database_path
from intuitive_physics_learner.stored_learning import learn_from_store
from intuitive_physics_ros.background import Background, trigger
from intuitive_physics_ros.conversions import (
    static_parameters_from_message,
    static_parameters_to_message,
)
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.lifecycle.kernel_loading import COMPILING as COMPILING_KERNELS
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.lifecycle.run_node import farewell, run_node
from intuitive_physics_ros.parameters import use_limits_of
from intuitive_physics_ros.qos import LATCHED, create_publisher
from intuitive_physics_ros.result_codes import ok_result
from intuitive_physics_ros.topics import STATIC_PARAMETERS

LIMITS = frozenset(setting.name for setting in list_settings(InputLimits))
"""Names of the parameters that limit what is received and stored."""

EXPORTS = "exports"
"""Folder beside the database below which exports are written by default."""


class LearnerNode(ManagedNode):
    """Stores observations, learns from them on request and in the background, publishes θ_s."""

    def __init__(self) -> None:
        super().__init__("learner_node", node_parameters())
        self.add_post_set_parameters_callback(self._on_parameters_set)

    def configure(self) -> None:
        """Open the database, and join the cluster if there is one."""
        values = self.values()
        use_limits_of(values)
        # A cluster shares the work itself.
        cores = 1 if values["cluster"] else values["cores"] or len(os.sched_getaffinity(0))
        self._simulator = make_simulator(values["simulator"], threads=cores)
        self._make_cost = CostMaker(values["cluster"], values["cluster_certificates"])
        if self._make_cost.warning:
            self.get_logger().warning(self._make_cost.warning)
        self._store = ObservationStore(database_path(values["database"], self.get_namespace()))
        # What waits for the disk or for other processes waits in a thread of its own.
        self._local_store = ObservationStore(self._store.path, BUSY_TIMEOUT)
        self._current = CurrentParameters(self._local_store)
        self._reported_versions: set[int] = set()
        self._all_stopped = True
        self.get_logger().info(
            f"{self._store.path} holds {self._store.count()} observations and "
            f"version {self._current.version} of the static parameters"
        )

    def activate(self) -> None:
        """Hear observations, learn from them and publish what was learned."""
        self._publisher = create_publisher(
            self, StaticParametersMessage, STATIC_PARAMETERS, LATCHED
        )
        self._database = Background(self, "database")
        self._newer = self.create_guard_condition(self._publish)
        # Triggered in the thread that watches the background, called back in this node's executor.
        improved = self.create_guard_condition(self._read_newest)
        self._background = BackgroundLearning(
            self._store.path, self.get_parameter("simulator").value, partial(trigger, improved)
        )
        self._offer()
        self._publish()
        self._run_background()

    def deactivate(self) -> None:
        """Stop all searches; what was answered is on the disk."""
        self._background.stop()
        self._searches.cancel("the node ends, so the search is cancelled")
        self._observations.stop(self.patience())
        stopped = [
            worker.stop(self.patience())
            for worker in (self._database, self._suggestions, self._searches)
        ]
        farewell([self._publisher])
        self._all_stopped = all(stopped)
        if not self._all_stopped:
            self.get_logger().warning("a search or request did not stop in time and is left behind")

    def cleanup(self) -> None:
        """Close the database, unless something that was left behind still uses it."""
        if self._all_stopped:
            self._make_cost.close()
            self._local_store.close()
            self._store.close()

    def _offer(self) -> None:
        """Create the services and the action, and register their diagnostics."""
        self._searches = RequestedSearches(
            self, self._work, self._message, self._background.stop, self._on_search_ended
        )
        self._suggestions = SuggestionService(
            self,
            lambda request, stop: suggest_from_store(
                self._store, self._simulator.stopped_by(stop), request
            ),
        )
        given = self.get_parameter("export_folder").value
        self._observations = ObservationServices(
            self,
            self._local_store,
            self._database,
            self._on_observations_changed,
            Path(given or self._store.path.parent / EXPORTS).expanduser(),
        )
        self.create_service(
            GetStaticParameters, "~/get_static_parameters", self._on_get_static_parameters
        )
        # While an answer waits for the database, others must go on.
        self.create_service(
            SetStaticParameters,
            "~/set_static_parameters",
            answered_beside(self, self._database, self._store_given_parameters, self._on_given),
            callback_group=ReentrantCallbackGroup(),
        )
        for name, check in self._observations.checks.items():
            self.diagnostics.add(name, check)
        self.diagnostics.add("learning", self._check_learning)
        self.diagnostics.add("learning in the background", self._check_background)

    def _on_observations_changed(self) -> None:
        self._read_newest()
        self._background.notify()

    def _on_get_static_parameters(
        self, request: GetStaticParameters.Request, response: GetStaticParameters.Response
    ) -> GetStaticParameters.Response:
        current = self._current.extended()
        if current is None:
            response.result = ResultCode(
                value=ResultCode.NOT_READY,
                message="no material is known yet; add an observation or set static parameters",
            )
        else:
            response.static_parameters = self._message(current)
            response.result = ok_result()
        return response

    def _on_given(self, stored: LearnedParameters) -> None:
        self._searches.cancel(
            f"version {stored.version} of the static parameters was given while this search ran; "
            "nothing was stored: learn again, which takes account of what was given"
        )
        self._take_over(stored)
        self._background.notify()

    def _store_given_parameters(
        self,
        request: SetStaticParameters.Request,
        response: SetStaticParameters.Response,
        stop: StopFlag,
    ) -> LearnedParameters:
        """Store what a request gives on top of the newest θ_s, whoever stored that."""
        values = static_parameters_from_message(request.static_parameters)
        mode, bounds, store = mode_of(request), bounds_of(request.bounds), self._local_store

        def on_top_of_newest() -> LearnedParameters | None:
            version, newest = store.newest_version(), store.newest_parameters()
            given = given_parameters(values, mode, request.names, newest=newest, bounds=bounds)
            return store.add_improvement(given, on=version)

        while (stored := written(on_top_of_newest, stop)) is None:
            stop.check()
        response.version = stored.version
        return stored

    def _on_parameters_set(self, parameters: Sequence[RosParameter]) -> None:
        names = {parameter.name for parameter in parameters}
        if names & LIMITS:
            use_limits_of({name: self.get_parameter(name).value for name in LIMITS})
        # The process that learns in the background begins with all of them.
        begins_with = names & LIMITS or any(name.startswith(ONLINE_PREFIX) for name in names)
        if self.active and begins_with:
            self._run_background()

    def _work(self, options: LearningOptions) -> Work:
        return lambda on_progress, stop: learn_from_store(
            self._store,
            self._simulator.stopped_by(stop),
            options,
            on_progress=on_progress,
            make_cost=self._make_cost,
        )

    def _on_search_ended(self, learned: LearnedParameters | None) -> None:
        # A search that a deactivation ends is answered after it; what it learned is in the store.
        if not self.active:
            return
        if learned is not None:
            self._take_over(learned)
        self._run_background()

    def _run_background(self) -> None:
        """Learn in the background if the parameters say so and no requested search runs."""
        self._background.stop()
        self._read_newest()
        if self.get_parameter(ONLINE_PREFIX).value and self._searches.running is None:
            cores = self.get_parameter(f"{ONLINE_PREFIX}_cores").value
            priority = self.get_parameter(f"{ONLINE_PREFIX}_priority").value
            self._background.start(online_options(self), cores, priority)

    def _read_newest(self) -> None:
        """Take over what was learned in the background, and materials that were observed."""
        self._database.post(self._read_store, "newest")

    def _read_store(self) -> None:
        try:
            if self._current.read():
                trigger(self._newer)
        except StorageError as error:
            self.get_logger().error(str(error))
        for version, why in self._local_store.unreadable_versions.items():
            if version not in self._reported_versions:
                self._reported_versions.add(version)
                self.get_logger().warning(f"{why}; an older version takes its place")

    def _take_over(self, learned: LearnedParameters) -> None:
        if self._current.take(learned):
            self._publish()

    def _publish(self) -> None:
        current = self._current.extended()
        if current is not None:
            self._publisher.publish(self._message(current))

    def _message(self, learned: LearnedParameters) -> StaticParametersMessage:
        return static_parameters_to_message(learned, stamp=self.get_clock().now().to_msg())

    def _check_learning(self) -> Status:
        newest = self._current.newest
        values = {
            "observations": self._observations.count,
            "version": self._current.version,
            "cost": newest.cost if newest else "",
        }
        search = self._searches.running
        if search is not None:
            sentence = f"searching, at iteration {search.progress.iteration}"
            return Status(Level.OK, sentence, values)
        return Status(Level.OK, "waiting to be asked", values)

    def _check_background(self) -> Status:
        if not self.get_parameter(ONLINE_PREFIX).value:
            return Status(Level.OK, f"off; the parameter {ONLINE_PREFIX} turns it on")
        if not self._background.running:
            return Status(Level.OK, "waits for the end of the search that was asked for")
        report = self._background.report
        values = {
            "observations learned from": report.processed - report.doubtful,
            "observations waiting": report.pending,
            "observations set aside": report.doubtful,
            "score of the challenger": report.score,
            "changes noticed": "; ".join(report.changes) or "none",
            "newest version": f"version {report.version}" if report.version else "none yet",
        }
        if report.state == FAILED:
            return Status(Level.ERROR, report.message, values)
        if report.message:
            return Status(Level.WARN, report.message, values)
        if report.state == COMPILING:
            return Status(Level.WARN, COMPILING_KERNELS, values)
        sentence = "learning" if report.state == LEARNING else "waiting for observations"
        return Status(Level.OK, sentence, values)


def main() -> int:
    """Run the node until it is stopped."""
    return run_node(LearnerNode)
