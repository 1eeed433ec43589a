"""The tables of results, from the files that the runs wrote; `--write` updates them.

The README answers six questions of a newcomer with one number each; the results page has the
figures that need more words. Every figure, and its command, is read from what that run wrote.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import statistics
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
RESULTS_PAGE = ROOT / "docs" / "results" / "index.md"
BEGIN, END = "<!-- results: begin -->\n", "<!-- results: end -->\n"


class Row(NamedTuple):
    """A row of a table, in Markdown."""

    subject: str
    result: str
    comparison: str
    denominator: str
    command: str


ANSWERS = Row("question", "answer", "to compare with", "of", "command")
FIGURES = Row("what", "result", "to compare with", "of", "command")


def main() -> int:
    """Print the tables, or write them into their pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write them into their pages")
    write = parser.parse_args().write
    for page, table in tables().items():
        if write:
            text = page.read_text(encoding="utf-8")
            page.write_text(updated(text, table), encoding="utf-8")
        else:
            print(table)
    return 0


def updated(text: str, table: str) -> str:
    """Return the text of a page with a table in place of the one that it has."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}{table}{END}{after}"


def tables() -> dict[Path, str]:
    """Return the table of each page as Markdown, its links relative to the page."""
    answers = [
        position_in_a_second(),
        delay(),
        throws_to_learn(),
        regions(),
        speed(),
        cube_tosses(),
    ]
    figures = [
        initial_states(),
        thrown_balls(),
        update_rules(),
        excess(),
        perception(),
        camera_predictions(),
        prediction_node(),
        simulation(),
    ]
    page = (
        markdown_table(FIGURES, figures)
        .replace("](docs/results/", "](")
        .replace("](docs/", "](../")
    )
    return {README: markdown_table(ANSWERS, answers), RESULTS_PAGE: page}


def markdown_table(titles: Row, rows: list[Row]) -> str:
    lines = [titles, ("---",) * len(titles), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def position_in_a_second() -> Row:
    rows = markdown_rows("benchmarks/results/prediction_camera.md", "Thrown balls")
    (row,) = (
        row for row in rows if (row["spins, rad/s"], row["begins"]) == ("10", "after first bounce")
    )
    return Row(
        "Where will a ball be in a second? Median error once it has bounced, spins of 10 rad/s",
        f"{float(row['error, mm']):.0f} mm",
        f"spin guessed, not estimated: {float(row['guess']):.0f} mm",
        f"[{row['predictions']} rendered throws](docs/benchmarks.md)",
        command_of("benchmarks/results/prediction_camera.json"),
    )


def delay() -> Row:
    rows = markdown_rows("benchmarks/results/robot.md", "From the stamp")
    (row,) = (row for row in rows if row["received"] == "distribution")
    others = markdown_rows("benchmarks/results/perception.md", "Others")
    (peer,) = (row for row in others if row[""] == "Open3D + pyRANSAC-3D")
    return Row(
        "How soon is it known? Median from a depth image to the predicted distribution",
        f"{float(row['median']):.0f} ms",
        f"Open3D + pyRANSAC-3D, only to find the ball: {float(peer['ms a frame']):.0f} ms",
        f"[{row['images']} images](docs/benchmarks.md)",
        command_of("benchmarks/results/robot.json"),
    )


def throws_to_learn() -> Row:
    rows = markdown_rows("benchmarks/results/learning.md", "Throws until")
    suggested, random = (
        statistics.mean(int(row[f"{kind} throws"].partition(",")[0]) for row in rows)
        for kind in ("suggested", "random")
    )
    return Row(
        "How many throws teach a floor? Until friction and restitution are known to 3 % of their "
        "bounds, throws as the learner suggests",
        f"{suggested:.1f}",
        f"random throws: more than {int(random)}; defaults: never",
        f"[{len(rows)} rooms](docs/benchmarks.md)",
        command_of("benchmarks/results/learning.json"),
    )


def regions() -> Row:
    rows = table_file("docs/results/calibration/scores.csv")
    at = {row["prediction"]: row for row in rows if row["horizon"] == "2"}
    ours, fixed = at["noisy Newton"], at["fixed noise"]
    return Row(
        "How often is it right? Object inside the predicted 90 % region, 2 s ahead",
        f"{100 * float(ours['coverage_90']):.0f} %",
        f"the paper's fixed noise: {100 * float(fixed['coverage_90']):.0f} %",
        f"[{ours['trajectories']} trajectories](docs/results/calibration/README.md)",
        command_of("docs/results/calibration/README.md"),
    )


def speed() -> Row:
    ours, sleeping = simulation_rows()
    ratio, ratio_to_sleeping = (
        float(row["1_sphere"].removesuffix("×")) for row in (ours, sleeping)
    )
    return Row(
        "How much faster than ODE, the paper's engine, is a ball simulated?",
        f"{ratio:.0f} ×",
        f"ODE with sleeping bodies: {ratio / ratio_to_sleeping:.1f} ×",
        "[8 instances](docs/benchmarks.md)",
        command_of("benchmarks/results/simulation.json"),
    )


def cube_tosses() -> Row:
    rows = {row["prediction"]: row for row in table_file("docs/results/cube_tosses/errors.csv")}
    fitted, default = (
        f"{100 * float(row['position_test']):.1f} %"
        for row in (rows["stepped, fitted"], rows["stepped, default parameters"])
    )
    return Row(
        "And on real recordings? Mean position error of tossed cubes, of their width",
        fitted,
        f"default parameters: {default}",
        f"[{rows['stepped, fitted']['test']} tosses](docs/results/cube_tosses/README.md)",
        command_of("docs/results/cube_tosses/README.md"),
    )


def initial_states() -> Row:
    rows = table_file("docs/results/learning_curve/summary.csv")
    by_kind = [
        [row for row in rows if row["first_states"] == kind] for kind in ("three_points", "flight")
    ]
    learned, true, default = (
        ", ".join(
            f"{sum(float(row[f'{name}_test']) for row in own) / len(own):.3f}" for own in by_kind
        )
        for name in ("learned", "oracle", "default")
    )
    sets = sum(int(row["repetitions"]) for row in by_kind[0])
    return Row(
        "J over 5 s on throws not learned from; paper's set, initial states from three points as "
        "there, from all points before the first bounce",
        f"{learned} m",
        f"default {default} m, true {true} m",
        f"[{sets} sets](docs/results/learning_curve/README.md)",
        command_of("docs/results/learning_curve/README.md"),
    )


def thrown_balls() -> Row:
    rows = table_file("docs/results/rgbd/errors_by_size.csv")
    found = {row["ball"]: row for row in rows}
    millimetres = {
        name: ", ".join(
            f"{1e3 * float(found[ball][name]):.1f}" for ball in ("wood", "rubber", "foam")
        )
        for name in ("test", "default", "true_parameters")
    }
    return Row(
        "J of rendered throws through the whole pipeline, not learned from; balls of 3, 5, 7 cm",
        f"{millimetres['test']} mm",
        f"default {millimetres['default']} mm, true {millimetres['true_parameters']} mm",
        f"[{rows[0]['observations']} throws of each ball](docs/results/rgbd/README.md)",
        command_of("docs/results/rgbd/README.md"),
    )


def update_rules() -> Row:
    rows = {
        row["method"]: row
        for row in table_file("docs/results/search_methods/final.csv")
        if (row["objects"], row["samples"]) == ("10", "50")
    }
    best = rows["cma_es"]
    return Row(
        f"J after 500 evaluations of CMA-ES, {best['parameters']} parameters",
        f"{float(best['J']):.3f} m",
        f"default {float(best['default']):.3f} m, true {float(best['oracle']):.3f} m",
        "[10 runs](docs/results/search_methods/README.md)",
        command_of("docs/results/search_methods/README.md"),
    )


def excess() -> Row:
    by_set = learned_sets()
    shown, counts = [], []
    for rows in by_set.values():
        excesses = sorted(_excess(row) for row in rows)
        worst = f" ({excesses[-1]:.2f})" if len(rows) > 1 else ""
        shown.append(f"{statistics.median(excesses):.2f}{worst}")
        counts.append(str(len(rows)))
    everything = [row for rows in by_set.values() for row in rows]
    near, default = (
        sum(float(row[f"{name} / oracle's"]) <= 1.05 for row in everything)
        for name in ("test J", "defaults' J")
    )
    return Row(
        "part of the default's excess of J over the true parameters' that learning leaves, from "
        f"true initial states, throws not learned from; {', '.join(by_set)}: median (worst)",
        ", ".join(shown),
        f"default 1, true 0; J from observed initial states within 5 % of the true parameters': "
        f"learned {near} of {len(everything)}, untouched default {default} of {len(everything)}",
        f"[{len(everything)} sets: {', '.join(counts)}](docs/benchmarks.md)",
        command_of("benchmarks/results/learning.json"),
    )


def learned_sets() -> dict[str, list[dict[str, str]]]:
    """Return what was learned from each set, by the name of its size."""
    by_set: dict[str, list[dict[str, str]]] = {}
    for row in markdown_rows("benchmarks/results/learning.md", "Joint estimation"):
        by_set.setdefault(row["set"], []).append(row)
    return by_set


def _excess(row: dict[str, str]) -> float:
    learned, oracle, default = (
        float(row[name]) for name in ("J from true initial states: learned", "oracle", "defaults")
    )
    return (learned - oracle) / (default - oracle)


def perception() -> Row:
    rows = {row[""]: row for row in markdown_rows("benchmarks/results/perception.md", "Others")}
    ours, other = rows["ours"], rows["Open3D + pyRANSAC-3D"]
    position, took = "position up to 2 m", "ms a frame"
    return Row(
        "position of a ball in one depth frame up to 2 m, RMS; ms a frame",
        f"{ours[position]} mm; {float(ours[took]):.0f} ms",
        f"Open3D + pyRANSAC-3D {other[position]} mm; {float(other[took]):.0f} ms",
        f"[{ours['false'].split()[-2]} frames](docs/benchmarks.md)",
        command_of("benchmarks/results/perception.json"),
    )


def camera_predictions() -> Row:
    rows = markdown_rows("benchmarks/results/prediction_camera.md", "Thrown balls")
    begins = ("first flight", "after first bounce", "after second bounce")
    found = {
        way: [
            "/".join(f"{float(row[way]):.0f}" for row in rows if row["begins"] == begin)
            for begin in begins
        ]
        for way in ("error, mm", "known spin", "guess")
    }
    count = sum(int(row["predictions"]) for row in rows if row["begins"] in begins)
    return Row(
        "error of the predicted mean 1 s ahead, median, throws that a rendered camera sees, spins "
        "of 2/10/40 rad/s: in the first flight, after the first and the second bounce",
        ", ".join(found["error, mm"]) + " mm",
        f"spin guessed {', '.join(found['guess'])} mm, given {', '.join(found['known spin'])} mm",
        f"[{count} predictions](docs/benchmarks.md)",
        command_of("benchmarks/results/prediction_camera.json"),
    )


def prediction_node() -> Row:
    path = "benchmarks/results/prediction_node.md"
    rows = markdown_rows(path, "The node at 100 Hz")
    alone = {row["engine"]: row for row in markdown_rows(path, "The paper's way")}
    rates = [cell.partition("(")[2].removesuffix(" Hz)") for cell in alone["ODE"].values()]
    return Row(
        "distributions a second, 20 samples of 5 s; 1 sphere, 3 spheres, 3 mixed objects; 1 and 3 "
        "spheres whose states are estimated",
        ", ".join(row["Hz"] for row in rows),
        f"ODE alone {', '.join(rates[1:])}",
        f"[{rows[0]['for s']} s each](docs/benchmarks.md)",
        command_of("benchmarks/results/prediction_node.json"),
    )


def simulation() -> Row:
    ours, sleeping = simulation_rows()
    scenes = ("1_sphere", "3_spheres", "1_box", "3_mixed")
    return Row(
        "speed over ODE (the paper's engine): 1 sphere, 3 spheres, 1 box, 3 mixed objects",
        ", ".join(ours[scene] for scene in scenes),
        "ODE with sleeping bodies " + ", ".join(sleeping[scene] for scene in scenes),
        "[8 instances each](docs/benchmarks.md)",
        command_of("benchmarks/results/simulation.json"),
    )


def simulation_rows() -> tuple[dict[str, str], dict[str, str]]:
    """Return by scene how much faster than ODE we are, and than ODE whose bodies sleep."""
    rows = {
        row["engine"]: row
        for row in markdown_rows("benchmarks/results/simulation.md", "One prediction")
    }
    return rows["ours against ODE"], rows["ours against ODE, auto-disable"]


def command_of(record: str) -> str:
    """Return the command, as code, of a run: from its JSON file or from the page that it wrote."""
    text = (ROOT / record).read_text(encoding="utf-8")
    if record.endswith(".json"):
        return f"`{json.loads(text)['run']['command']}`"
    found = re.search(r"^Made by (`[^`]+`) at commit ", text, re.MULTILINE)
    if found is None:
        raise ValueError(f'{record} names no command; expected a line "Made by `…` at commit …"')
    return found[1]


def table_file(path: str) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with (ROOT / path).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def markdown_rows(path: str, heading: str) -> list[dict[str, str]]:
    """Return the rows of the table under a heading that begins so."""
    text = (ROOT / path).read_text(encoding="utf-8")
    part = text[text.index(f"\n## {heading}") + 1 :].partition("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(cells[0], row, strict=True)) for row in cells[2:]]


if __name__ == "__main__":
    sys.exit(main())
