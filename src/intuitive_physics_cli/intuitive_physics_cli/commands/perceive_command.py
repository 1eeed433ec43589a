"""`perceive`: say what perception sees in a bag or in one cloud."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import Environment
from intuitive_physics_cli.commands.observation_source import add_seed, checked_seed
from intuitive_physics_cli.terminal import ProgressBar, format_table

Z_UP = (0.0, 0.0, 1.0)
"""Up in the frame of a sensor that is not a camera's optical frame (REP 103)."""


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "perceive",
        help="show what is perceived in a bag or in a point cloud",
        description="Find planes, gravity and balls in a bag of ROS 2 or ROS 1 (depth images, raw "
        "or compressed, or clouds; the topic is guessed) or in an .npz file with a cloud `xyz`.",
    )
    parser.add_argument("path", type=Path, help="a bag, or an .npz file with the array xyz")
    parser.add_argument("--topic", help="of depth images or clouds, where the guess is wrong")
    parser.add_argument(
        "--rectified",
        action="store_true",
        help="depth images are without distortion already, as those on image_rect topics: the "
        "camera matrix is that of P in the camera info",
    )
    parser.add_argument(
        "--ball",
        action="append",
        default=[],
        metavar="MATERIAL=RADIUS",
        help="a ball that is known by its radius in m, such as wood=0.03; may be repeated",
    )
    parser.add_argument(
        "--up",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="roughly upward direction in the sensor's frame; without it the support of a bag is "
        "its largest plane, and that of a cloud the plane that faces up along z, if there is one",
    )
    parser.add_argument("--save", type=Path, metavar="FOLDER", help="save the observations here")
    parser.add_argument(
        "--rerun",
        type=Path,
        metavar="FILE",
        help="write clouds, planes, gravity and balls of a bag as a Rerun recording (.rrd)",
    )
    add_seed(parser, "of random choices")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Perceive and print."""
    if not options.path.exists():
        raise InvalidInputError(
            f"there is no {options.path}; expected a bag or an .npz file with the array xyz"
        )
    if options.path.suffix == ".npz":
        _perceive_cloud(options)
    else:
        _perceive_bag(options)


def _settings(options: argparse.Namespace, up: Sequence[float] | None) -> Any:
    from intuitive_physics_perception.settings import KnownObject, PerceptionSettings

    objects = []
    for text in options.ball:
        material, _, radius = text.partition("=")
        try:
            objects.append(KnownObject(material, float(radius), material))
        except ValueError:
            raise InvalidInputError(
                f"--ball is {text!r}; expected MATERIAL=RADIUS with the radius in m, "
                "such as wood=0.03"
            ) from None
    return PerceptionSettings(
        known_objects=tuple(objects), up_hint=None if up is None else (up[0], up[1], up[2])
    )


def _perceive_cloud(options: argparse.Namespace) -> None:
    from intuitive_physics_recordings.npz_file import load_cloud

    if options.rerun:
        raise InvalidInputError("one cloud has nothing to play; expected --rerun with a bag")
    if options.save:
        raise InvalidInputError("one cloud has no motion to save; expected --save with a bag")
    points = load_cloud(options.path)
    environment, spheres = _environment_and_spheres(points, options)
    print(f"{options.path}: a cloud of {len(points)} points\n")
    _print_environment(environment)
    print(f"\nballs: {len(spheres)}")
    if spheres:
        rows = [
            [
                _vector(sphere.center),
                f"{sphere.radius:.3f} ± {np.sqrt(sphere.covariance[3, 3]):.3f}",
                f"{sphere.range:.2f}",
                str(sphere.points),
            ]
            for sphere in spheres
        ]
        print(format_table(["centre (m)", "radius (m)", "range (m)", "points"], rows))


def _environment_and_spheres(points: Any, options: argparse.Namespace) -> tuple[Any, Any]:
    from intuitive_physics_perception.environment.environment_model import NoEnvironmentError
    from intuitive_physics_perception.scene import perceive_cloud

    seed = checked_seed(options)

    def perceive(up: Sequence[float] | None) -> tuple[Any, Any]:
        return perceive_cloud(points, _settings(options, up), np.random.default_rng(seed))

    if options.up is not None:
        return perceive(options.up)
    try:
        # REP 103: z is up in the frame of a sensor that is not a camera's optical frame.
        return perceive(Z_UP)
    except NoEnvironmentError:
        return perceive(None)


def _perceive_bag(options: argparse.Namespace) -> None:
    from intuitive_physics_cli.evaluation.recording_perception import perceive_recording

    with ExitStack() as stack:
        bar = stack.enter_context(ProgressBar("perceiving"))
        recording = perceive_recording(
            options.path,
            _settings(options, options.up),
            np.random.default_rng(checked_seed(options)),
            topic=options.topic,
            rectified=options.rectified,
            on_progress=bar.update,
            **_rerun_hook(options.rerun, stack),
        )
    source = recording.source
    print(
        f"{options.path}: {source.frames} frames of {source.topic} in {recording.duration:.1f} s, "
        f"a ball in {recording.frames_with_spheres} of them\n"
    )
    for problem, count in recording.problems.most_common():
        print(f"{count} frames could not be used: {problem}")
    if recording.model is None:
        raise InvalidInputError(
            f"no environment was found in {options.path}; "
            "expected frames that show a floor or table"
        )
    _print_environment(recording.model.environment)
    _print_observations(recording.observations)
    if options.save:
        _save(recording.observations, options.save)


def _rerun_hook(path: Path | None, stack: ExitStack) -> dict[str, Any]:
    if path is None:
        return {}
    from intuitive_physics_cli.report.rerun_recording import RerunRecording

    return {"on_frame": stack.enter_context(RerunRecording(path)).perceived}


def _print_environment(environment: Environment) -> None:
    print(f"planes: {len(environment.planes)}, in a frame with z up on the first of them")
    rows = [[p.id, _vector(p.normal), f"{p.offset:.3f}"] for p in environment.planes]
    print(format_table(["plane", "normal", "offset (m)"], rows))
    print(f"gravity: {_vector(environment.gravity)} m/s²")


def _print_observations(observations: Any) -> None:
    print(f"\nobservations: {len(observations)}")
    if not observations:
        return
    first = observations[0].start_time
    rows = [
        [
            item.object.id,
            item.object.material,
            f"{item.object.shape.bounding_radius:.3f}",
            f"{observation.start_time - first:.2f}",
            f"{item.trajectory.duration:.2f}",
            str(len(item.trajectory)),
            f"{np.linalg.norm(item.initial_state.linear_velocity):.2f}",
        ]
        for observation in observations
        for item in observation.objects
    ]
    header = ["object", "material", "radius (m)", "start (s)", "time (s)", "points", "speed (m/s)"]
    print(format_table(header, rows))


def _save(observations: Any, folder: Path) -> None:
    from intuitive_physics_recordings.observation_files import save_observations

    save_observations(observations, folder)
    print(f"\nsaved {len(observations)} observations in {folder}")


def _vector(values: Any) -> str:
    # Adding zero turns a rounded -0.0 into 0.0.
    return "(" + ", ".join(f"{round(float(value), 3) + 0.0:.3f}" for value in values) + ")"
