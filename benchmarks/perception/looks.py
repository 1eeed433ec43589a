"""The spin of painted balls in their first flight, as their surface shows it, against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import report_progress
from benchmarks.perception.scenes import first_bounce
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.shapes import Sphere
from intuitive_physics_experiments.rendering.ball_surface import PATTERNS, BallSurface
from intuitive_physics_experiments.rendering.color_camera import DepthColorCamera, RoomLight
from intuitive_physics_experiments.rendering.corner_room import (
    corner_camera,
    corner_environment,
    true_parameters,
)
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.throws import Throw, make_throws
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_predictor.scores.highest_density import WITHIN_TWO_SIGMA

SEED = 61  # of the throws, each of which has a generator of its own
SPINS = (2.0, 10.0, 40.0)  # rad/s, standard deviations of each component of the spin
# Throws of each pattern and spin of a full measurement and of a first look
THROWS, QUICK_THROWS = 30, 6
RATE = 30.0  # frames a second
FLIGHT = 0.7  # s of a throw at most; its first flight is shorter as a rule
# rad/s, geometric mean of the standard deviations below which a spin counts as known: half of what
# is assumed of an unknown one
SURE = 5.0


@dataclass
class SpinErrors:
    """What became of the spins of one pattern and of one standard deviation."""

    # rad/s, length of the error at the end of each flight whose spin was known
    errors: list[float] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)  # squared, in variances, of the same
    frames: list[int] = field(default_factory=list)  # of each flight, that showed the ball
    # frames of these flights until the spin was known
    first: list[int] = field(default_factory=list)
    # of tracking and looking in each frame with a ball
    seconds: list[float] = field(default_factory=list)


class LookedAtRoom:
    """The corner room, seen by a depth and colour camera, through all of perception."""

    def __init__(self, rng: np.random.Generator, light: RoomLight) -> None:
        self.camera = corner_camera()
        renderer = DepthRenderer(self.camera, corner_environment())
        self._images = DepthColorCamera(renderer, rng, light)
        self.pipeline = PerceptionPipeline(
            PerceptionSettings(), np.random.default_rng(0), clock=thread_time
        )
        self._frame = 0
        while self.pipeline.model is None:
            self._perceive(self._images.points(), None)

    def _perceive(self, points: NDArray[np.float32], colors: NDArray[np.uint8] | None) -> Any:
        self._frame += 1
        return self.pipeline.process(points, self._frame / RATE, colors)

    def first_flight(self, throw: Throw, surface: BallSurface, found: SpinErrors) -> None:
        """Perceive a throw up to its first bounce and add what its surface showed to `found`."""
        end = first_bounce(throw, corner_environment()) or FLIGHT
        spin = throw.motion.angular_velocities[0] @ self.camera.rotation
        known: NDArray[np.float64] | None = None
        count, first, covariance = 0, 0, np.eye(3)
        while count / RATE < end:
            ball = throw.colored_at(throw.start_time + count / RATE, surface)
            result = self._perceive(self._images.points([ball]), self._images.colors([ball]))
            count += 1
            found.seconds.append(result.diagnostics.seconds.get("tracking", 0.0))
            states = [
                seen.state for seen in result.objects if isinstance(seen.object.shape, Sphere)
            ]
            known = None
            if states and result.model is not None:
                covariance = states[-1].covariance[9:, 9:]
                if np.linalg.det(covariance) ** (1.0 / 6.0) < SURE:
                    known = states[-1].angular_velocity - result.model.rotation @ spin
                    first = first or count
        found.frames.append(count)
        if known is None:
            return
        found.first.append(first)
        found.errors.append(float(np.linalg.norm(known)))
        found.distances.append(float(known @ np.linalg.solve(covariance, known)))


def measure_looks(quick: bool, seed: int = SEED) -> tuple[dict[str, Any], list[Table]]:
    """Return key figures and table of spins by pattern and by how fast balls spin."""
    count = QUICK_THROWS if quick else THROWS
    found: dict[tuple[str, float], SpinErrors] = {}
    for pattern in PATTERNS:
        for spin in SPINS:
            report_progress(f"spin of balls: {pattern}, {spin:g} rad/s")
            found[pattern, spin] = SpinErrors()
            for k in range(count):
                key = [seed, PATTERNS.index(pattern), int(spin), k]
                measure_throw(pattern, spin, np.random.default_rng(key), found[pattern, spin])
    return {"spin_from_surface": _figures(found)}, [looks_table(found)]


def measure_throw(pattern: str, spin: float, rng: np.random.Generator, found: SpinErrors) -> None:
    """Throw one ball in light from a random direction and add what was seen to `found`."""
    direction = rng.normal(size=3) + [-0.5, -0.5, 1.0]
    light = RoomLight((direction[0], direction[1], direction[2]), gloss=0.3 * float(rng.random()))
    room = LookedAtRoom(rng, light)
    (throw,) = make_throws(
        1,
        room.camera,
        corner_environment(),
        true_parameters(),
        rng,
        first_start=0.0,
        duration=FLIGHT,
        pause=0.1,
        materials=["rubber"],
        spin=spin,
    )
    room.first_flight(throw, BallSurface(pattern), found)


def _figures(found: dict[tuple[str, float], SpinErrors]) -> dict[str, Any]:
    return {
        pattern: {
            f"{spin:g}": {
                "known": float(f"{len(own.errors) / max(len(own.frames), 1):.3g}"),
                "error": _number(np.median(own.errors)) if own.errors else None,
                "within_2_sigma": _number(np.mean(np.array(own.distances) < WITHIN_TWO_SIGMA))
                if own.errors
                else None,
            }
            for (name, spin), own in found.items()
            if name == pattern
        }
        for pattern in PATTERNS
    }


def _number(value: Any) -> float:
    return float(f"{float(value):.3g}")


def looks_table(found: dict[tuple[str, float], SpinErrors]) -> Table:
    """Return errors by pattern and by standard deviation of the spins."""
    rows: list[list[Cell]] = []
    for (pattern, spin), own in found.items():
        rows.append(
            [
                pattern,
                spin,
                len(own.frames),
                float(np.median(own.frames)),
                len(own.errors),
                _quantile(own.first, 0.5),
                _quantile(own.errors, 0.5),
                _quantile(own.errors, 0.9),
                float(np.mean(own.distances)) / 3.0 if own.distances else None,
                float(np.mean(np.array(own.distances) < WITHIN_TWO_SIGMA))
                if own.distances
                else None,
                1e3 * float(np.mean(own.seconds)),
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
