"""Node parameters with a description, which refuse values out of range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import InputLimits, use_limits
from intuitive_physics.settings import list_settings
from intuitive_physics_ros.rclpy_internals import parameter_overrides, refuse_unknown_types


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node.

    Parameters
    ----------
    name : as users write it
    default : bool, int, float, str or a list of one of them, not empty; it decides the type
    description : one sentence with the unit
    range : smallest and largest value allowed, both included; for numbers
    choices : values allowed; for strings
    read_only : False where the value may change while the node runs
    """

    name: str
    default: Any
    description: str
    range: tuple[float, float] | None = None
    choices: Sequence[str] = ()
    read_only: bool = True

    @property
    def type(self) -> RosParameter.Type:
        """Type of the parameter, which is that of its default."""
        return RosParameter.Type.from_parameter_value(self.default)

    @property
    def constraint(self) -> str:
        """Constraint on the value, in words."""
        words = TYPE_WORDS[self.type]
        if self.choices:
            words += f", one of {', '.join(self.choices)}"
        if self.range is not None:
            words += f", {self.range[0]} to {self.range[1]}"
        return words

    def descriptor(self) -> ParameterDescriptor:
        """Return what ROS tools show of the parameter."""
        descriptor = ParameterDescriptor(
            name=self.name,
            type=self.type.value,
            description=self.description,
            additional_constraints=self.constraint,
            read_only=self.read_only,
        )
        if self.range is not None:
            low, high = self.range
            if isinstance(self.default, float):
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
                ]
            else:
                descriptor.integer_range = [
                    IntegerRange(from_value=int(low), to_value=int(high), step=1)
                ]
        return descriptor

    def converted(self, value: Any) -> Any:
        """Return a value with whole numbers as doubles where doubles are expected: 2 is 2.0."""
        if self.type == RosParameter.Type.DOUBLE and type(value) is int:
            return float(value)
        is_list = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        if self.type == RosParameter.Type.DOUBLE_ARRAY and is_list:
            return [float(element) if type(element) is int else element for element in value]
        return value

    def accepts(self, value: Any) -> bool:
        """Whether a value of the right type is finite and one of the choices."""
        if isinstance(value, float) and not math.isfinite(value):
            return False
        return not self.choices or value in self.choices


TYPE_WORDS = {
    RosParameter.Type.BOOL: "true or false",
    RosParameter.Type.INTEGER: "a whole number",
    RosParameter.Type.DOUBLE: "a number",
    RosParameter.Type.STRING: "a string",
    RosParameter.Type.BOOL_ARRAY: "a list of true and false",
    RosParameter.Type.INTEGER_ARRAY: "a list of whole numbers",
    RosParameter.Type.DOUBLE_ARRAY: "a list of numbers",
    RosParameter.Type.STRING_ARRAY: "a list of strings",
}
"""Words for each type of parameter in messages to users."""


def setting_parameters(settings: type[Any], *, read_only: bool = True) -> list[Parameter]:
    """Return a parameter for each field of a class of settings that is a number, word or choice.

    Parameters
    ----------
    settings : dataclass whose fields `intuitive_physics.settings` made
    read_only : of all of them, as in `Parameter`
    """
    return [
        Parameter(
            setting.name,
            setting.default,
            setting.meaning,
            setting.range,
            setting.choices,
            read_only,
        )
        for setting in list_settings(settings)
        if setting.is_simple
    ]


def declare_parameters(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters on a node and return their values by name.

    What is set later is checked in the same way and refused with a reason. Whole numbers are taken
    where doubles are expected, as users write them.

    Raises
    ------
    InvalidInputError
        When the command line or a parameter file gives one of them a value it cannot have.
    """
    declared = {parameter.name: parameter for parameter in parameters}
    node.add_pre_set_parameters_callback(lambda new: [_converted(declared, each) for each in new])
    node.add_on_set_parameters_callback(lambda new: _check(declared, new))
    refuse_unknown_types(node)
    return {name: _declare(node, parameter) for name, parameter in declared.items()}


def use_limits_of(values: Mapping[str, Any]) -> None:
    """Give this process the limits on its inputs that a node's parameters have.

    Parameters
    ----------
    values : of parameters by name, those of `setting_parameters(InputLimits)` among them
    """
    names = [setting.name for setting in list_settings(InputLimits)]
    use_limits(InputLimits(**{name: values[name] for name in names}))


def unknown_overrides(node: Node) -> list[str]:
    """Names that the command line or a parameter file gave and the node does not have."""
    return sorted(name for name in parameter_overrides(node) if not node.has_parameter(name))


def _declare(node: Node, parameter: Parameter) -> Any:
    overrides = parameter_overrides(node)
    override = overrides.get(parameter.name)
    if override is not None:
        overrides[parameter.name] = _converted({parameter.name: parameter}, override)
    try:
        declared = node.declare_parameter(parameter.name, parameter.default, parameter.descriptor())
    except ParameterException:
        got = override.value if override is not None else parameter.default
        raise InvalidInputError(
            f"parameter {parameter.name} is {got!r}; expected {parameter.constraint} "
            f"({parameter.description})"
        ) from None
    return declared.value


def _converted(declared: Mapping[str, Parameter], new: RosParameter) -> RosParameter:
    parameter = declared.get(new.name)
    value = new.value if parameter is None else parameter.converted(new.value)
    return new if value is new.value else RosParameter(new.name, value=value)


def _check(declared: Mapping[str, Parameter], new: Iterable[RosParameter]) -> SetParametersResult:
    for change in new:
        parameter = declared.get(change.name)
        if parameter is not None and not parameter.accepts(change.value):
            return SetParametersResult(
                successful=False,
                reason=f"{change.name} is {change.value!r}; expected {parameter.constraint}",
            )
    return SetParametersResult(successful=True)
