"""Every error has its code."""

import pytest
from intuitive_physics_msgs.msg import ResultCode

from intuitive_physics.errors import (
    IntuitivePhysicsError,
    InvalidInputError,
    UnknownNameError,
    UnsupportedSceneError,
)
from intuitive_physics_ros.conversions import InvalidFieldError
from intuitive_physics_ros.result_codes import RefusedError, error_result, ok_result


class DiskFullError(IntuitivePhysicsError):
    """An error of some node's own."""


class InvalidMethodError(InvalidInputError):
    """A kind of invalid input that a node numbers apart."""


OWN_CODES = {
    DiskFullError: ResultCode.STORAGE_FAILED,
    InvalidMethodError: ResultCode.UNKNOWN_METHOD,
}


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InvalidInputError("x"), ResultCode.INVALID_INPUT),
        (InvalidFieldError("a", "x"), ResultCode.INVALID_INPUT),
        (UnknownNameError("x"), ResultCode.UNKNOWN_NAME),
        (UnsupportedSceneError("x"), ResultCode.UNSUPPORTED_SCENE),
        (RefusedError(ResultCode.BUSY, "x"), ResultCode.BUSY),
        (DiskFullError("x"), ResultCode.STORAGE_FAILED),
        (InvalidMethodError("x"), ResultCode.UNKNOWN_METHOD),
        (IntuitivePhysicsError("x"), ResultCode.INTERNAL_ERROR),
        (ZeroDivisionError("x"), ResultCode.INTERNAL_ERROR),
    ],
)
def test_error_has_its_code_and_keeps_its_words(error, code):
    result = error_result(error, OWN_CODES)
    assert result.value == code
    assert result.message.endswith("x")


def test_ok():
    assert ok_result().value == ResultCode.OK
    assert ok_result().message == ""
