"""Errors of learning, besides those of the core library."""

from __future__ import annotations

from collections.abc import Iterable

from intuitive_physics.errors import (
    IntuitivePhysicsError,
    InvalidInputError,
    UnknownNameError,
    UnsupportedSceneError,
)


class NoObservationsError(InvalidInputError):
    """There is nothing to learn from."""


class UnknownMethodError(UnknownNameError):
    """No method of learning has the name given."""

    @classmethod
    def among(cls, name: str, methods: Iterable[str]) -> UnknownMethodError:
        """Return the error for a name that is none of those of methods."""
        return cls(f"method is {name!r}; expected one of {', '.join(sorted(methods))}")


class MissingDependencyError(IntuitivePhysicsError):
    """An optional Python package that is needed is not installed."""


class StorageError(IntuitivePhysicsError):
    """The database of observations cannot be read or written; what it holds was left as it is."""


class UnreadableVersionError(StorageError):
    """A stored version of θ_s cannot be read; the rest of the database can."""


class DatabaseFullError(StorageError):
    """A database has its largest size; nothing was added, and what it holds is unharmed."""


class DatabaseBusyError(StorageError):
    """Another process has been writing for too long; the same may succeed later."""


class SupersededError(IntuitivePhysicsError):
    """θ_s was set by others while it was learned; what was learned was not stored."""


class IncompatibleEnvironmentError(UnsupportedSceneError):
    """The simulator cannot express the environment in which an observation was made."""


class ClusterError(IntuitivePhysicsError):
    """The processes or machines that evaluate J cannot be reached, or failed."""
