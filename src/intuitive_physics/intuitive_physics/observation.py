"""Observations Y^i: the trajectories perceived in one scene, and their JSON files."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import (
    covariance_matrices,
    covariance_matrix,
    finite_array,
    finite_float,
    increasing_times,
    name_string,
    plain_data,
    set_fields,
)

FORMAT = "intuitive_physics/observation/2"
"""Format of the JSON text, which every text names."""

ID_LENGTH = 32
"""Hexadecimal digits of an id that follows from the content: 128 bits, so that two observations of
a store never have the same one by chance."""

UNIQUE = np.triu_indices(3)
"""Rows and columns of the unique numbers of a symmetric (3, 3) matrix, in the order of files and
messages: xx, xy, xz, yy, yz, zz."""

SAME_STAMP = 2e-6
"""s by which two readings of one frame's stamp may differ: a double holds the seconds since 1970 to
2.4e-7 s, and messages count from the start of an observation, which is rounded too."""

SAME_POINTS = 6
"""Points that two tracks of the same motion have in common at least. With 6 and `SAME_SHARE`, two
tracks that err independently pass for the same by chance in 0.5 % of all cases, with 8 in 0.06 %.
"""

SAME_SHARE = 0.25
"""Share of the mean squared difference that independent errors make, up to which two tracks are
taken from the same frames. Perceiving a rendered recording again, with a third of its frames left
out, another environment and other random choices, makes 0.05 at most."""

ROUNDING = 1e-6
"""m, standard deviation of what rounding makes of a position; keeps exact tracks comparable."""


@dataclass(frozen=True, eq=False)
class SeenSpin:
    """The angular velocity of an object that touches nothing, from what is painted on it.

    All frames of a flight make one `SeenSpin`: a later one of the same flight takes its place.

    Parameters
    ----------
    mean : (3,) rad/s, in the environment's frame
    covariance : (3, 3) rad²/s²
    since : s, time of the first frame that it is from
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    since: float

    def __init__(self, mean: ArrayLike, covariance: ArrayLike, since: float) -> None:
        set_fields(
            self,
            mean=finite_array(mean, "seen spin", (3,)),
            covariance=covariance_matrix(covariance, "covariance of a seen spin", 3),
            since=finite_float(since, "time since when a spin is seen"),
        )
        if np.linalg.eigvalsh(self.covariance)[0] <= 0.0:
            raise InvalidInputError(
                "covariance of a seen spin is singular; expected an error about every axis"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return plain_data(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> SeenSpin:
        """Read what `to_dict` wrote."""
        try:
            return SeenSpin(data["mean"], data["covariance"], data["since"])
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"a seen spin cannot be read ({error}); expected mean, covariance, since"
            ) from None


@dataclass(frozen=True, eq=False)
class Detections:
    """Detections of an object, point by point, before any smoothing.

    A detected position is the true one plus an error of its own, drawn for each point with its
    covariance, plus one error that all points of the object share, drawn once with the covariance
    `bias`.

    Parameters
    ----------
    times : (n,) s, on the clock of the trajectories, strictly increasing
    positions : (n, 3) m, of the object's centre in the environment's frame
    covariances : (n, 3, 3) m², of the error that is independent from point to point
    bias : (3, 3) m², covariance of the error that is the same in all points
    spin : how the object turned at the last time, where its surface shows it
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    bias: NDArray[np.float64]
    spin: SeenSpin | None

    def __init__(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        covariances: ArrayLike,
        bias: ArrayLike,
        spin: SeenSpin | None = None,
    ) -> None:
        checked = increasing_times(times, "detection times")
        n = checked.size
        set_fields(
            self,
            times=checked,
            positions=finite_array(positions, "detected positions", (n, 3)),
            covariances=covariance_matrices(covariances, "detection covariances", n, size=3),
            bias=covariance_matrix(bias, "detection bias", 3),
            spin=spin,
        )

    def __len__(self) -> int:
        return int(self.times.size)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        data = {
            "times": self.times.tolist(),
            "positions": self.positions.tolist(),
            "covariances": unique_numbers(self.covariances).tolist(),
            "bias": unique_numbers(self.bias).tolist(),
        }
        return data if self.spin is None else {**data, "spin": self.spin.to_dict()}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Detections:
        """Read what `to_dict` wrote."""
        try:
            return Detections(
                data["times"],
                data["positions"],
                symmetric_matrices(
                    finite_array(data["covariances"], "detection covariances", (None, 6))
                ),
                symmetric_matrices(finite_array(data["bias"], "detection bias", (6,))),
                SeenSpin.from_dict(data["spin"]) if "spin" in data else None,
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"detections cannot be read ({error}); expected times, positions, covariances, bias"
            ) from None


def unique_numbers(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the numbers that determine symmetric matrices.

    Parameters
    ----------
    matrices : (…, 3, 3)

    Returns
    -------
    array
        (…, 6): xx, xy, xz, yy, yz, zz
    """
    return np.ascontiguousarray(matrices[..., UNIQUE[0], UNIQUE[1]])


def symmetric_matrices(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the symmetric matrices (…, 3, 3) whose `unique_numbers` are given.

    Parameters
    ----------
    numbers : (…, 6): xx, xy, xz, yy, yz, zz
    """
    matrices = np.empty((*numbers.shape[:-1], 3, 3))
    matrices[..., UNIQUE[0], UNIQUE[1]] = numbers
    matrices[..., UNIQUE[1], UNIQUE[0]] = numbers
    return matrices


@dataclass(frozen=True)
class ObservedObject:
    """One object of an observation.

    Parameters
    ----------
    object : its material and shape
    trajectory : Y_j^i, its perceived positions
    initial_state : θ_d with covariance at the observation's `start_time`
    detections : what the trajectory was smoothed from; None where that is not known
    """

    object: SceneObject
    trajectory: Trajectory
    initial_state: ObjectState
    detections: Detections | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return {
            "object": self.object.to_dict(),
            "times": self.trajectory.times.tolist(),
            "positions": self.trajectory.positions.tolist(),
            "initial_state": self.initial_state.to_dict(),
            "detections": None if self.detections is None else self.detections.to_dict(),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> ObservedObject:
        """Read what `to_dict` wrote."""
        try:
            detections = data.get("detections")
            return ObservedObject(
                SceneObject.from_dict(data["object"]),
                Trajectory(data["times"], data["positions"]),
                ObjectState.from_dict(data["initial_state"]),
                None if detections is None else Detections.from_dict(detections),
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"observed object cannot be read ({error}); "
                "expected object, times, positions, initial_state"
            ) from None


@dataclass(frozen=True)
class Observation:
    """Y^i: the environment and the trajectory of each object seen in it.

    Parameters
    ----------
    environment : Ω_e
    objects : at least one
    start_time : s, on the clock of the trajectories; the initial states hold at this time
    id : unique among all observations; empty: the digest of all the others, so that the same
        content always has the same id
    """

    environment: Environment
    objects: tuple[ObservedObject, ...]
    start_time: float
    id: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", tuple(self.objects))
        if self.id == "":
            object.__setattr__(self, "id", self._digest())
        name_string(self.id, "observation id")
        for item in self.objects:
            if item.trajectory.times[-1] <= self.start_time:
                raise InvalidInputError(
                    f"object {item.object.id} was last seen at {item.trajectory.times[-1]:.6g} s "
                    f"and the observation starts at {self.start_time:.6g} s; "
                    "expected points after the start"
                )
        self.scene()

    def scene(self) -> Scene:
        """Return the world at `start_time`, ready to be simulated."""
        return Scene(
            self.environment,
            tuple(item.object for item in self.objects),
            tuple(item.initial_state for item in self.objects),
        )

    @property
    def materials(self) -> tuple[str, ...]:
        """Materials of objects, then of the environment, each once."""
        return self.scene().materials

    @property
    def time_span(self) -> tuple[float, float]:
        """First and last time in s at which any of its objects was seen."""
        times = [item.trajectory.times for item in self.objects]
        times += [item.detections.times for item in self.objects if item.detections is not None]
        return min(float(t[0]) for t in times), max(float(t[-1]) for t in times)

    @property
    def point_count(self) -> int:
        """Points of all trajectories and detections together."""
        return sum(
            len(item.trajectory) + (0 if item.detections is None else item.detections.times.size)
            for item in self.objects
        )

    def check_limits(self) -> None:
        """Check that what was observed is of a size to learn from (`limits`).

        Raises
        ------
        InvalidInputError
            When it has too many materials, objects or points, or lasts too long.
        """
        first, last = self.time_span
        for limit, got, what in (
            ("most_materials", len(self.materials), "materials"),
            ("most_objects", len(self.objects), "objects"),
            ("most_points", self.point_count, "points"),
            ("longest_observation", last - min(first, self.start_time), "s from begin to end"),
        ):
            check_limit(limit, got, f"{what} of observation {self.id}")

    def same_motion(self, other: Observation) -> bool:
        """Return whether one object at least was measured in the same frames for both.

        A recording that is played again gives observations that are not quite equal: frames are
        dropped, the environment is modelled from others and a motion begins or ends at another
        frame. They are still the same measurement: at the frames they share they differ by far less
        than the noise that is in both. Two measurements, even of equal motions, differ by their
        noise. So two tracks are the same if they share `SAME_POINTS` stamps at least, lie within
        each other there, and, after the rotation and shift that another environment makes, differ
        by less than `SAME_SHARE` of the mean square that independent errors would make.

        Where one of two objects has no detections the trajectories are compared, with the errors of
        the other one's detections; where neither has any, the size of the noise is unknown, and
        only the same id means the same motion. Motions whose `time_span` do not overlap are never
        the same.
        """
        if self.id == other.id:
            return True
        if self.environment.frame_id != other.environment.frame_id:
            return False
        return any(
            _is_same_track(mine, its)
            for mine in self.objects
            for its in other.objects
            if type(mine.object.shape) is type(its.object.shape)
        )

    def to_json(self) -> str:
        """Return the observation as JSON text."""
        return json.dumps({"format": FORMAT, "id": self.id, **self._content()}, allow_nan=False)

    def _content(self) -> dict[str, Any]:
        """Everything but its id, as plain data."""
        return {
            "start_time": self.start_time,
            "environment": self.environment.to_dict(),
            "objects": [item.to_dict() for item in self.objects],
        }

    def _digest(self) -> str:
        text = json.dumps(self._content(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:ID_LENGTH]

    @staticmethod
    def from_json(text: str) -> Observation:
        """Read what `to_json` wrote.

        Raises
        ------
        InvalidInputError
            When the text is cut short, not JSON, or not an observation.
        """
        check_limit("longest_text", len(text), "characters of the observation")
        try:
            data = json.loads(text)
        except RecursionError:
            raise InvalidInputError(
                "observation is JSON of too many levels; expected one of ours"
            ) from None
        except json.JSONDecodeError as error:
            raise InvalidInputError(f"observation is not whole JSON: {error}") from None
        got = data.get("format") if isinstance(data, dict) else type(data).__name__
        if not isinstance(data, dict) or got != FORMAT:
            raise InvalidInputError(f"observation has the format {got!r}; expected {FORMAT!r}")
        try:
            check_limit("most_objects", len(data["objects"]), "objects")
            observation = Observation(
                Environment.from_dict(data["environment"]),
                tuple(ObservedObject.from_dict(item) for item in data["objects"]),
                float(data["start_time"]),
                data["id"],
            )
            observation.check_limits()
            return observation
        except (KeyError, TypeError) as error:
            raise InvalidInputError(f"observation cannot be read: it lacks {error}") from None


def _is_same_track(a: ObservedObject, b: ObservedObject) -> bool:
    """Whether two tracks were measured in the same frames, see `Observation.same_motion`."""
    if a.detections is not None and b.detections is not None:
        i, j = _shared(a.detections.times, b.detections.times)
        ours, theirs = a.detections.positions[i], b.detections.positions[j]
        spread = a.detections.covariances[i] + b.detections.covariances[j]
    else:
        known = a.detections or b.detections
        if known is None:
            return False
        i, j = _shared(a.trajectory.times, b.trajectory.times)
        ours, theirs = a.trajectory.positions[i], b.trajectory.positions[j]
        spread = np.broadcast_to(2.0 * known.covariances.mean(axis=0), (len(i), 3, 3))
    reach = min(a.object.shape.bounding_radius, b.object.shape.bounding_radius)
    if len(i) < SAME_POINTS or np.sqrt(np.square(ours - theirs).sum(axis=1).mean()) > reach:
        return False
    off = ours - _moved_onto(theirs, ours)
    spread = spread + ROUNDING**2 * np.eye(3)
    squares = np.einsum("ni,ni->", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
    # A rotation and a shift take 6 degrees of freedom.
    return bool(squares < SAME_SHARE * (3 * len(i) - 6))


def _shared(
    a: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the times in s, (n,) and (m,), that are the same stamp in both."""
    after = np.searchsorted(b, a - SAME_STAMP)
    same = np.flatnonzero(np.append(b, np.inf)[after] <= a + SAME_STAMP)
    return same, after[same]


def _moved_onto(points: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) m, rotated and shifted so that they come nearest to the targets (n, 3) m."""
    middle, target = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (targets - target))
    u[:, 2] *= np.sign(np.linalg.det(u @ vt))
    return np.asarray((points - middle) @ (u @ vt) + target)


def observation_materials(observations: Sequence[Observation]) -> tuple[str, ...]:
    """Materials of all observations, each once, in order of appearance."""
    return tuple(dict.fromkeys(name for item in observations for name in item.materials))


def save_observation(observation: Observation, path: str | os.PathLike[str]) -> None:
    """Write one observation to a file that appears whole or not at all."""
    target = Path(path)
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=target.parent, prefix=target.name, delete=False
        ) as file:
            file.write(observation.to_json())
            file.flush()
            os.fsync(file.fileno())
        os.replace(file.name, target)
    except OSError as error:
        raise InvalidInputError(f"cannot write {target}: {error.strerror}") from None


def load_observation(path: str | os.PathLike[str]) -> Observation:
    """Read a file that `save_observation` wrote."""
    try:
        check_limit("longest_text", Path(path).stat().st_size, f"bytes of {path}")
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"cannot read {path}: {error}") from None
    try:
        return Observation.from_json(text)
    except InvalidInputError as error:
        raise InvalidInputError(f"{path}: {error}") from None
