"""`make bench-perception`: our perception on rendered bags with ground truth, beside others.

README.md in the folder above says what is measured and how.
"""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks.command import Outcome, measure_parts, run_benchmark
from benchmarks.perception.clutter import measure_moving
from benchmarks.perception.doorway import measure_doorway
from benchmarks.perception.end_to_end import measure_end_to_end
from benchmarks.perception.livox import measure_livox
from benchmarks.perception.looks import measure_looks
from benchmarks.perception.real import measure_real
from benchmarks.perception.recorded import measure_recorded
from benchmarks.perception.release import measure_release
from benchmarks.perception.rendered import measure_rendered
from benchmarks.perception.two_cameras import measure_two_cameras
from benchmarks.perception.unorganised import measure_unorganised
from intuitive_physics_perception.compile import warm_up

# Real depth frames and scans, beside the project
REAL_DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "real"

# Parts that `--only` may name
PARTS: dict[str, Callable[[argparse.Namespace], Outcome]] = {
    "rendered": lambda options: measure_rendered(options.quick),
    "unorganised": lambda options: measure_unorganised(options.quick),
    "end_to_end": lambda options: measure_end_to_end(options.quick),
    "real": lambda options: measure_real(options.scenes, options.clouds, options.quick),
    "moving": lambda options: measure_moving(options.scenes, options.quick),
    "release": lambda options: measure_release(options.quick),
    "doorway": lambda options: measure_doorway(options.quick),
    "two_cameras": lambda options: measure_two_cameras(options.quick),
    "livox": lambda options: measure_livox(options.quick),
    "looks": lambda options: measure_looks(options.quick),
    "recorded": lambda options: measure_recorded(options.recording, options.quick),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and print the line of JSON last."""
    return run_benchmark("perception", __doc__, run, arguments, _add_options, parts=[*PARTS])


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenes",
        type=Path,
        default=REAL_DATA / "scenes",
        metavar="FOLDER",
        help="depth frames without a ball (.npz: depth in mm, K); default %(default)s",
    )
    parser.add_argument(
        "--clouds",
        type=Path,
        default=REAL_DATA,
        metavar="FOLDER",
        help="LiDAR scans with one ball each (lidar_ball_*.npz: xyz in m); default %(default)s",
    )
    parser.add_argument(
        "--recording",
        type=Path,
        default=REAL_DATA / "recording",
        metavar="FOLDER",
        help="frames of a depth camera that moves, with its poses, as 7-Scenes has them "
        "(frame-*.depth.png in mm, frame-*.pose.txt, camera-intrinsics.txt); default %(default)s",
    )


def run(options: argparse.Namespace) -> Outcome:
    """Measure all parts, or those that were chosen."""
    warm_up()
    # As the node does once its kernels are loaded: else frames wait for these being looked through.
    gc.collect()
    gc.freeze()
    outcome = measure_parts({name: partial(PARTS[name], options) for name in options.only or PARTS})
    return replace(outcome, part="_".join(options.only or ()))


if __name__ == "__main__":
    sys.exit(main())
