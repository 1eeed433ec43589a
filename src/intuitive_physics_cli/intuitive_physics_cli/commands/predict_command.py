"""`predict`: predict an observation from its initial state, and compare with what happened."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from intuitive_physics.observation import load_observation
from intuitive_physics_cli.commands.observation_source import add_seed, checked_seed
from intuitive_physics_cli.terminal import format_table


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "predict",
        help="predict a saved observation with learned parameters",
        description="Simulate many times from noisy copies of an observation's initial state and "
        "compare the distribution with what was observed.",
    )
    parser.add_argument("observation", type=Path, help="file of a saved observation")
    parser.add_argument("parameters", type=Path, help="file that `learn` or `calibrate` wrote")
    parser.add_argument("--samples", type=int, default=20, help="simulations (default: 20)")
    add_seed(parser, "of the noise")
    parser.add_argument(
        "--restitution-noise",
        type=float,
        default=0.0,
        help="standard deviation of the restitution from one impact to the next (default: 0)",
    )
    parser.add_argument(
        "--tilt-noise",
        type=float,
        default=0.0,
        help="standard deviation of a surface's normal at an impact, rad (default: 0)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Predict and print a table over time."""
    from intuitive_physics.simulation.contact_noise import ContactNoise
    from intuitive_physics_predictor.noisy_newton import predict

    seed = checked_seed(options)
    contact_noise = ContactNoise(options.restitution_noise, options.tilt_noise)
    observation = load_observation(options.observation)
    learned, scales = _read_parameters(options.parameters)
    parameters = scales.parameters(learned, observation.materials)
    for number, item in enumerate(observation.objects):
        after = item.trajectory.times > observation.start_time
        times = item.trajectory.times[after] - observation.start_time
        distribution = predict(
            observation.scene(),
            parameters,
            times,
            rng=np.random.default_rng(seed),
            sample_count=options.samples,
            noise=scales.state_noise(),
            size_noise=scales.size,
            contact_noise=contact_noise,
        )
        mean = distribution.mean[number]
        spread = np.sqrt(np.trace(distribution.covariance[number], axis1=1, axis2=2))
        error = np.linalg.norm(mean - item.trajectory.positions[after], axis=1)
        shown = np.unique(np.linspace(0, len(times) - 1, 12).round().astype(int))
        rows = [
            [f"{times[k]:.2f}", *(f"{x:.3f}" for x in (*mean[k], spread[k], error[k]))]
            for k in shown
        ]
        print(f"{item.object.id} ({item.object.material}), {options.samples} samples")
        print(
            format_table(["time (s)", "x (m)", "y (m)", "z (m)", "spread (m)", "error (m)"], rows)
        )
        print(f"mean error {error.mean():.4f} m, mean spread {spread.mean():.4f} m")


def _read_parameters(path: Path) -> tuple[Any, Any]:
    """Return θ_s and the noise scales beside it, the default ones where there are none."""
    from intuitive_physics.learned_parameters import LearnedParameters
    from intuitive_physics_predictor.noise_scales import SCALES_KEY, NoiseScales
    from intuitive_physics_recordings.parameter_files import read_parameter_file

    data = read_parameter_file(path)
    learned = LearnedParameters.from_dict(data)
    scales = data.get(SCALES_KEY)
    return learned, NoiseScales() if scales is None else NoiseScales.from_dict(scales)
