"""Factors on the uncertainties, from the errors of earlier predictions.

Each second a few predictions are kept. When an object is detected later, its position is compared
with the predictions of that instant, which were made before it (Dawid: Statistical theory: the
prequential approach, 1984). For a factor s on the standard deviations, an error d from a mean
with covariance C, detected with covariance R, has the log density

    -½ log |S| - ½ (ν + 3) log(1 + dᵀ S⁻¹ d / (c ν)),    S = s² C + R,

that of Student's t with ν = 5: a ball that a hand has caught must not widen what free ones get. The
number c makes s = 1 the most likely factor of normal errors with covariance S. The sum over all
comparisons, forgotten slowly, on a grid of log s, with a normal prior about s = 1, is a posterior
whose mean and width are the factor and its error.
"""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.noise import StateNoise

FORMAT = "intuitive_physics/self_calibration/2"
"""Format and version that a file names."""

GRID = np.linspace(np.log(0.2), np.log(5.0), 65)
"""Logarithms of the possible factors: none is below a fifth or above five."""

PRIOR_DEVIATION = 0.35
"""Standard deviation of the logarithm of a factor before any comparison."""

FREEDOM = 5.0
"""ν of Student's t."""

MATCHED = 0.7841364725284198
"""c, for which the expectation of (ν + 3) x / (c ν + x) is 3, with x of χ² with three degrees."""

MEMORY = 200.0
"""Independent comparisons after which earlier ones count e⁻¹: some hundred throws."""

INDEPENDENT_AFTER = 0.5
"""s after which another comparison of the same object is an independent one. Errors of one throw
share its spin, so there are few."""

HORIZONS = (0.1, 0.2, 0.4, 0.7, 1.0)
"""s between a prediction and the detection that it is compared with."""

EVERY = 0.1
"""s between predictions that are kept."""

CLOSE = 0.02
"""s by which a comparison may miss its horizon."""

FREE_FALL = 0.3
"""Part of gravity by which the mean's acceleration may be off before a contact is predicted."""

KINDS = ("state", "spin")
"""The factors. `spin` is on the prior of guessed spins: it follows predictions that begin with one
and go beyond a contact. `state` is on estimated poses and velocities: it follows all others."""


@dataclass(frozen=True)
class Factor:
    """One factor on standard deviations.

    Parameters
    ----------
    value : of the factor
    error : relative standard error
    comparisons : number of independent ones, without those that are forgotten
    """

    value: float
    error: float
    comparisons: float


@dataclass(frozen=True, eq=False)
class _Kept:
    """A prediction that waits for detections: by object, mean, covariance and first contact."""

    time: float  # s, of its beginning
    times: NDArray[np.float64]  # (n_times,) s after that
    means: dict[str, NDArray[np.float64]]  # (n_times, 3) m
    covariances: dict[str, NDArray[np.float64]]  # (n_times, 3, 3) m²
    contact: dict[str, float]  # s after the beginning, of objects with a guessed spin
    factors: dict[str, float]  # by kind, that it was made with


class SelfCalibration:
    """Follows the factors, detection by detection."""

    def __init__(self) -> None:
        self._sums = {kind: np.zeros(GRID.size) for kind in KINDS}
        self._counts = dict.fromkeys(KINDS, 0.0)
        self._kept: deque[_Kept] = deque()
        self._detected: dict[str, float] = {}

    def factor(self, kind: str) -> Factor:
        """Return the posterior mean of a factor, one of `KINDS`, with its error."""
        if self._counts[kind] == 0.0:
            return Factor(1.0, PRIOR_DEVIATION, 0.0)
        logarithms = self._sums[kind] - 0.5 * (GRID / PRIOR_DEVIATION) ** 2
        weights = np.exp(logarithms - logarithms.max())
        weights /= weights.sum()
        mean = float(weights @ GRID)
        error = float(np.sqrt(weights @ (GRID - mean) ** 2))
        return Factor(float(np.exp(mean)), error, self._counts[kind])

    def factors(self) -> dict[str, Factor]:
        """Return all factors by their kind."""
        return {kind: self.factor(kind) for kind in KINDS}

    def applied_to(self, noise: StateNoise) -> StateNoise:
        """Return noise with its standard deviations multiplied by the factors.

        The factor of guessed spins is on their prior, from which estimates begin too; the other one
        is on pose and velocity.
        """
        state, spin = (self.factor(kind).value for kind in KINDS)
        return replace(noise, scale=noise.scale * state, guess_scale=noise.guess_scale * spin)

    def take_prediction(
        self,
        made: TrajectoryDistribution,
        time: float,
        gravity: NDArray[np.float64],
        guessed: Set[str] = frozenset(),
    ) -> None:
        """Keep a prediction, unless one was kept just before.

        Its times begin at `time` (s), on the clock of the detections, with gravity (3,) m/s²;
        `guessed` are the objects whose spin is a guess.
        """
        if self._kept and not time - self._kept[-1].time >= 0.0:
            self._kept.clear()
        if self._kept and time - self._kept[-1].time < EVERY:
            return
        until = int(np.searchsorted(made.times, HORIZONS[-1] + 2.0 * CLOSE))
        times = made.times[:until]
        mean, covariance = made.mean[:, :until], made.covariance[:, :until]
        named = list(enumerate(made.object_ids))
        spins = [(k, name) for k, name in named if name in guessed]
        self._kept.append(
            _Kept(
                time=time,
                times=times,
                means={name: mean[k] for k, name in named},
                covariances={name: covariance[k] for k, name in named},
                contact={name: _first_contact(times, mean[k], gravity) for k, name in spins},
                factors={kind: self.factor(kind).value for kind in KINDS},
            )
        )
        while time - self._kept[0].time > HORIZONS[-1] + 2.0 * CLOSE:
            self._kept.popleft()

    def take_detection(
        self,
        object_id: str,
        time: float,
        position: NDArray[np.float64],
        covariance: NDArray[np.float64],
    ) -> None:
        """Compare a detection with the predictions of its time (s).

        It has position (3,) m and covariance (3, 3) m² of its error.
        """
        since = time - self._detected.get(object_id, -np.inf)
        # An object detected earlier than that counts as new.
        recent = self._detected.items()
        self._detected = {each: at for each, at in recent if 0.0 <= time - at < INDEPENDENT_AFTER}
        self._detected[object_id] = time
        weight = min(max(since, 0.0), INDEPENDENT_AFTER) / INDEPENDENT_AFTER / len(HORIZONS)
        for kept in self._kept:
            after = time - kept.time
            if object_id in kept.means and min(abs(after - h) for h in HORIZONS) < CLOSE:
                self._compare(kept, object_id, after, position, covariance, weight)

    def _compare(
        self,
        kept: _Kept,
        object_id: str,
        after: float,
        position: NDArray[np.float64],
        covariance: NDArray[np.float64],
        weight: float,
    ) -> None:
        k = int(np.searchsorted(kept.times, after))
        if not 0 < k < kept.times.size:
            return
        share = (after - kept.times[k - 1]) / (kept.times[k] - kept.times[k - 1])
        means, spreads = kept.means[object_id], kept.covariances[object_id]
        error = position - (1.0 - share) * means[k - 1] - share * means[k]
        spread = (1.0 - share) * spreads[k - 1] + share * spreads[k]
        kind = KINDS[after > kept.contact.get(object_id, np.inf)]
        self._forget(kind, weight)
        relative = np.exp(2.0 * GRID) / kept.factors[kind] ** 2
        self._sums[kind] += weight * _log_density(error, spread, covariance, relative)
        self._counts[kind] += weight

    def _forget(self, kind: str, weight: float) -> None:
        left = float(np.exp(-weight / MEMORY))
        self._sums[kind] *= left
        self._counts[kind] *= left

    def to_dict(self) -> dict[str, Any]:
        """Plain data that JSON holds as it is."""
        return {
            "format": FORMAT,
            "grid": [float(GRID[0]), float(GRID[-1]), GRID.size],
            **{
                kind: {"sums": self._sums[kind].tolist(), "comparisons": self._counts[kind]}
                for kind in KINDS
            },
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> SelfCalibration:
        """Read the result of `to_dict`; other data are an InvalidInputError."""
        got = data.get("format") if isinstance(data, Mapping) else type(data).__name__
        if got != FORMAT:
            raise InvalidInputError(f"calibration has the format {got!r}; expected {FORMAT!r}")
        made = SelfCalibration()
        try:
            for kind in KINDS:
                made._sums[kind] = finite_array(data[kind]["sums"], "sums", (GRID.size,)).copy()
                made._counts[kind] = float(data[kind]["comparisons"])
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInputError(
                f"calibration cannot be read ({error}); expected sums and comparisons of "
                f"{' and '.join(KINDS)}"
            ) from None
        return made


def load_calibration(path: Path) -> SelfCalibration:
    """Read a file that `save_calibration` wrote; where there is none, start without comparisons.

    A file that cannot be read, or is another one, is an InvalidInputError.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return SelfCalibration()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"calibration {path} cannot be read: {error}") from None
    try:
        return SelfCalibration.from_dict(json.loads(text))
    except (json.JSONDecodeError, RecursionError):
        raise InvalidInputError(f"calibration {path} is not JSON; expected one of ours") from None
    except InvalidInputError as error:
        raise InvalidInputError(f"{path}: {error}") from None


def save_calibration(data: Mapping[str, Any], path: Path) -> None:
    """Write data of `SelfCalibration.to_dict` into a file, which appears whole or not at all.

    Its folder is made where there is none. A file that cannot be written is an InvalidInputError.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{os.getpid()}")
        partial.write_text(json.dumps(data), encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise InvalidInputError(
            f"calibration cannot be written to {path}: {error.strerror}; expected a file that can "
            "be, or an empty calibration_file"
        ) from None


def _first_contact(
    times: NDArray[np.float64], means: NDArray[np.float64], gravity: NDArray[np.float64]
) -> float:
    """Time in s from which on a mean path (n_times, 3) m is no free flight; infinite if it is."""
    if times.size < 3:
        return np.inf
    step = times[1] - times[0]
    apart = np.linalg.norm(np.diff(means, 2, axis=0) / step**2 - gravity, axis=1)
    met = np.flatnonzero(apart > FREE_FALL * np.linalg.norm(gravity))
    return float(times[met[0]]) if met.size else np.inf


def _log_density(
    error: NDArray[np.float64],
    spread: NDArray[np.float64],
    covariance: NDArray[np.float64],
    relative: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Log density (n,), up to a constant, of an error (3,) m for factors `relative` (n,).

    The factors are on the prediction's covariance `spread` (3, 3) m², not on the detection's.
    """
    whole = relative[:, None, None] * spread + covariance
    squares = error @ np.linalg.solve(whole, np.broadcast_to(error, (len(whole), 3))[..., None])
    tails = np.log1p(squares[:, 0] / (MATCHED * FREEDOM))
    return np.asarray(-0.5 * np.linalg.slogdet(whole)[1] - 0.5 * (FREEDOM + 3.0) * tails)
