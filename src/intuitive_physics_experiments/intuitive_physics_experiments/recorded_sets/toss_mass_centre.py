"""Centre-of-mass offset of a tossed cube, from its flight before it touches anything.

In flight the centre of mass is on a parabola and the cube's centre circles it:
x(t) = x_m + v_m t + g t² / 2 - R(t) c, linear in all that is not known. g is fitted too, for
lengths may be recorded too short.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.recorded_sets.cube_tosses import CubeToss
from intuitive_physics_experiments.recorded_sets.tumbling_flight import cube_gaps

# Distance of a corner from a plane below which a row may be no flight, in widths of the cube.
CLEARANCE = 0.05

FEWEST_ROWS = 6  # Rows of the shortest flight before the first touch that is fitted


@dataclass(frozen=True, eq=False)
class MassCentreFit:
    """A centre of mass."""

    mass_centre: NDArray[np.float64]  # (3,) m, in the cube's axes, from its centre
    deviation: NDArray[np.float64]  # (3,) m, σ of each, from how the flights differ
    flights: int  # tosses it is fitted to


def fit_mass_centre(tosses: Sequence[CubeToss]) -> MassCentreFit:
    """Fit one centre of mass, and one gravity, to the flights of all tosses by least squares."""
    flights = [flight for flight in map(_flight, tosses) if flight is not None]
    if not flights:
        raise InvalidInputError(
            f"no toss flies for {FEWEST_ROWS} rows before it touches; expected one to fit the "
            "centre of mass to"
        )
    normal = sum(columns.T @ columns for columns, _ in flights)
    if len(flights) < 3 or np.linalg.cond(normal) > 1e12:
        raise InvalidInputError(
            f"{len(flights)} flights do not determine the centre of mass; expected 3 or more that "
            "turn, each a different way"
        )
    solution = np.linalg.solve(normal, sum(columns.T @ positions for columns, positions in flights))
    # Motion capture is smoothed: errors within a flight are alike, those of two flights are not
    # (the sandwich estimator of clustered data, White 1984).
    pulls = np.array(
        [columns.T @ (positions - columns @ solution) for columns, positions in flights]
    )
    spread = len(flights) / (len(flights) - 2) * pulls.T @ pulls
    covariance = np.linalg.solve(normal, np.linalg.solve(normal, spread).T)
    deviations = np.sqrt(np.diag(covariance))
    return MassCentreFit(np.asarray(-solution[3:]), np.asarray(deviations[3:]), len(flights))


def with_mass_centre(toss: CubeToss, mass_centre: NDArray[np.float64]) -> CubeToss:
    """Return the toss of a cube with the offset `mass_centre` (3,) m in the cube's frame."""
    (observed,) = toss.observation.objects
    x, y, z = mass_centre.tolist()
    cube = replace(observed.object, mass_centre=(x, y, z))
    objects = (replace(observed, object=cube),)
    return replace(toss, observation=replace(toss.observation, objects=objects))


def _flight(toss: CubeToss) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Columns (3 n, 6) of g and of -c, and positions (3 n,), without x_m and v_m; None if short."""
    trajectory = toss.observation.objects[0].trajectory
    turns = Rotation.from_quat(toss.orientations).as_matrix()
    gaps = cube_gaps(toss.observation.environment, toss.width, trajectory.positions, turns)
    touching = np.flatnonzero(gaps < CLEARANCE * toss.width)
    rows = int(touching[0]) if touching.size else len(turns)
    if rows < FEWEST_ROWS:
        return None
    times = trajectory.times[:rows] - trajectory.times[0]
    line, _ = np.linalg.qr(np.stack([np.ones(rows), times], axis=1))

    def bent(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(values - np.tensordot(line @ line.T, values, axes=1))

    falling = 0.5 * times[:, None, None] ** 2 * np.eye(3)
    columns = bent(np.concatenate([falling, turns[:rows]], axis=-1))
    return columns.reshape(-1, 6), bent(trajectory.positions[:rows]).ravel()
