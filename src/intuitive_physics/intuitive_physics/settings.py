"""Settings: frozen dataclasses whose fields say their meaning, unit, range and choices.

A field is made by `number`, `numbers`, `choice` or `other`. From the fields come the check of
values (`check_settings`), a node's parameters (`intuitive_physics_ros.parameters`), command-line
options (`add_options`, `settings_from_options`) and the reference pages (`list_settings`).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from math import inf
from typing import Any, TypeVar

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_float, name_string

_Settings = TypeVar("_Settings")


def number(
    default: float,
    lower: float,
    upper: float,
    description: str,
    *,
    unit: str = "",
) -> Any:
    """Make a field for a number, a whole one where the default is.

    Parameters
    ----------
    default : value where nobody gives one
    lower, upper : smallest and largest value allowed, both included; `math.inf` where any finite
        number above `lower` will do, which a node's parameters cannot express
    description : what the number means, without a full stop
    unit : as users read it, e.g. "m/s"; empty for what has none
    """
    return _setting_field(default, description, lower=lower, upper=upper, unit=unit)


def numbers(
    default: tuple[float, ...],
    lower: float,
    upper: float,
    description: str,
    *,
    unit: str = "",
) -> Any:
    """Make a field for one or more numbers, each as in `number`, whole ones where the first is."""
    return _setting_field(default, description, lower=lower, upper=upper, unit=unit)


def choice(default: str, choices: Iterable[str], description: str) -> Any:
    """Make a field for one of some words."""
    return _setting_field(default, description, choices=tuple(choices))


def other(default: Any, description: str) -> Any:
    """Make a field for anything else: a truth value, a name, or what only a program can give."""
    return _setting_field(default, description)


def _setting_field(default: Any, description: str, **limits: Any) -> Any:
    return field(default=default, metadata={"description": description, **limits})


@dataclass(frozen=True)
class Setting:
    """Description of one field of a class of settings.

    Parameters
    ----------
    name : of the field
    default : its value where nobody gives one; it decides the type
    description : what it means
    unit : empty for what has none
    range : smallest and largest value allowed, None for what is no number
    choices : words allowed, empty for what is none of them
    """

    name: str
    default: Any
    description: str
    unit: str = ""
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()

    @property
    def is_simple(self) -> bool:
        """Whether it is one truth value, number or word, as a parameter of a node is."""
        return isinstance(self.default, bool | int | float | str)

    @property
    def is_list(self) -> bool:
        """Whether it is one or more numbers."""
        return self.range is not None and isinstance(self.default, tuple)

    @property
    def _is_whole(self) -> bool:
        return isinstance(self.default[0] if self.is_list else self.default, int)

    @property
    def meaning(self) -> str:
        """Description with the unit."""
        return f"{self.description}, {self.unit}" if self.unit else self.description

    @property
    def constraint(self) -> str:
        """Condition on a value, in words."""
        if self.range is not None:
            kind = "whole number" if self._is_whole else "number"
            kind = f"one or more {kind}s" if self.is_list else f"a {kind}"
            lower, upper = self.range if self._is_whole else (f"{bound:g}" for bound in self.range)
            limits = f" from {lower} to {upper}" if self.range[1] < inf else f", at least {lower}"
            return f"{kind}{limits} {self.unit}".rstrip()
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        if isinstance(self.default, bool):
            return "true or false"
        return "a name with at least one character" if isinstance(self.default, str) else "a value"

    def checked(self, value: Any) -> Any:
        """Return a value of the field's type.

        Raises
        ------
        InvalidInputError
            When the value is not what `constraint` says.
        """
        if self.is_list:
            return self._checked_list(value)
        if self.range is not None:
            return self._checked_number(value, *self.range)
        if self.choices:
            if value not in self.choices:
                raise self._refused(repr(value))
        elif isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise self._refused(repr(value))
        elif isinstance(self.default, str):
            name_string(value, self.name)
        return value

    def _checked_list(self, values: Any) -> tuple[float, ...]:
        if not isinstance(values, list | tuple) or not values:
            raise self._refused(repr(values))
        item_setting = replace(self, default=self.default[0])
        return tuple(item_setting.checked(value) for value in values)

    def _checked_number(self, value: Any, lower: float, upper: float) -> float:
        got = finite_float(value, self.name)
        if not lower <= got <= upper or (self._is_whole and got != int(got)):
            raise self._refused(f"{got:g}")
        return int(value) if self._is_whole else got

    def _refused(self, got: str) -> InvalidInputError:
        return InvalidInputError(
            f"{self.name} is {got}; expected {self.constraint} ({self.description})"
        )


def list_settings(settings: type[Any]) -> tuple[Setting, ...]:
    """Return what the fields of a class of settings say, in their order.

    Fields that none of the functions above made are left out.
    """
    return tuple(_read(source) for source in fields(settings) if "description" in source.metadata)


def _read(source: Field[Any]) -> Setting:
    metadata = source.metadata
    return Setting(
        source.name,
        None if source.default is MISSING else source.default,
        metadata["description"],
        metadata.get("unit", ""),
        (metadata["lower"], metadata["upper"]) if "lower" in metadata else None,
        metadata.get("choices", ()),
    )


def check_settings(settings: Any) -> None:
    """Check every field of an object of settings, and give numbers their field's type.

    For `__post_init__` of frozen dataclasses.

    Raises
    ------
    InvalidInputError
        When a value lies outside its range or choices, or has the wrong type.
    """
    for setting in list_settings(type(settings)):
        value = setting.checked(getattr(settings, setting.name))
        object.__setattr__(settings, setting.name, value)


def add_options(parser: argparse.ArgumentParser, settings: type[Any]) -> None:
    """Add an option to a parser for each field that a user can write on a command line.

    The field `time_step` becomes `--time-step`, a truth value also `--no-…`.

    Parameters
    ----------
    parser : the parser, or a group of its arguments
    settings : a class of settings
    """
    for setting in list_settings(settings):
        if setting.is_simple or setting.is_list:
            _add_option(parser, setting)


def _add_option(parser: argparse.ArgumentParser, setting: Setting) -> None:
    arguments: dict[str, Any] = {"type": type(setting.default), "metavar": "NAME"}
    default, meaning = str(setting.default), setting.description
    if isinstance(setting.default, bool):
        arguments = {"action": argparse.BooleanOptionalAction}
        default = default.lower()
    elif setting.choices:
        arguments = {"choices": setting.choices}
    elif setting.range is not None:
        first = setting.default[0] if setting.is_list else setting.default
        arguments = {"type": type(first), "metavar": "N" if isinstance(first, int) else "X"}
        meaning = f"{meaning}; {setting.constraint}"
        if setting.is_list:
            arguments["nargs"] = "+"
            default = " ".join(map(str, setting.default))
    # An option that is not given leaves no trace: the default stands in one place, the field.
    parser.add_argument(
        _option_name(setting),
        dest=setting.name,
        default=argparse.SUPPRESS,
        help=f"{meaning} (default: {default})".replace("%", "%%"),
        **arguments,
    )


def _option_name(setting: Setting) -> str:
    return f"--{setting.name.replace('_', '-')}"


def settings_from_options(
    settings: type[_Settings], options: argparse.Namespace, **otherwise: Any
) -> _Settings:
    """Return the settings that a command line asks for.

    Parameters
    ----------
    settings : the class whose fields were added by `add_options`
    options : what the parser made of the command line
    otherwise : values of fields that the command line does not give, instead of their defaults

    Raises
    ------
    InvalidInputError
        When a value lies outside its range.
    """
    values = {
        setting.name: replace(setting, name=_option_name(setting)).checked(
            getattr(options, setting.name)
        )
        for setting in list_settings(settings)
        if hasattr(options, setting.name)
    }
    return settings(**{**otherwise, **values})
