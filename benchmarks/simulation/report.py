"""Tables of the simulation benchmark, and its key figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.peers.ode import Ode
from benchmarks.peers.ours import NAMES
from benchmarks.results.result import Cell, Column, Table
from benchmarks.scenes import SCENES, SIMULATIONS, STEPS, TIME_STEP
from benchmarks.simulation.accuracy import Accuracy
from benchmarks.simulation.agreement import EARLY, Agreement
from benchmarks.simulation.billiards import STEPS as BREAK_STEPS
from benchmarks.simulation.billiards import Breaks
from benchmarks.simulation.random_scenes import Kept
from benchmarks.simulation.scaling import BATCHES, Scaled
from benchmarks.simulation.start_up import StartUp
from benchmarks.timing import Measured, best_peer, own_engine, ratio, typical_seconds

REFERENCE = "ODE"  # engine that the others are compared with: the paper's
SLEEPING = Ode(auto_disable=True).name  # the same, whose bodies at rest sleep


def _ratios(scenes: Mapping[str, Sequence[Measured]], reference: str) -> dict[str, float]:
    """Return by scene how many times faster ours is than a reference engine."""
    return {
        scene: ratio(measured, reference, own_engine(measured[0]))
        for scene, measured in scenes.items()
    }


def _ratios_to_best(scenes: Mapping[str, Sequence[Measured]]) -> dict[str, tuple[float, str]]:
    """Return by scene how many times faster ours is than the fastest peer, and its name."""
    found = {}
    for scene, measured in scenes.items():
        best = best_peer(measured)
        found[scene] = ratio(measured, best, own_engine(measured[0])), best
    return found


def speed_table(
    scenes: Mapping[str, Sequence[Measured]],
    engines: Mapping[str, str],
    left_out: Sequence[str] = (),
) -> Table:
    """Return wall times by engine (name: how it is set up) and scene, and what was left out."""
    rows: list[list[Cell]] = [
        [name, *(_speed_cell(measured, name) for measured in scenes.values())] for name in engines
    ]
    rows += [
        [f"ours against {name}", *(f"{r:.3g} ×" for r in _ratios(scenes, name).values())]
        for name in engines
        if name.startswith(REFERENCE)
    ]
    rows += [
        [
            "ours against the fastest peer",
            *(f"{times:.3g} × ({name})" for times, name in _ratios_to_best(scenes).values()),
        ],
        ["ours, ns a body-step", *(_body_step(measured) for measured in scenes.values())],
    ]
    return Table(
        title=f"One prediction: {SIMULATIONS} simulations × {STEPS * TIME_STEP:g} s, "
        f"{STEPS} outputs, one thread",
        note=f"Median wall milliseconds (share of {REFERENCE}'s time).",
        columns=[Column("engine"), *(Column(scene) for scene in scenes)],
        rows=rows,
        remarks=[*(f"{name}: {text}" for name, text in engines.items()), *left_out],
    )


def agreement_table(rows: Iterable[Agreement]) -> Table:
    """Return how far the engines are apart."""
    return Table.of(
        "The same physics?",
        rows,
        [
            (Column("scene"), lambda a: a.scene),
            (Column("engine"), lambda a: a.engine),
            (Column(f"cm from ours after {EARLY:g} s", "cm", ".1f"), lambda a: 100 * a.early),
            (Column("at the end", "cm", ".1f"), lambda a: 100 * a.late),
            (Column("spread of its noisy copies", "cm", ".1f"), lambda a: 100 * a.spread),
            (Column("most energy / first", "", ".3f"), lambda a: a.most_energy),
            (Column("cm into a wall or floor", "cm", ".1f"), lambda a: 100 * a.deepest),
        ],
        note="Means over the instances (largest for the last two columns). Bounces part what "
        "starts together: compare the end with the spread, not with zero.",
    )


def convergence_table(distances: Mapping[float, float]) -> Table:
    """Return the mean distance in m of ODE from `event_driven`, by ODE's step in s."""
    return Table(
        title="ODE comes to event_driven as its step shrinks",
        note="One sphere that nothing keeps from rolling: there both have the same laws, and ODE "
        "has to come to event_driven as its step shrinks.",
        columns=[
            Column("ODE's step, ms"),
            *(Column(f"{1e3 * step:g}", "cm", ".2f") for step in distances),
        ],
        rows=[["mean distance, cm", *(100 * distance for distance in distances.values())]],
    )


def accuracy_table(accuracies: Mapping[str, Accuracy], drops: int) -> Table:
    """Return errors against known laws, by engine."""

    def pair(first: float, second: float, sign: str = "") -> str:
        return f"{_percent(first, sign)} / {_percent(second, sign)}"

    return Table.of(
        f"Accuracy at a step of {1e3 * TIME_STEP:g} ms",
        accuracies.items(),
        [
            (Column("engine"), lambda row: row[0]),
            (
                Column("drop from 1 m, e = .7: first / second peak"),
                lambda row: pair(*row[1].known_drop, "+"),
            ),
            (
                Column(f"{drops} random drops, first peak: median / 95 %"),
                lambda row: pair(row[1].first_median, row[1].first_p95),
            ),
            (
                Column("worse of both peaks: median / 95 %"),
                lambda row: pair(row[1].drop_median, row[1].drop_p95),
            ),
            (Column("slide → roll, against 5/7 v₀"), lambda row: _percent(row[1].rolling, "+")),
        ],
    )


def batches_table(scaled: Sequence[Scaled]) -> Table:
    """Return times by batch sizes and threads."""
    rows: list[list[Cell]] = []
    for scene in SCENES:
        for engine in NAMES:
            sizes = [s for s in scaled if (s.scene, s.engine) == (scene, engine)]
            if sizes:
                single = {s.simulations: s for s in sizes if s.threads == 1}
                many = {s.threads: s for s in sizes if s.simulations == BATCHES[-1]}
                cells = [1e3 * single[n].seconds for n in BATCHES]
                body = " / ".join(f"{single[n].nanoseconds:.3g}" for n in BATCHES)
                rows.append([scene, engine, *cells, body, many[1].seconds / many[2].seconds])
    return Table(
        title="Batches and threads",
        columns=[
            Column("scene"),
            Column("engine"),
            *(Column(f"{n} simulations, ms", "ms", ".3g") for n in BATCHES),
            Column("ns a body-step", "ns"),
            Column(f"{BATCHES[-1]} on 2 threads: times faster", "", ".2f"),
        ],
        rows=rows,
    )


def objects_table(scaled: Sequence[Scaled]) -> Table:
    """Return times by number of objects and engine."""
    counts = sorted({s.objects for s in scaled})
    rows: list[list[Cell]] = []
    for scene, engine in dict.fromkeys((s.scene, s.engine) for s in scaled):
        times = {s.objects: s.seconds for s in scaled if (s.scene, s.engine) == (scene, engine)}
        rows.append([scene, engine, *(1e3 * times[n] if n in times else None for n in counts)])
    return Table(
        title="Objects in the room",
        columns=[
            Column("objects"),
            Column("engine"),
            *(Column(f"{n}, ms", "ms", ".3g") for n in counts),
        ],
        rows=rows,
    )


def breaks_table(breaks: Breaks) -> Table:
    """Return times of a billiard break."""
    theirs = (
        f"pooltool {breaks.version}: balls stay on the cloth, spin about the vertical is slowed, a "
        "cushion is a rail that is met above a ball's middle; the answer is a list of events, "
        f"here {breaks.events:.0f}"
    )
    return Table(
        title="A billiard break: 16 balls, until all rest",
        note=f"Median wall milliseconds of {breaks.count} breaks, on one thread, with the same "
        "places, speed and coefficients.",
        columns=[Column("engine"), Column("ms", "ms", ".3g")],
        rows=[[name, 1e3 * seconds] for name, seconds in breaks.seconds.items()],
        remarks=[
            "ours: the cushions are planes, balls have three dimensions and may hop, and positions "
            f"are answered at {BREAK_STEPS} times",
            f"left out: {breaks.left_out}" if breaks.left_out else theirs,
        ],
    )


def kept_table(rows: Sequence[Kept]) -> Table:
    """Return how well our engines keep the laws in random scenes."""
    return Table.of(
        "Random scenes",
        rows,
        [
            (Column("engine"), lambda kept: kept.engine),
            (Column("scenes"), lambda kept: kept.scenes),
            (Column("stopped"), lambda kept: kept.stopped),
            (Column("largest gain of energy", "", ".2g"), lambda kept: kept.gain.value),
            (Column("in scene"), lambda kept: kept.gain.scene),
            (Column("scenes with dense outputs"), lambda kept: kept.dense_scenes),
            (Column("mm into a plane", "mm", ".3g"), lambda kept: 1e3 * kept.in_planes.value),
            (Column("in scene"), lambda kept: kept.in_planes.scene),
            (Column("mm into an object", "mm", ".3g"), lambda kept: 1e3 * kept.in_objects.value),
            (Column("in scene"), lambda kept: kept.in_objects.scene),
            (Column("missed contacts"), lambda kept: kept.missed),
        ],
        note="One to six spheres, boxes and capsules in a small room, all coefficients at random. "
        "The gain is a part of the energy that was there. Stopped are scenes whose status is not "
        "OK; they count until there.",
        remarks=["`random_scene` of `simulation/random_scenes.py` makes the scene of a number"],
    )


def start_up_table(kernels: StartUp) -> Table:
    """Return times of compiling and loading."""
    return Table(
        title="Kernels",
        columns=[
            Column("until every engine has answered"),
            Column("s after NumPy and Numba are imported", "s", ".2f"),
            Column("s of the whole process", "s", ".2f"),
        ],
        rows=[
            ["compile, empty cache", kernels.compile_s, kernels.compile_process_s],
            ["load from the cache", kernels.load_s, kernels.load_process_s],
        ],
    )


def key_figures(
    scenes: Mapping[str, Sequence[Measured]],
    accuracies: Mapping[str, Accuracy],
    kernels: StartUp,
    breaks: Breaks,
    kept: Sequence[Kept],
) -> dict[str, Any]:
    """Return what the last line says."""

    def rounded(ratios: Mapping[str, float]) -> dict[str, float]:
        return {scene: round(value, 1) for scene, value in ratios.items()}

    best = {scene: times for scene, (times, _) in _ratios_to_best(scenes).items()}
    return {
        "ratio_to_ode": rounded(_ratios(scenes, REFERENCE)),
        "ratio_to_ode_sleeping": rounded(_ratios(scenes, SLEEPING)),
        "ratio_to_best_peer": rounded(best),
        "break_ms": {name: float(f"{1e3 * s:.3g}") for name, s in breaks.seconds.items()},
        "worst_energy_gain": float(f"{max(k.gain.value for k in kept):.2g}"),
        "deepest_overlap_mm": float(f"{1e3 * max(k.deepest for k in kept):.3g}"),
        "missed_contacts": sum(k.missed for k in kept),
        "peak_error_p95": {name: float(f"{accuracies[name].drop_p95:.3g}") for name in NAMES},
        "compile_s": round(kernels.compile_s, 2),
        "load_s": round(kernels.load_s, 2),
    }


def _speed_cell(measured: Sequence[Measured], name: str) -> str | None:
    if name not in measured[0].seconds:
        return None
    milliseconds = 1e3 * typical_seconds(measured, name)
    return f"{milliseconds:.3g} ({1.0 / ratio(measured, REFERENCE, name):.2g})"


def _body_step(measured: Sequence[Measured]) -> str:
    own = own_engine(measured[0])
    simulations, objects, steps, _ = measured[0].positions[own].shape
    return f"{1e9 * typical_seconds(measured, own) / (simulations * objects * steps):.3g}"


def _percent(value: float, sign: str = "") -> str:
    percent = 100.0 * value
    return f"{percent:{sign}.2g} %"
