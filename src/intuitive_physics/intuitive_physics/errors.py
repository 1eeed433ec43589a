"""The exceptions of the whole suite: catch `IntuitivePhysicsError` to catch them all."""


class IntuitivePhysicsError(Exception):
    """Base of every error this suite raises on purpose.

    The message says what was got, what was expected and, where it helps, what to do.
    """


class InvalidInputError(IntuitivePhysicsError, ValueError):
    """A value, file or message is not what it must be."""


class UnsupportedSceneError(IntuitivePhysicsError):
    """A simulator cannot express the scene it was given; it never simulates another one instead."""


class SimulationStoppedError(IntuitivePhysicsError):
    """A simulation was ended before its end by the flag it was given."""

    def __init__(self, message: str = "the simulation was stopped before its end") -> None:
        super().__init__(message)


class UnknownNameError(IntuitivePhysicsError, KeyError):
    """A name (material, method, engine …) is none of those known."""

    def __str__(self) -> str:
        # KeyError shows the repr of its argument, which would put the sentence in quotes.
        return str(self.args[0]) if self.args else ""
