"""What all figures share."""

from __future__ import annotations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from intuitive_physics_cli.report.figure_style import legend_below


@pytest.mark.parametrize("columns", [1, 2, 4])
@pytest.mark.parametrize("height", [2.0, 6.0])
def test_a_legend_below_overlaps_no_axes_and_is_whole(columns, height):
    figure = Figure(figsize=(5.0, height), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    grid = figure.subplots(2, 2)
    for axes in grid.flat:
        handles = [axes.plot([0, 1], [0, k], label=f"line {k}")[0] for k in range(4)]
        axes.set_xlabel("evaluations")
    legend_below(figure, handles, columns)
    canvas.draw()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.y0 >= 0.0
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.width
    for axes in grid.flat:
        assert axes.get_tightbbox().y0 >= box.y1 - 1.0
