"""The figure of the simulation page: what two engines do against the closed forms of two laws.

    .venv/bin/python tools/simulation_figure.py

writes docs/method/contacts.svg.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState

FIGURE = Path(__file__).resolve().parent.parent / "docs" / "method" / "contacts.svg"
RADIUS, HEIGHT, RESTITUTION = 0.05, 1.0, 0.8
SPEED, FRICTION, RESISTANCE = 2.0, 0.3, 0.02
G = 9.81
ENGINES = (("event_driven", "#2563eb", 600), ("stepped", "#d97706", 45))
"""Name, colour, and at how many times each is shown."""


def main() -> None:
    """Draw both laws side by side."""
    plt.rcParams.update({"font.size": 10, "svg.hashsalt": "contacts", "svg.fonttype": "none"})
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
    draw_bounces(left)
    draw_rolling(right)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("time (s)")
        axes.legend(frameon=False, fontsize=9)
    figure.savefig(FIGURE, metadata={"Date": None})


def draw_bounces(axes: Axes) -> None:
    """A ball that falls from 1 m: the peak after bounce k is e²ᵏ times as high."""
    state = ObjectState(position=(0.0, 0.0, HEIGHT + RADIUS))
    for name, color, count in ENGINES:
        times = np.linspace(0.0, 3.5, count)
        heights = path(name, state, times)[:, 2] - RADIUS
        axes.plot(times, heights, **style(name, color))
    fall = np.sqrt(2.0 * HEIGHT / G)
    bounces = np.arange(1, 5)
    flights = 2.0 * fall * RESTITUTION**bounces
    peaks = fall + np.cumsum(flights) - 0.5 * flights
    axes.plot(peaks, HEIGHT * RESTITUTION ** (2 * bounces), "k_", markersize=14, label="e²ᵏ h")
    axes.set_ylabel("height of the lowest point (m)")
    axes.set_title(f"restitution, e = {RESTITUTION:g}", loc="left", fontsize=10)


def draw_rolling(axes: Axes) -> None:
    """A ball that slides, then rolls: from 5/7 of its speed on, against rolling resistance."""
    state = ObjectState(position=(0.0, 0.0, RADIUS), linear_velocity=(SPEED, 0.0, 0.0))
    for name, color, count in ENGINES:
        times = np.linspace(0.0, 2.0, count)
        step = 1e-4
        ahead = path(name, state, times + step)[:, 0] - path(name, state, times)[:, 0]
        axes.plot(times, ahead / step, **style(name, color))
    rolls = 2.0 * SPEED / (7.0 * FRICTION * G)
    axes.plot([0.0, 2.0], [5.0 / 7.0 * SPEED] * 2, "k:", linewidth=1, label="5/7 v₀")
    axes.axvline(rolls, color="k", linewidth=0.6, linestyle="--", label="2/7 v₀ / μ_d g")
    axes.set_ylim(0.0, 1.05 * SPEED)
    axes.set_ylabel("speed (m/s)")
    title = f"sliding, μ_d = {FRICTION:g}, then rolling, μ_r = {RESISTANCE:g}"
    axes.set_title(title, loc="left", fontsize=10)


def path(engine: str, state: ObjectState, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (n_times, 3) m of a ball on a floor at times (n_times,) s."""
    floor = Environment([Plane("floor", "floor", normal=(0, 0, 1), offset=0.0)])
    scene = Scene(floor, (SceneObject("ball", "ball", Sphere(RADIUS)),), (state,))
    parameters = StaticParameters.uniform(
        ["ball", "floor"],
        static_friction=FRICTION,
        dynamic_friction=FRICTION,
        rolling_friction=RESISTANCE,
        restitution=RESTITUTION,
    )
    return make_simulator(engine).rollout([scene], parameters, times).positions[0, 0]


def style(engine: str, color: str) -> dict[str, Any]:
    """Return a line for the exact engine, points for the other one."""
    if engine == "event_driven":
        return {"color": color, "linewidth": 1.5, "label": engine}
    return {"color": color, "linestyle": "", "marker": "o", "markersize": 3.5, "label": engine}


if __name__ == "__main__":
    main()
