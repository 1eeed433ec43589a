"""A rendered RGBD recording: balls thrown into a corner, seen by a faulty depth camera."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import positive_float
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.corner_room import (
    corner_camera,
    corner_environment,
    true_parameters,
)
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.throws import Throw, make_throws
from intuitive_physics_recordings.depth_bag_writer import DepthBagWriter

# ns since the epoch, fixed so that equal settings give equal bags.
START_TIME = 1_750_000_000 * 1_000_000_000


@dataclass(frozen=True)
class RenderSettings:
    """Settings of a rendered bag."""

    throws: int = 12  # number of throws, the materials in turn
    seed: int = 0  # of throws and noise
    frame_rate: float = 30.0  # Hz
    exposure: float = 0.0  # s, in the middle of which each stamp is: balls are swept meanwhile
    lead_in: float = 1.0  # s of empty scene at the start, for modelling the environment
    throw_duration: float = 2.4  # s from hand to end
    pause: float = 0.6  # s without a ball after each throw
    noise: DepthNoise = field(default_factory=DepthNoise)  # the camera's faults

    def __post_init__(self) -> None:
        if self.throws < 1:
            raise InvalidInputError(f"{self.throws} throws were asked for; expected at least 1")
        if self.seed < 0:
            raise InvalidInputError(f"seed is {self.seed}; expected 0 or more")
        for name in ("frame_rate", "throw_duration", "pause", "lead_in"):
            positive_float(getattr(self, name), name.replace("_", " "))
        if not 0.0 <= self.exposure < 1.0 / self.frame_rate:
            raise InvalidInputError(
                f"exposure is {self.exposure:g} s at {self.frame_rate:g} frames a second; expected "
                "0 or more, and less than the time between two frames"
            )


def render_bag(
    path: str | os.PathLike[str],
    settings: RenderSettings,
    report_progress: Callable[[int, int], None] = lambda done, total: None,
) -> GroundTruth:
    """Render a new bag with its ground truth; it appears whole or not at all."""
    throw_rng, noise_rng = map(
        np.random.default_rng, np.random.SeedSequence(settings.seed).spawn(2)
    )
    camera, environment, parameters = corner_camera(), corner_environment(), true_parameters()
    throws = make_throws(
        settings.throws,
        camera,
        environment,
        parameters,
        throw_rng,
        first_start=settings.lead_in,
        duration=settings.throw_duration,
        pause=settings.pause,
    )
    truth = GroundTruth(
        asdict(settings), START_TIME, camera, environment, parameters, tuple(throws)
    )
    render_truth(path, truth, settings, noise_rng, report_progress)
    return truth


def render_truth(
    path: str | os.PathLike[str],
    truth: GroundTruth,
    settings: RenderSettings,
    rng: np.random.Generator,
    report_progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Render the throws of a ground truth, any number of balls at once, as a new bag.

    Settings are frame rate, pause after the last throw, and the camera's faults; progress is frames
    done, and frames in all.
    """
    target = Path(path)
    if target.exists():
        raise InvalidInputError(f"{target} exists already; expected a new folder for the bag")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InvalidInputError(f"cannot write {target}: {error.strerror}") from None
    try:
        bag = partial / target.name
        _write_frames(bag, truth, settings, rng, report_progress)
        truth.save(bag)
        bag.rename(target)
    except OSError as error:
        raise InvalidInputError(f"cannot write {target}: {error.strerror}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def reuse_or_render_bag(
    path: str | os.PathLike[str],
    settings: RenderSettings,
    report_progress: Callable[[int, int], None] = lambda done, total: None,
) -> GroundTruth:
    """Return the truth of the bag at `path` if rendering would make the same, else render.

    Another rendered bag is replaced; a folder that is not a rendered bag is an error.
    """
    target = Path(path)
    if target.exists():
        truth = GroundTruth.load(target)
        if _is_what_rendering_makes(truth, settings):
            return truth
        shutil.rmtree(target)
    return render_bag(target, settings, report_progress)


def _is_what_rendering_makes(truth: GroundTruth, settings: RenderSettings) -> bool:
    return (
        dict(truth.settings) == asdict(settings)
        and truth.camera.to_dict() == corner_camera().to_dict()
        and truth.environment.to_dict() == corner_environment().to_dict()
        and truth.static_parameters.to_dict() == true_parameters().to_dict()
    )


def _write_frames(
    bag: Path,
    truth: GroundTruth,
    settings: RenderSettings,
    rng: np.random.Generator,
    report_progress: Callable[[int, int], None],
) -> None:
    camera: Camera = truth.camera
    renderer = DepthRenderer(camera, truth.environment)
    sensor = NoisyDepthCamera(renderer.background, camera.focal_length, settings.noise, rng)
    end = max(throw.end_time for throw in truth.throws) + settings.pause
    frames = int(np.floor(end * settings.frame_rate)) + 1
    with DepthBagWriter(bag, camera) as writer:
        for frame in range(frames):
            time = frame / settings.frame_rate
            centers, radii = balls_at(truth.throws, time)
            rendered = renderer.render_balls(
                centers, radii, _sweeps(truth.throws, time, settings.exposure)
            )
            image = sensor.read(rendered.image, rendered.region)
            writer.write(truth.start_time + round(time * 1e9), image)
            report_progress(frame + 1, frames)


def _sweeps(throws: Sequence[Throw], time: float, exposure: float) -> list[NDArray[np.float64]]:
    """Ways (3,) m of the balls there are at a time, s, during an exposure, s."""
    there = [throw for throw in throws if throw.start_time <= time <= throw.end_time]
    ends = time + 0.5 * exposure * np.array([-1.0, 1.0])
    places = (
        throw.positions_at(np.clip(ends, throw.start_time, throw.end_time)) for throw in there
    )
    return [after - before for before, after in places]


def balls_at(throws: Sequence[Throw], time: float) -> tuple[list[NDArray[np.float64]], list[float]]:
    """Return centres, each (3,) m in the world, and radii of the balls there are at a time, s."""
    there = [throw for throw in throws if throw.start_time <= time <= throw.end_time]
    return (
        [throw.positions_at(np.array([time]))[0] for throw in there],
        [throw.radius for throw in there],
    )
