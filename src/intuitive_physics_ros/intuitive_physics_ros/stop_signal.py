"""SIGINT and SIGTERM as something a node can wait for and end in order."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Callable
from types import FrameType

NUMBERS = (signal.SIGINT, signal.SIGTERM)


class StopSignal:
    """Is set by the first SIGINT or SIGTERM of this process; later ones change nothing.

    rclpy's own handlers end its context at once, under the feet of callbacks and threads that
    publish. With this one everything still works until the node has been destroyed.

    Make it in the main thread, before `rclpy.init`, and tell that to install no handlers.
    """

    def __init__(self) -> None:
        self._event = threading.Event()
        # A handler in Python runs only once the main thread is back from waiting in C. What
        # arrives here arrives at once.
        self._arrivals, self._wakeup = socket.socketpair()
        self._wakeup.setblocking(False)
        for number in NUMBERS:
            signal.signal(number, self._set)
        signal.set_wakeup_fd(self._wakeup.fileno(), warn_on_full_buffer=False)
        os.register_at_fork(
            before=_hold_back, after_in_parent=_let_through, after_in_child=_leave_to_parent
        )

    def is_set(self) -> bool:
        """Whether a signal has come."""
        return self._event.is_set()

    def when_set(self, action: Callable[[], None]) -> None:
        """Call `action` from another thread as soon as a signal comes, at once if one has."""

        def wait() -> None:
            self._arrivals.recv(1)
            self._event.set()
            action()

        threading.Thread(target=wait, name="stop signal", daemon=True).start()

    def ignore_rest(self) -> None:
        """Ignore SIGINT for good, even while Python itself ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    def _set(self, number: int, frame: FrameType | None) -> None:
        self._event.set()


# A forked worker shares the socket: a signal to the worker would stop the node. So signals wait
# until the worker has become one that SIGTERM ends and that leaves SIGINT to the node.


def _hold_back() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS)


def _let_through() -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)


def _leave_to_parent() -> None:
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _let_through()
