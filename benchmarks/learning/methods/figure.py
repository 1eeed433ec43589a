"""J of joint estimation against time."""

from __future__ import annotations

from pathlib import Path

import matplotlib

from benchmarks.learning.methods.joint_run import Joint

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def draw_figure(joint: Joint, path: Path) -> None:
    """Draw J over the test split, a column for each set."""
    figure, columns = plt.subplots(1, len(joint), figsize=(4.2 * len(joint), 3.5), squeeze=False)
    for axes, (name, (task, run)) in zip(columns[0], joint.items(), strict=True):
        axes.plot(run.seconds, run.test / task.oracle[1], linewidth=1.2)
        axes.axhspan(0.95, 1.05, color="0.9")
        axes.axhline(1.0, color="0.5", linestyle=":")
        axes.set_title(name)
        axes.set_xlabel("seconds")
        axes.set_ylabel("test J / true θ_s's, levenberg_marquardt")
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)
