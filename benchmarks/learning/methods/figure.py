"""J against iterations for the nine rules, as the paper's Fig. 6, and against time for ours."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

from benchmarks.learning.methods.histories import Histories, Joint

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def draw_figure(histories: Histories, joint: Joint, path: Path) -> None:
    """Draw a column for each set: rules above, joint estimation below."""
    figure, axes = plt.subplots(
        2, len(histories), figsize=(4.2 * len(histories), 7.0), squeeze=False
    )
    for column, (name, rules) in enumerate(histories.items()):
        task, run = joint[name]
        above, below = axes[:, column]
        for rule, costs in rules.items():
            above.plot(np.arange(1, costs.size + 1), costs, label=rule, linewidth=1.2)
        above.plot(run.iterations, run.training, "k.-", label="levenberg_marquardt", linewidth=1.5)
        above.axhline(task.oracle[0], color="0.5", linestyle=":", label="true θ_s")
        above.set_xlim(0, max(costs.size for costs in rules.values()))
        above.set_title(name)
        above.set_xlabel("iterations (evaluations of J)")
        above.set_ylabel("J, training split (m)")
        below.plot(run.seconds, run.test / task.oracle[1], linewidth=1.2)
        below.axhspan(0.95, 1.05, color="0.9")
        below.axhline(1.0, color="0.5", linestyle=":")
        below.set_xlabel("seconds")
        below.set_ylabel("test J / true θ_s's, levenberg_marquardt")
    axes[0, -1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)
