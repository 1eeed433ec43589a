"""A throw as the depth camera sees it, with the newest prediction drawn ahead of the ball."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw

from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.report.figure_style import OBSERVED, PREDICTED, SPHERE
from intuitive_physics_experiments.demo.demo_result import PerceivedFrame
from intuitive_physics_experiments.demo.figures import projected

# Pixels of the moving picture, and how much larger it is drawn, so that lines are smooth.
WIDTH, SCALE = 480, 2

# Greys of depth; noise within a shade does not make the file larger.
SHADES = np.linspace(70, 230, 20).round()

SLOWER = 2.0  # Times as long as the throw took
MARGIN = 0.5  # Width of the picture beside the track, as a part of the track's extent
LAST_SHOWN = 1.5  # s for which the last frame stays, of the moving picture
SAMPLES = 20  # Paths of a prediction that are drawn


@dataclass(frozen=True, eq=False)
class PredictedPaths:
    """One prediction."""

    made: float  # s, the stamp of the states that it begins with
    times: NDArray[np.float64]  # (n,) s from then on
    paths: NDArray[np.float64]  # (n_samples, n, 3) m


def write_moving_picture(
    path: Path,
    frames: Iterable[tuple[float, NDArray[Any]]],
    perceived: PerceivedFrame,
    track: Trajectory,
    radius: float,
    predictions: Sequence[PredictedPaths],
    comment: str = "",
) -> None:
    """Write an animated GIF of a throw, in slow motion, that begins again and again.

    The `frames` (...) are stamps in s and depth images (height, width) of the recording,
    predictions stand in the order in which they were made; the comment is written into the file.
    """
    view = _View(perceived, _part_shown(perceived, track))
    first, last = track.times[0] - 0.1, track.times[-1]
    pictures = [
        view.draw(depth, time, track, radius, _newest(predictions, time))
        for time, depth in frames
        if first <= time <= last
    ]
    palette = _palette()
    coloured = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    shown = 1000.0 * SLOWER * float(np.median(np.diff(track.times)))
    durations = [*[shown] * (len(coloured) - 1), 1000.0 * LAST_SHOWN]
    coloured[0].save(
        path,
        save_all=True,
        append_images=coloured[1:],
        duration=durations,
        loop=0,
        optimize=False,
        comment=comment,
    )


@dataclass(frozen=True, eq=False)
class _View:
    """View of the camera: a frame, with what was perceived and predicted drawn in."""

    perceived: PerceivedFrame  # where the camera is
    # left, top, right and bottom of what is shown, in pixels of the camera
    part: tuple[float, float, float, float]

    def draw(
        self,
        depth: NDArray[Any],
        time: float,
        track: Trajectory,
        radius: float,
        predicted: PredictedPaths | None,
    ) -> Image.Image:
        """Draw one frame."""
        size = SCALE * WIDTH, SCALE * round(WIDTH * depth.shape[0] / depth.shape[1])
        image = _grey(depth).resize(size, Image.Resampling.NEAREST, self.part)
        pen = ImageDraw.Draw(image, "RGBA")
        is_past = track.times <= time + 1e-3
        if predicted is not None and is_past.any() and time < track.times[-1]:
            ahead = predicted.times + predicted.made >= time
            for path in predicted.paths[:SAMPLES, ahead]:
                pen.line(self._pixels(path), fill=f"{PREDICTED}70", width=SCALE)
            mean = predicted.paths[:, ahead].mean(axis=0)
            pen.line(self._pixels(mean), fill=PREDICTED, width=2 * SCALE)
        for place in track.positions[is_past]:
            self._circle(pen, place, 0.006, OBSERVED, fill=True)
        if is_past.any() and time <= track.times[-1] + 1e-3:
            self._circle(pen, track.positions[is_past][-1], radius, SPHERE)
        return image.resize((size[0] // SCALE, size[1] // SCALE), Image.Resampling.BOX)

    def _pixels(self, points: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Places of points (n, 3) m of the environment on the drawing."""
        pixels = self._scale * (_projected(self.perceived, points) + 0.5 - self.part[:2])
        return [(float(u), float(v)) for u, v in pixels]

    @property
    def _scale(self) -> float:
        """Pixels of the drawing for one of the camera."""
        return SCALE * WIDTH / (self.part[2] - self.part[0])

    def _circle(
        self, pen: Any, place: NDArray[np.float64], radius: float, color: str, *, fill: bool = False
    ) -> None:
        """Draw a ball of a radius in m at a place (3,) m."""
        ((u, v),) = self._pixels(place[None])
        depth = (place - self.perceived.translation) @ self.perceived.rotation[:, 2]
        size = self._scale * radius * self.perceived.truth.camera.focal_length / depth
        box = (u - size, v - size, u + size, v + size)
        pen.ellipse(box, fill=color if fill else None, outline=color, width=2 * SCALE)


def _projected(perceived: PerceivedFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels (n, 2) of points (n, 3) of the environment."""
    matrix = perceived.truth.camera.matrix()
    return projected(points, perceived.rotation, perceived.translation, matrix)


def _part_shown(perceived: PerceivedFrame, track: Trajectory) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the part of the image about a track, in pixels.

    It has the image's own proportions.
    """
    whole = np.array([perceived.truth.camera.width, perceived.truth.camera.height])
    pixels = _projected(perceived, track.positions)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    size = whole * min(1.0, float(((1.0 + 2.0 * MARGIN) * (high - low) / whole).max()))
    left, top = np.clip((low + high - size) / 2.0, 0.0, whole - size)
    return float(left), float(top), float(left + size[0]), float(top + size[1])


def _newest(predictions: Sequence[PredictedPaths], time: float) -> PredictedPaths | None:
    """Return the newest prediction of what had been seen until a time, s."""
    return next(
        (prediction for prediction in reversed(predictions) if prediction.made <= time + 1e-3), None
    )


def _grey(depth: NDArray[Any]) -> Image.Image:
    """Near is dark, far is light, and what has no reading is white."""
    read = depth > 0
    near, far = np.quantile(depth[read], (0.01, 0.99))
    part = np.clip((depth - near) / max(far - near, 1.0), 0.0, 1.0)
    shade = SHADES[np.round(part * (SHADES.size - 1)).astype(np.intp)]
    return Image.fromarray(np.where(read, shade, 255).astype(np.uint8)).convert("RGB")


def _palette() -> Image.Image:
    """Return the shades of depth, the colours of what is drawn, and what is between these."""
    greys = np.repeat(np.append(SHADES, 255.0)[:, None], 3, axis=1)
    mixed = [
        part * np.array(ImageColor.getrgb(color)) + (1.0 - part) * greys[::4]
        for color in (OBSERVED, PREDICTED, SPHERE)
        for part in (0.25, 0.5, 0.75, 1.0)
    ]
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([greys, *mixed]).astype(np.uint8).ravel().tolist())
    return palette
