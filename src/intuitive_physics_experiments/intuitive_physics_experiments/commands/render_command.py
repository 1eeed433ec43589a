"""`render`: make a synthetic RGBD recording."""

from __future__ import annotations

import argparse
from typing import Any


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "render",
        help="render a bag of balls thrown into a corner, with its ground truth",
        description="Render a rosbag2 recording (MCAP) of a depth camera that sees foam, rubber "
        "and wooden balls of 7, 5 and 3 cm radius thrown into a corner. The ground truth is "
        "stored beside it.",
    )
    parser.add_argument("output", help="folder of the bag; it must not exist")
    parser.add_argument("--throws", type=int, default=12, help="number of throws (default: 12)")
    parser.add_argument("--seed", type=int, default=0, help="of throws and noise (default: 0)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Render and say what was made."""
    from intuitive_physics_cli.terminal import ProgressBar
    from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag

    settings = RenderSettings(throws=options.throws, seed=options.seed)
    with ProgressBar("rendering") as bar:
        truth = render_bag(options.output, settings, bar.update)
    count, end = len(truth.throws), truth.throws[-1].end_time + settings.pause
    plural = "" if count == 1 else "s"
    print(f"{options.output}: {count} throw{plural}, {end:.1f} s at {settings.frame_rate:g} Hz")
