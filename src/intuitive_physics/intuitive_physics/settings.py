"""Settings: frozen dataclasses whose fields say their meaning, unit, range and choices.

A field is made by `number`, `choice` or `other`. From the fields come the check of values
(`check_settings`), a node's parameters (`intuitive_physics_ros.parameters`), command-line options
(`add_options`, `settings_from_options`) and the reference pages (`list_settings`).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, TypeVar

from intuitive_physics.errors import InvalidInputError, UnknownNameError
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
    lower, upper : smallest and largest value allowed, both included
    description : what the number means, without a full stop
    unit : as users read it, e.g. "m/s"; empty for what has none
    """
    return _setting_field(default, description, lower=lower, upper=upper, unit=unit)


def choice(default: str, choices: Iterable[str], description: str) -> Any:
    """Make a field for one of some words."""
    return _setting_field(default, description, choices=tuple(choices))


def other(default: Any, description: str, *, unit: str = "") -> Any:
    """Make a field for anything else: a truth value, a name, or what only a program can give."""
    return _setting_field(default, description, unit=unit)


def _setting_field(default: Any, description: str, **limits: Any) -> Any:
    return field(default=default, metadata={"description": description, **limits})


@dataclass(frozen=True)
class Setting:
    """What one field of a class of settings says about itself.

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
        """Whether a user can write it: a truth value, a number or a word."""
        return isinstance(self.default, bool | int | float | str)

    @property
    def meaning(self) -> str:
        """Description with the unit."""
        return f"{self.description}, {self.unit}" if self.unit else self.description

    @property
    def constraint(self) -> str:
        """What a value must be, in words."""
        if self.range is not None:
            kind = "a whole number" if isinstance(self.default, int) else "a number"
            limits = f"{kind} from {self.range[0]:g} to {self.range[1]:g}"
            return f"{limits} {self.unit}" if self.unit else limits
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

    def _checked_number(self, value: Any, lower: float, upper: float) -> float:
        got = finite_float(value, self.name)
        whole = isinstance(self.default, int)
        if not lower <= got <= upper or (whole and got != int(got)):
            raise self._refused(f"{got:g}")
        return int(value) if whole else got

    def _refused(self, got: str) -> InvalidInputError:
        return InvalidInputError(
            f"{self.name} is {got}; expected {self.constraint} ({self.description})"
        )


def list_settings(settings: type[Any]) -> tuple[Setting, ...]:
    """Return what the fields of a class of settings say, in their order.

    Fields that none of `number`, `choice` and `other` made are left out.
    """
    return tuple(_read(one) for one in fields(settings) if "description" in one.metadata)


def _read(one: Field[Any]) -> Setting:
    said = one.metadata
    return Setting(
        one.name,
        None if one.default is MISSING else one.default,
        said["description"],
        said.get("unit", ""),
        (said["lower"], said["upper"]) if "lower" in said else None,
        said.get("choices", ()),
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


def add_options(
    parser: argparse.ArgumentParser,
    settings: type[Any],
    names: Iterable[str] | None = None,
) -> None:
    """Add an option to a parser for each field that a user can write.

    The field `time_step` becomes `--time-step`, a truth value also `--no-…`.

    Parameters
    ----------
    parser : the parser, or a group of its arguments
    settings : a class of settings
    names : fields to add; without it all

    Raises
    ------
    UnknownNameError
        When the class has no such field, or one that cannot be written on a command line.
    """
    simple = {one.name: one for one in list_settings(settings) if one.is_simple}
    for name in simple if names is None else names:
        if name not in simple:
            raise UnknownNameError(
                f"{settings.__name__} has no setting {name!r} for the command line; expected one "
                f"of {', '.join(simple)}"
            )
        _add_option(parser, simple[name])


def _add_option(parser: argparse.ArgumentParser, setting: Setting) -> None:
    what: dict[str, Any] = {"type": type(setting.default), "metavar": "X"}
    said = f"{setting.description}; {setting.constraint} (default: {setting.default})"
    if isinstance(setting.default, bool):
        what = {"action": argparse.BooleanOptionalAction}
        said = f"{setting.description} (default: {str(setting.default).lower()})"
    elif setting.choices:
        what = {"choices": setting.choices}
        said = f"{setting.description} (default: {setting.default})"
    elif isinstance(setting.default, int):
        what["metavar"] = "N"
    elif isinstance(setting.default, str):
        what["metavar"] = "NAME"
        said = f"{setting.description} (default: {setting.default})"
    # An option that is not given leaves no trace: the default stands in one place, the field.
    parser.add_argument(
        f"--{setting.name.replace('_', '-')}",
        dest=setting.name,
        default=argparse.SUPPRESS,
        help=said.replace("%", "%%"),
        **what,
    )


def settings_from_options(
    settings: type[_Settings], options: argparse.Namespace, **given: Any
) -> _Settings:
    """Return the settings that a command line asks for.

    Parameters
    ----------
    settings : the class whose fields were added by `add_options`
    options : what the parser made of the command line
    given : values of other fields

    Raises
    ------
    InvalidInputError
        When a value lies outside its range.
    """
    known = {one.name: one for one in list_settings(settings)}
    asked = {
        name: known[name].checked(value) for name, value in vars(options).items() if name in known
    }
    return settings(**{**asked, **given})
