"""Errors that name the message field they are about."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError


class InvalidFieldError(InvalidInputError):
    """A field of a message is not what it must be.

    Parameters
    ----------
    path : from the message to the field, such as "objects[2].shape"
    reason : what was got and what was expected
    """

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = path
        self.reason = reason


@contextmanager
def in_field(name: str) -> Iterator[None]:
    """Turn any error of the suite that is raised inside into one that names the field.

    Used one inside the other, they make the whole path.
    """
    try:
        yield
    except InvalidFieldError as error:
        raise InvalidFieldError(f"{name}.{error.path}", error.reason) from None
    except IntuitivePhysicsError as error:
        raise InvalidFieldError(name, str(error)) from None
