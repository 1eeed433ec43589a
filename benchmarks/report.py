"""Turns what was measured into tables, and into the one line that machines read."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence

from benchmarks.accuracy import Accuracy
from benchmarks.agreement import EARLY, Agreement
from benchmarks.peers.ours import NAMES
from benchmarks.scaling import BATCHES, Scaled
from benchmarks.scenes import SCENES, SIMULATIONS, STEPS, TIME_STEP
from benchmarks.start_up import StartUp
from benchmarks.timing import Measured, ratio, typical_seconds

REFERENCE = "ODE"
NOTHING = "–"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table whose columns are aligned for reading as it is."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[c]) for row in cells) for c in range(len(header))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    rule = "|" + "|".join("-" * (w + 2) for w in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def own_engine(measured: Measured) -> str:
    """Return the engine of ours that `auto` picks for a scene: the first that simulates it."""
    return next(name for name in NAMES if name in measured.seconds)


def ratios(scenes: Mapping[str, Sequence[Measured]], reference: str) -> dict[str, float]:
    """Return by scene how many times faster ours is than a reference engine."""
    return {
        scene: ratio(measured, reference, own_engine(measured[0]))
        for scene, measured in scenes.items()
    }


def speed_text(scenes: Mapping[str, Sequence[Measured]], engines: Mapping[str, str]) -> str:
    """Describe wall times by engine (name: how it is set up) and scene."""
    rows = [
        [name, *(_speed_cell(measured, name) for measured in scenes.values())] for name in engines
    ]
    ratio_rows = [
        [f"ours against {name}", *(f"{r:.3g} ×" for r in ratios(scenes, name).values())]
        for name in engines
        if name.startswith(REFERENCE)
    ]
    ns = [["ours, ns a body-step", *(_body_step(scene, m) for scene, m in scenes.items())]]
    how = "\n".join(f"- {name}: {text}" for name, text in engines.items())
    return "\n\n".join(
        [
            f"## One prediction: {SIMULATIONS} simulations × {STEPS * TIME_STEP:g} s, "
            f"{STEPS} outputs, one thread",
            f"Median wall milliseconds (share of {REFERENCE}'s time).",
            table(["engine", *scenes], [*rows, *ratio_rows, *ns]),
            how,
        ]
    )


def agreement_text(
    rows: Iterable[tuple[str, str, Agreement, float]], convergence: Mapping[float, float]
) -> str:
    """Describe agreement.

    Parameters
    ----------
    rows : scene, engine, its agreement with ours, mean distance of its noisy copies in m
    convergence : m, mean distance of ODE from event_driven, by ODE's step in s
    """
    body = [
        [
            scene,
            engine,
            f"{100 * a.early:.1f}",
            f"{100 * a.late:.1f}",
            f"{100 * spread:.1f}",
            f"{a.most_energy:.3f}",
            f"{100 * a.deepest:.1f}",
        ]
        for scene, engine, a, spread in rows
    ]
    header = [
        "scene",
        "engine",
        f"cm from ours after {EARLY:g} s",
        "at the end",
        "spread of its noisy copies",
        "most energy / first",
        "cm into a wall or floor",
    ]
    return "\n\n".join(
        [
            "## The same physics?",
            "Means over the instances (largest for the last two columns). Bounces part what starts "
            "together: compare the end with the spread, not with zero.",
            table(header, body),
            "One sphere that nothing keeps from rolling: there both have the same laws, and ODE "
            "has to come to event_driven as its step shrinks.",
            table(
                ["ODE's step, ms", *(f"{1e3 * step:g}" for step in convergence)],
                [["mean distance, cm", *(f"{100 * d:.2f}" for d in convergence.values())]],
            ),
        ]
    )


def accuracy_text(found: Mapping[str, Accuracy], drops: int) -> str:
    """Describe errors against known laws, by engine."""
    rows = [
        [
            name,
            " / ".join(_percent(error, "+") for error in a.known_drop),
            f"{_percent(a.first_median)} / {_percent(a.first_p95)}",
            f"{_percent(a.drop_median)} / {_percent(a.drop_p95)}",
            _percent(a.rolling, "+"),
        ]
        for name, a in found.items()
    ]
    header = [
        "engine",
        "drop from 1 m, e = .7: first / second peak",
        f"{drops} random drops, first peak: median / 95 %",
        "worse of both peaks: median / 95 %",
        "slide → roll, against 5/7 v₀",
    ]
    return f"## Accuracy at a step of {1e3 * TIME_STEP:g} ms\n\n" + table(header, rows)


def batches_text(scaled: Sequence[Scaled]) -> str:
    """Describe batch sizes and threads."""
    rows = []
    for scene in SCENES:
        for engine in NAMES:
            own = [s for s in scaled if (s.scene, s.engine) == (scene, engine)]
            if own:
                single = {s.simulations: s for s in own if s.threads == 1}
                many = {s.threads: s for s in own if s.simulations == BATCHES[-1]}
                gain = many[1].seconds / many[2].seconds
                cells = [f"{1e3 * single[n].seconds:.3g}" for n in BATCHES]
                body = [f"{single[n].nanoseconds:.3g}" for n in BATCHES]
                rows.append([scene, engine, *cells, " / ".join(body), f"{gain:.2f}"])
    header = ["scene", "engine", *(f"{n} simulations, ms" for n in BATCHES)]
    header += ["ns a body-step", f"{BATCHES[-1]} on 2 threads: times faster"]
    return "## Batches and threads\n\n" + table(header, rows)


def objects_text(scaled: Sequence[Scaled]) -> str:
    """Describe numbers of objects: milliseconds by engine."""
    counts = sorted({s.objects for s in scaled})
    rows = []
    for scene, engine in dict.fromkeys((s.scene, s.engine) for s in scaled):
        times = {s.objects: s.seconds for s in scaled if (s.scene, s.engine) == (scene, engine)}
        cells = (f"{1e3 * times[n]:.3g}" if n in times else NOTHING for n in counts)
        rows.append([scene, engine, *cells])
    header = ["objects", "engine", *(f"{n}, ms" for n in counts)]
    return "## Objects in the room\n\n" + table(header, rows)


def start_up_text(found: StartUp) -> str:
    """Describe compiling and loading."""
    rows = [
        ["compile, empty cache", f"{found.compile_s:.2f}", f"{found.compile_process_s:.2f}"],
        ["load from the cache", f"{found.load_s:.2f}", f"{found.load_process_s:.2f}"],
    ]
    header = [
        "until every engine has answered",
        "s after NumPy and Numba are imported",
        "s of the whole process",
    ]
    return "## Kernels\n\n" + table(header, rows)


def json_line(
    scenes: Mapping[str, Sequence[Measured]], found: Mapping[str, Accuracy], kernels: StartUp
) -> str:
    """Return the last line."""
    return json.dumps(
        {
            "ratio_to_ode": {
                scene: round(value, 1) for scene, value in ratios(scenes, REFERENCE).items()
            },
            "peak_error_p95": {name: float(f"{found[name].drop_p95:.3g}") for name in NAMES},
            "compile_s": round(kernels.compile_s, 2),
            "load_s": round(kernels.load_s, 2),
        }
    )


def _speed_cell(measured: Sequence[Measured], name: str) -> str:
    if name not in measured[0].seconds:
        return NOTHING
    milliseconds = 1e3 * typical_seconds(measured, name)
    return f"{milliseconds:.3g} ({1.0 / ratio(measured, REFERENCE, name):.2g})"


def _body_step(scene: str, measured: Sequence[Measured]) -> str:
    body_steps = SIMULATIONS * STEPS * len(SCENES[scene])
    return f"{1e9 * typical_seconds(measured, own_engine(measured[0])) / body_steps:.3g}"


def _percent(value: float, sign: str = "") -> str:
    percent = 100.0 * value
    return f"{percent:{sign}.2g} %"
