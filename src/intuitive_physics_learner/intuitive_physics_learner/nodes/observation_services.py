"""How observations come into the learner node's database, and how its users look after them."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar

from intuitive_physics_msgs.msg import Observation as ObservationMessage
from intuitive_physics_msgs.msg import ObservationEntry as EntryMessage
from intuitive_physics_msgs.srv import (
    AddObservation,
    DeleteObservations,
    ExportObservations,
    ListObservations,
    SetObservationStatus,
)
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_learner.errors import DatabaseBusyError, DatabaseFullError, StorageError
from intuitive_physics_learner.nodes.learning_services import answered_beside
from intuitive_physics_learner.store import ObservationEntry, ObservationStore
from intuitive_physics_learner.store.observation_entries import EXCLUDED, UNREADABLE, USED
from intuitive_physics_learner.store.observation_store import EXCLUDED_BY_USER
from intuitive_physics_learner.store.room import Room
from intuitive_physics_ros.background import Background, trigger
from intuitive_physics_ros.conversions import observation_from_message, stamp_from_seconds
from intuitive_physics_ros.diagnostics import Level, Status
from intuitive_physics_ros.monitors import InputMonitor
from intuitive_physics_ros.qos import OBSERVATIONS as OBSERVATIONS_QOS
from intuitive_physics_ros.qos import create_subscription
from intuitive_physics_ros.silence import SAME_NAMESPACE, Silence
from intuitive_physics_ros.topics import OBSERVATIONS
from intuitive_physics_ros.unexpected_errors import unexpected_errors

BUSY_TIMEOUT = 0.5
"""s that one attempt to write waits for another process; what reads meanwhile waits as long."""

RETRY_PERIOD = 0.5
"""s between two attempts to store an observation."""

ADD_PATIENCE = 5.0
"""s for which a request to write tries again while another process writes."""

LARGEST_QUEUE = 1000
"""Observations that wait in memory at most, 10 to 50 MB: a quarter of an hour at one a second."""

LARGEST_QUEUE_POINTS = 1_000_000
"""Points of all observations that wait, about 100 MB; honest ones have some hundred each."""

SILENCE = 5.0
"""s without an answer of the database after which /diagnostics says so."""

LARGEST_NUMBER = 2**63 - 1
"""Largest number of a row in SQLite."""

LARGEST_PAGE = 10_000
"""Entries of an answer of `~/list_observations` at most: some MB."""

PAGE = 1000
"""Entries of an answer of `~/list_observations` unless the request gives another number."""


class ObservationQueue:
    """Stores observations in a thread of its own; what cannot be stored is tried again."""

    def __init__(
        self,
        store: ObservationStore,
        on_stored: Callable[[], None],
        on_refused: Callable[[Exception], None],
    ) -> None:
        self._store = store
        self._on_stored = on_stored
        self._on_refused = on_refused
        self._waiting: deque[Observation] = deque()
        self._changed = threading.Condition()
        self._stopped = False
        self._error = ""
        self._lost = 0
        self._refused = 0
        self._thread = threading.Thread(target=self._run, name="observation queue", daemon=True)
        self._thread.start()

    def put(self, observation: Observation) -> None:
        """Have an observation stored as soon as that is possible; returns at once.

        Where too many wait it is lost, which a `StorageError` says.
        """
        with self._changed:
            points = sum(each.point_count for each in self._waiting)
            full = points + observation.point_count > LARGEST_QUEUE_POINTS
            if len(self._waiting) >= LARGEST_QUEUE or (self._waiting and full):
                self._lost += 1
                raise StorageError(
                    f"{len(self._waiting)} observations of {points} points wait to be stored "
                    f"already, so this one is lost: {self._error or 'they come too fast'}"
                )
            self._waiting.append(observation)
            self._changed.notify()

    def stop(self, patience: float) -> int:
        """Store what waits, for up to `patience` s; return how many are left and lost."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join(patience)
        return len(self._waiting)

    def check(self) -> Status:
        """Say whether observations wait, and why."""
        with self._changed:
            values = {
                "waiting": len(self._waiting),
                "lost": self._lost,
                "refused by a full database": self._refused,
            }
            error = self._error
        if values["lost"]:
            return Status(Level.ERROR, f"observations were lost: {error or 'too many'}", values)
        if self._refused and error:
            return Status(Level.ERROR, f"{self._refused} observations refused: {error}", values)
        if error:
            return Status(Level.WARN, f"observations wait to be stored: {error}", values)
        return Status(Level.OK, "observations are stored as they come", values)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._stopped)
                if not self._waiting:
                    return
                first = self._waiting[0]
            try:
                self._store.add(first)
            except DatabaseFullError as error:
                # It says so once on the log and all the while on /diagnostics, with the count.
                with self._changed:
                    self._refused += 1
                self._done(str(error))
                self._on_refused(error)
            except StorageError as error:
                with self._changed:
                    self._error = str(error)
                    if self._stopped:
                        return
                    self._changed.wait_for(lambda: self._stopped, RETRY_PERIOD)
            except Exception as error:
                # It would be refused each time: the next ones must not wait behind it.
                self._done()
                self._on_refused(error)
            else:
                self._done()
                self._on_stored()

    def _done(self, error: str = "") -> None:
        with self._changed:
            self._error = error
            self._waiting.popleft()


class ObservationServices:
    """Offers `~/observation` and the services on stored observations, none of which blocks.

    `on_changed` is called in the node's executor where the set of observations may have changed.
    """

    def __init__(
        self,
        node: Node,
        store: ObservationStore,
        background: Background,
        on_changed: Callable[[], None],
        export_folder: Path,
    ) -> None:
        self._node = node
        self._on_changed = on_changed
        self._export_folder = export_folder
        self._store = store
        self._background = background
        self._input = InputMonitor(node, OBSERVATIONS, timeout=None)
        # Triggered in the queue's thread, called back in the node's executor.
        changed = node.create_guard_condition(on_changed)
        self._queue = ObservationQueue(self._store, partial(trigger, changed), self._on_refused)
        self._unreadable = 0
        self._counts: dict[str, int] = store.counts()
        self._counts_error = ""
        self._counted_at = time.monotonic()
        self._room: Room | None = None
        self._warned_of_room = False
        create_subscription(
            node, ObservationMessage, OBSERVATIONS, self._on_observation, OBSERVATIONS_QOS
        )
        # One comes for each motion: it is no complaint that none has come from who is there.
        topics = {OBSERVATIONS: ObservationMessage}
        self._input.expect(Silence(node, topics, SAME_NAMESPACE, patience=math.inf))
        # While an answer waits for the database, others must go on.
        together = ReentrantCallbackGroup()
        for kind, name, answer in (
            (AddObservation, "add_observation", self._add),
            (ListObservations, "list_observations", self._list),
            (SetObservationStatus, "set_observation_status", self._set_status),
            (DeleteObservations, "delete_observations", self._delete),
            (ExportObservations, "export_observations", self._export),
        ):
            callback = answered_beside(node, background, answer, self._on_answered)
            node.create_service(kind, f"~/{name}", callback, callback_group=together)

    @property
    def checks(self) -> dict[str, Callable[[], Status]]:
        """Checks for /diagnostics by their names."""
        return {
            "observation input": self._input.check,
            "observation queue": self._queue.check,
            "stored observations": self._check_stored,
            "room for the database": self._check_room,
        }

    def stop(self, patience: float) -> None:
        """Store what waits, for up to `patience` s."""
        lost = self._queue.stop(patience)
        if lost:
            self._node.get_logger().error(f"{lost} observations could not be stored and are lost")

    def _on_answered(self, changed: bool) -> None:
        if changed:
            self._on_changed()

    def _on_refused(self, error: Exception) -> None:
        if isinstance(error, IntuitivePhysicsError):
            self._input.rejected(error)
        else:
            self._input.rejected(unexpected_errors(self._node).report(error, "an observation"))

    def _on_observation(self, message: ObservationMessage) -> None:
        try:
            self._queue.put(observation_from_message(message))
        except IntuitivePhysicsError as error:
            self._input.rejected(error)
        else:
            self._input.accepted()

    def _add(
        self, request: AddObservation.Request, response: AddObservation.Response, stop: StopFlag
    ) -> bool:
        observation = observation_from_message(request.observation)
        response.added = written(lambda: self._store.add(observation), stop)
        response.observation_count = self._store.count()
        return bool(response.added)

    def _list(
        self, request: ListObservations.Request, response: ListObservations.Response, stop: StopFlag
    ) -> bool:
        entries = self._store.entries(
            statuses=request.statuses,
            after=min(request.after, LARGEST_NUMBER),
            limit=min(request.limit or PAGE, LARGEST_PAGE),
        )
        response.observations = [entry_to_message(entry) for entry in entries]
        response.observation_count = self._store.count()
        return False

    def _set_status(
        self,
        request: SetObservationStatus.Request,
        response: SetObservationStatus.Response,
        stop: StopFlag,
    ) -> bool:
        if request.status == USED:
            response.changed = self._store.include(request.ids)
        elif request.status == EXCLUDED:
            response.changed = self._store.exclude(request.ids, request.reason or EXCLUDED_BY_USER)
        else:
            raise InvalidInputError(
                f"status is {request.status!r}; expected {USED!r} or {EXCLUDED!r}"
            )
        return response.changed > 0

    def _delete(
        self,
        request: DeleteObservations.Request,
        response: DeleteObservations.Response,
        stop: StopFlag,
    ) -> bool:
        response.deleted = self._store.delete(request.ids)
        return response.deleted > 0

    def _export(
        self,
        request: ExportObservations.Request,
        response: ExportObservations.Response,
        stop: StopFlag,
    ) -> bool:
        folder = folder_below(request.folder, self._export_folder)
        response.exported = self._store.export(folder, request.ids, stop.check)
        return False

    @property
    def count(self) -> int:
        """Observations that were stored when the database was last asked."""
        return sum(self._counts.values())

    def _read_counts(self) -> None:
        try:
            self._counts, self._counts_error = self._store.counts(), ""
            self._room = self._store.room()
        except (StorageError, OSError) as error:
            self._counts_error = str(error)
        self._counted_at = time.monotonic()

    def _check_room(self) -> Status:
        room = self._room
        if room is None:
            return Status(Level.OK, "not measured yet")
        warning = room.warning(self._node.get_parameter("least_free_space").value)
        if warning and not self._warned_of_room:
            self._node.get_logger().warning(warning)
        self._warned_of_room = bool(warning)
        values = {"bytes": room.size, "at most": room.largest or "", "free on the disk": room.free}
        level = Level.WARN if warning else Level.OK
        return Status(level, warning or "there is room for more", values)

    def _check_stored(self) -> Status:
        silence = time.monotonic() - self._counted_at
        self._background.post(self._read_counts, "counts")
        if self._counts_error:
            return Status(Level.ERROR, self._counts_error)
        if silence > SILENCE:
            return Status(Level.WARN, f"the database has not answered for {silence:.0f} s")
        counts = self._counts
        unreadable = counts[UNREADABLE]
        message = f"{sum(counts.values())} observations"
        if unreadable:
            message = (
                f"{unreadable} of {message} cannot be read and are passed over; "
                "~/list_observations says why"
            )
        if unreadable > self._unreadable:
            self._node.get_logger().warning(message)
        self._unreadable = unreadable
        return Status(Level.WARN if unreadable else Level.OK, message, counts)


Result = TypeVar("Result")


def written(write: Callable[[], Result], stop: StopFlag) -> Result:
    """Write to a database, and try again for `ADD_PATIENCE` while another process writes."""
    deadline = time.monotonic() + ADD_PATIENCE
    while True:
        try:
            return write()
        except DatabaseBusyError:
            if time.monotonic() > deadline or stop.is_set():
                raise


def entry_to_message(entry: ObservationEntry) -> EntryMessage:
    """Return an entry of the list as a message."""
    return EntryMessage(
        id=entry.id,
        number=entry.number,
        received_at=stamp_from_seconds(entry.received_at),
        start_time=math.nan if entry.start_time is None else entry.start_time,
        materials=list(entry.materials),
        object_count=entry.object_count,
        point_count=entry.point_count,
        status=entry.status,
        weight=entry.weight,
        reason=entry.reason,
    )


def folder_below(folder: str, top: Path) -> Path:
    """Return a folder that lies below another one, where symbolic links lead to as well.

    A relative folder counts from `top`; an `InvalidInputError` says that it is not below.
    """
    try:
        target = (top / Path(folder).expanduser()).resolve()
        with suppress(FileNotFoundError):
            target.stat()  # resolving a loop of links is an error up to Python 3.12 only
        below = target.is_relative_to(top.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        raise InvalidInputError(f"folder is {folder!r}, which leads nowhere: {error}") from None
    if not below:
        raise InvalidInputError(
            f"folder is {folder!r}; expected one below {top}, as the parameter export_folder says"
        )
    return target
