"""The predictor node: newest states, environment and θ_s in; trajectory distributions out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter as RosParameter

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.limits import InputLimits
from intuitive_physics_predictor.compile import warm_up
from intuitive_physics_predictor.live.predictor import Predictor
from intuitive_physics_predictor.live.self_calibration import (
    SelfCalibration,
    load_calibration,
    save_calibration,
)
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.nodes.inputs import PredictionInputs
from intuitive_physics_predictor.nodes.outputs import PredictionOutputs
from intuitive_physics_predictor.nodes.services import PredictionServices
from intuitive_physics_predictor.nodes.ticks import PredictionTicks
from intuitive_physics_ros.background import RequestLimits
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.lifecycle.managed_node import ManagedNode
from intuitive_physics_ros.lifecycle.run_node import run_node
from intuitive_physics_ros.parameters import (
    Parameter,
    setting_parameters,
    use_limits_of,
)

OPTIONS = frozenset(option.name for option in fields(PredictionOptions))
"""Names of the parameters that are options of the library."""

SAVE_EVERY = 10.0
"""s between two writes of what is known of how well is predicted."""

PARAMETERS = [
    Parameter("rate", 100.0, "predictions a second", (0.1, 1000.0), read_only=False),
    Parameter(
        "published_samples",
        200,
        "samples in a message at most; mean and covariance are of all",
        (1, 10_000),
        read_only=False,
    ),
    Parameter(
        "seed",
        0,
        "seed of the next prediction's noise, one more each time",
        (0, 2**31 - 1),
        read_only=False,
    ),
    Parameter(
        "calibration_file",
        "",
        "file that keeps how well was predicted, for the next start; empty: each start begins anew",
    ),
    Parameter("marker_rate", 5.0, "RViz marker messages a second", (0.1, 100.0), read_only=False),
    *setting_parameters(RequestLimits, read_only=False),
    *setting_parameters(InputLimits, read_only=False),
    *setting_parameters(PredictionOptions, read_only=False),
]
"""Parameters of the node: the library's options, and those that only a node needs."""


class PredictorNode(ManagedNode):
    """Parameters and states around inputs, ticks, outputs and services, each with a module."""

    def __init__(self) -> None:
        super().__init__("predictor_node", PARAMETERS, warm_up)
        self._calibration: Mapping[str, Any] | None = None
        self._calibration_problem = ""
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)

    def configure(self) -> None:
        """Begin to load the kernels; nothing is known yet."""
        values = self.values()
        use_limits_of(values)
        calibration = self._stored_calibration()
        settings = settings_from_parameters(values)
        self._predictor = Predictor(settings, values["seed"], calibration=calibration)

    def activate(self) -> None:
        """Predict from what is known and what comes, once the kernels are there."""
        values = self.values()
        self._predictor.set(settings=settings_from_parameters(values))
        self._outputs = PredictionOutputs(self, values["published_samples"])
        self._ticks = PredictionTicks(self, self._predictor, values["rate"], self._outputs)
        self._answers = PredictionServices(self, self._ticks, self.kernels)
        self._marker_timer = self.create_timer(1.0 / values["marker_rate"], self._on_marker_tick)
        self.create_timer(SAVE_EVERY, self._on_save_tick)
        self.diagnostics.add("calibration", self._check_calibration)
        self.diagnostics.add("prediction", self._ticks.monitor.check)
        self.kernels.when_loaded(self._begin)

    def deactivate(self) -> None:
        """Stop predicting; inputs so far are kept."""
        stopped = [part.stop(self.patience()) for part in (self._ticks, self._answers)]
        if not all(stopped):
            self.get_logger().warning("what was predicted did not stop in time and is left behind")
            # Its thread still owns the predictor.
            snapshot = self._predictor.snapshot
            self._predictor = Predictor(snapshot.settings, self.values()["seed"], snapshot.inputs)
        else:
            self._save_calibration(self._predictor.calibration.to_dict())

    def cleanup(self) -> None:
        """Forget the inputs."""
        del self._predictor

    def _begin(self) -> None:
        # Who waits for subscribers before playing a recording may count on its first states.
        PredictionInputs(self, self._ticks, self._outputs)
        self._ticks.start()

    def _stored_calibration(self) -> SelfCalibration:
        """Return what was known of how well is predicted; nothing where it cannot be read."""
        path = self.values()["calibration_file"]
        if not path:
            return SelfCalibration()
        try:
            return load_calibration(Path(path).expanduser())
        except InvalidInputError as error:
            self.get_logger().warning(f"{error}; the calibration begins without it")
            return SelfCalibration()

    def _on_save_tick(self) -> None:
        self._ticks.post(self._take_calibration, key="calibration")
        if self._calibration is not None:
            self._save_calibration(self._calibration)

    def _take_calibration(self, predictor: Predictor) -> None:
        """Copy what is to be stored, in the thread that changes it."""
        self._calibration = predictor.calibration.to_dict()

    def _save_calibration(self, data: Mapping[str, Any]) -> None:
        path = self.values()["calibration_file"]
        if not path:
            return
        try:
            save_calibration(data, Path(path).expanduser())
            self._calibration_problem = ""
        except InvalidInputError as error:
            if not self._calibration_problem:
                self.get_logger().warning(str(error))
            self._calibration_problem = str(error)

    def _check_calibration(self) -> Status:
        factors = self._ticks.snapshot.factors
        values: dict[str, object] = {}
        for kind, factor in factors.items():
            values[f"{kind}: factor on standard deviations"] = f"{factor.value:.2f}"
            values[f"{kind}: its relative error"] = f"{factor.error:.2f}"
            values[f"{kind}: independent comparisons"] = f"{factor.comparisons:.1f}"
        if self._calibration_problem:
            return Status(Level.WARN, self._calibration_problem, values)
        if not self.values()["self_calibration"]:
            return Status(Level.OK, "switched off; the factors are measured and not used", values)
        return Status(
            Level.OK,
            ", ".join(f"{kind}: {factor.value:.2f}" for kind, factor in factors.items()),
            values,
        )

    def _on_marker_tick(self) -> None:
        self._outputs.publish_markers(self._ticks.snapshot.newest)

    def _check_parameters(self, new: Sequence[RosParameter]) -> SetParametersResult:
        """Refuse parameters that are valid each, but not together."""
        try:
            changes = {parameter.name: parameter.value for parameter in new}
            settings_from_parameters(self.values() | changes)
        except IntuitivePhysicsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, new: Sequence[RosParameter]) -> None:
        values, names = self.values(), {parameter.name for parameter in new}
        use_limits_of(values)
        if not self.active:
            # `activate` reads all but the seed, which a pause does not restart.
            if self.configured and "seed" in names:
                self._predictor.set(seed=values["seed"])
            return
        self._outputs.published_samples = values["published_samples"]
        self._ticks.set(
            rate=values["rate"],
            settings=settings_from_parameters(values) if names & OPTIONS else None,
            seed=values["seed"] if "seed" in names else None,
        )
        self._marker_timer.timer_period_ns = round(1e9 / values["marker_rate"])


def settings_from_parameters(values: dict[str, Any]) -> PredictionSettings:
    """Return the library's settings; InvalidInputError when options do not go together."""
    return PredictionSettings(PredictionOptions(**{name: values[name] for name in OPTIONS}))


def main() -> int:
    """Run the node until a signal stops it."""
    return run_node(PredictorNode)
