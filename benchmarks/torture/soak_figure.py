"""The memory of each node through the minutes of a soak, so that a slow leak is seen."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.torture.soak import Soak


def draw_memory(soak: Soak, path: Path) -> None:
    """Draw what each node has grown by since the second minute."""
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for name, node in soak.nodes.items():
        later = node.memory[1:]
        axes.plot(range(2, 2 + len(later)), [value - later[0] for value in later], ".-", label=name)
    axes.set_xlabel("minute")
    axes.set_ylabel("growth since the second minute (MB)")
    axes.legend()
    figure.savefig(path)
