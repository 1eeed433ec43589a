"""Errors as the numbered results that services and actions answer."""

from __future__ import annotations

from collections.abc import Mapping

from intuitive_physics_msgs.msg import ResultCode

from intuitive_physics.errors import (
    IntuitivePhysicsError,
    InvalidInputError,
    UnknownNameError,
    UnsupportedSceneError,
)

LIBRARY_CODES: dict[type[BaseException], int] = {
    InvalidInputError: ResultCode.INVALID_INPUT,
    UnknownNameError: ResultCode.UNKNOWN_NAME,
    UnsupportedSceneError: ResultCode.UNSUPPORTED_SCENE,
}
"""Codes of the library's errors."""


class RefusedError(IntuitivePhysicsError):
    """A node cannot do what it is asked now.

    Parameters
    ----------
    code : constant of `ResultCode`, such as BUSY or NOT_READY
    message : why, and what to do
    """

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


def ok_result() -> ResultCode:
    """Return the result of a call that succeeded."""
    return ResultCode(value=ResultCode.OK)


def error_result(
    error: BaseException, codes: Mapping[type[BaseException], int] | None = None
) -> ResultCode:
    """Return the result of a call that raised.

    Parameters
    ----------
    error : what was raised; the code is that of its nearest ancestor that has one
    codes : of the node's own exceptions, besides those of the library
    """
    if isinstance(error, RefusedError):
        return ResultCode(value=error.code, message=str(error))
    all_codes = {**LIBRARY_CODES, **(codes or {})}
    for ancestor in type(error).__mro__:
        if ancestor in all_codes:
            return ResultCode(value=all_codes[ancestor], message=str(error))
    return ResultCode(value=ResultCode.INTERNAL_ERROR, message=f"{type(error).__name__}: {error}")
