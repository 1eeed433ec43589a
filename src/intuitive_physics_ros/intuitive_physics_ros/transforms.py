"""Transforms between frames, from /tf and /tf_static."""

from __future__ import annotations

import time

from builtin_interfaces.msg import Time as Stamp
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.time import Time

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics.messages.geometry import xyz, xyzw

POLL = 0.002
"""s between two looks whether a transform has come."""


class UnknownTransformError(IntuitivePhysicsError):
    """tf has no transform between two frames."""


class Transforms:
    """Listens to tf, with the executor of a node.

    Parameters
    ----------
    node : that listens

    Raises
    ------
    InvalidInputError
        When tf2_ros is not installed.
    """

    def __init__(self, node: Node) -> None:
        try:
            import tf2_ros
        except ImportError:
            raise InvalidInputError(
                "tf2_ros is not installed, which looks up transforms; expected it "
                "(sudo apt install ros-jazzy-tf2-ros-py)"
            ) from None
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._error: type[Exception] = tf2_ros.TransformException

    def lookup(self, target: str, source: str, stamp: Stamp | None = None) -> RigidTransform:
        """Return the transform from one frame into another.

        Parameters
        ----------
        target, source : names of the frames
        stamp : time at which it holds; the newest that is known where nothing newer has come yet,
            and where no time is given

        Raises
        ------
        UnknownTransformError
            When they are not connected, or not yet.
        """
        at = Time() if stamp is None else Time.from_msg(stamp)
        try:
            try:
                stamped = self._buffer.lookup_transform(target, source, at)
            except self._error:
                # A frame may come before the transform of its time.
                stamped = self._buffer.lookup_transform(target, source, Time())
                self._check_is_before(stamped.header.stamp, at)
        except self._error as error:
            raise _unknown(target, source, error) from None
        return _rigid(stamped)

    def lookup_at(self, target: str, source: str, stamp: Stamp, patience: float) -> RigidTransform:
        """Return the transform from one frame into another at a time, waiting for it.

        Parameters
        ----------
        target, source : names of the frames
        stamp : time at which it holds
        patience : s to wait for it at most, in another thread than the executor's

        Raises
        ------
        UnknownTransformError
            When they are not connected at that time, or not yet.
        """
        at, end = Time.from_msg(stamp), time.monotonic() + patience
        while not self._buffer.can_transform(target, source, at):
            if time.monotonic() > end:
                break
            time.sleep(POLL)
        try:
            return _rigid(self._buffer.lookup_transform(target, source, at))
        except self._error as error:
            raise _unknown(target, source, error) from None

    def forget(self) -> None:
        """Forget what changes with time, as when time has gone back; what is static stays."""
        self._buffer.clear()

    def _check_is_before(self, newest: Stamp, wanted: Time) -> None:
        if Time.from_msg(newest) > wanted:
            raise self._error("it is known for later times only")


def _rigid(stamped: TransformStamped) -> RigidTransform:
    place = stamped.transform
    return RigidTransform(xyz(place.translation), xyzw(place.rotation))


def _unknown(target: str, source: str, error: Exception) -> UnknownTransformError:
    # tf adds a line for each frame that it knows, and names may be of any length.
    reason = str(error).partition("\n")[0]
    return UnknownTransformError(
        f"tf does not know where {source!r:.80} is in {target!r:.80} ({reason:.200}); expected it "
        f"on /tf or /tf_static, look with: ros2 run tf2_ros tf2_echo {target!r:.80} {source!r:.80}"
    )
