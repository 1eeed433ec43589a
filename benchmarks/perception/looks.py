"""The spin of painted balls in their first flight, as their surface shows it, against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun, tracked_spheres
from benchmarks.perception.scenes import first_bounce
from benchmarks.results.result import Cell, Column, Table
from benchmarks.running_nodes import RATE
from intuitive_physics_experiments.rendering.ball_surface import PATTERNS, BallSurface
from intuitive_physics_experiments.rendering.color_camera import DepthColorCamera, RoomLight
from intuitive_physics_experiments.rendering.corner_room import (
    corner_camera,
    corner_environment,
    true_parameters,
)
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.throws import make_throws
from intuitive_physics_perception.frame_result import FrameResult
from intuitive_physics_predictor.scores.highest_density import WITHIN_TWO_SIGMA

SEED = 61  # of the throws, each of which has a generator of its own
SPINS = (2.0, 10.0, 40.0)  # rad/s, standard deviations of each component of the spin
THROWS, QUICK_THROWS = 30, 1  # of each pattern and spin
FLIGHT = 0.7  # s of a throw at most; its first flight is shorter as a rule
# rad/s, geometric mean of the standard deviations below which a spin counts as known: half of the
# deviation that is assumed of an unknown spin
SURE = 5.0


@dataclass(frozen=True, eq=False)
class SpinError:
    """The error (3,) rad/s of a perceived spin and its covariance (3, 3)."""

    error: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def length(self) -> float:
        """Length of the error in rad/s."""
        return float(np.linalg.norm(self.error))

    @property
    def distance(self) -> float:
        """Squared error in variances."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


@dataclass(frozen=True)
class Flight:
    """The perceived spin in a flight up to the first bounce."""

    frames: int  # that showed the ball
    first: int  # number of the first frame in which the spin was known; 0: none
    seconds: list[float]  # of tracking in each frame with a ball
    error: SpinError | None  # at the end; None: the spin was unknown


def measure_looks(quick: bool) -> Outcome:
    """Measure spins by pattern and by how fast balls spin."""
    flights: dict[tuple[str, float], list[Flight]] = {}
    for pattern in PATTERNS:
        for spin in SPINS:
            report_progress(f"spin of balls: {pattern}, {spin:g} rad/s")
            flights[pattern, spin] = [
                _fly(
                    pattern,
                    spin,
                    np.random.default_rng([SEED, PATTERNS.index(pattern), int(spin), k]),
                )
                for k in range(QUICK_THROWS if quick else THROWS)
            ]
    return Outcome([_table(flights)], {"spin_from_surface": _figures(flights)})


def _fly(pattern: str, spin: float, rng: np.random.Generator) -> Flight:
    """Throw one ball in light from a random direction, and perceive it up to its first bounce."""
    direction = rng.normal(size=3) + [-0.5, -0.5, 1.0]
    light = RoomLight((direction[0], direction[1], direction[2]), gloss=0.3 * float(rng.random()))
    camera, environment = corner_camera(), corner_environment()
    images = DepthColorCamera(DepthRenderer(camera, environment), rng, light)
    run, frame = PerceptionRun(), 0
    while run.pipeline.model is None:
        frame += 1
        run.process(images.points(), frame / RATE)
    (throw,) = make_throws(
        1,
        camera,
        environment,
        true_parameters(),
        rng,
        first_start=0.0,
        duration=FLIGHT,
        pause=0.1,
        materials=["rubber"],
        spin=spin,
    )
    surface, end = BallSurface(pattern), first_bounce(throw, environment) or FLIGHT
    true_spin = run.model.rotation @ (throw.motion.angular_velocities[0] @ camera.rotation)
    count, first, seconds = 0, 0, []
    error = None
    while count / RATE < end:
        ball = throw.colored_at(throw.start_time + count / RATE, surface)
        count += 1
        points, colors = images.points([ball]), images.colors([ball])
        result = run.process(points, (frame + count) / RATE, colors)
        seconds.append(result.diagnostics.seconds.get("tracking", 0.0))
        error = _spin_error(result, true_spin)
        if error is not None:
            first = first or count
    return Flight(count, first, seconds, error)


def _spin_error(result: FrameResult, true_spin: NDArray[np.float64]) -> SpinError | None:
    """Error of the spin of the ball in a frame from the true one (3,) rad/s; None: unknown."""
    tracked = tracked_spheres(result)
    if not tracked:
        return None
    state = tracked[-1].state
    covariance = state.covariance[9:, 9:]
    if np.linalg.det(covariance) ** (1.0 / 6.0) >= SURE:
        return None
    return SpinError(state.angular_velocity - true_spin, covariance)


def _figures(flights: dict[tuple[str, float], list[Flight]]) -> dict[str, Any]:
    figures: dict[str, Any] = {pattern: {} for pattern in PATTERNS}
    for (pattern, spin), group in flights.items():
        errors = [flight.error for flight in group if flight.error is not None]
        figures[pattern][f"{spin:g}"] = {
            "known": _rounded(len(errors) / max(len(group), 1)),
            "error": _rounded(np.median([error.length for error in errors])) if errors else None,
            "within_2_sigma": _rounded(_within(errors)) if errors else None,
        }
    return figures


def _within(errors: Sequence[SpinError]) -> float:
    """Part of the errors that are within two standard deviations."""
    return float(np.mean([error.distance < WITHIN_TWO_SIGMA for error in errors]))


def _rounded(value: Any) -> float:
    return float(f"{float(value):.3g}")


def _table(flights: dict[tuple[str, float], list[Flight]]) -> Table:
    rows: list[list[Cell]] = []
    for (pattern, spin), group in flights.items():
        errors = [flight.error for flight in group if flight.error is not None]
        lengths = [error.length for error in errors]
        rows.append(
            [
                pattern,
                spin,
                len(group),
                float(np.median([flight.frames for flight in group])),
                len(errors),
                _quantile([flight.first for flight in group if flight.error], 0.5),
                _quantile(lengths, 0.5),
                _quantile(lengths, 0.9),
                float(np.mean([error.distance for error in errors])) / 3.0 if errors else None,
                _within(errors) if errors else None,
                1e3 * float(np.mean([s for flight in group for s in flight.seconds])),
            ]
        )
    return Table(
        title="Spin of painted balls from their surface",
        note="At the last frame before the first bounce; balls of 5 cm radius at 30 Hz.",
        columns=[
            Column("pattern"),
            Column("spins", "rad/s"),
            Column("flights"),
            Column("frames, median", "", ".0f"),
            Column("known"),
            Column("frames until known", "", ".0f"),
            Column("error, median", "rad/s", ".2f"),
            Column("90 %", "rad/s", ".2f"),
            Column("squared error in variances", "", ".2f"),
            Column("within 2 σ", "", ".0%"),
            Column("tracking", "ms", ".1f"),
        ],
        rows=rows,
        remarks=["Spins: standard deviation of each component. A plain ball is to be unknown."],
    )


def _quantile(values: Sequence[float], part: float) -> float | None:
    return float(np.quantile(values, part)) if values else None
