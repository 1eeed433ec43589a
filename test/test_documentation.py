"""The README and the site's pages: short, true to the code, and without a dead link."""

from __future__ import annotations

import importlib
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.settings import settings_from_options
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import simulate
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.evaluation.recording_perception import find_frame_source, read_frames
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.observation_files import save_observations

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT / "docs" / "_extensions"), str(ROOT / "tools")]

command_pages, node_pages, readme_results, ros_endpoints = (
    importlib.import_module(name)
    for name in ("command_pages", "node_pages", "readme_results", "ros_endpoints")
)
MAKERS = importlib.import_module("generated_reference").MAKERS

README = ROOT / "README.md"
SITE = [
    path
    for path in sorted((ROOT / "docs").rglob("*.md"))
    if not {"_build", "reference"} & set(path.relative_to(ROOT / "docs").parts)
]
PAGES = [
    README,
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    *SITE,
    ROOT / "benchmarks" / "README.md",
    *sorted(ROOT.glob("src/*/README.md")),
]
GENERATED = {name for maker in MAKERS for name in maker.pages(ROOT)}
SOURCES = [path for path in (ROOT / "src").rglob("*") if path.suffix in (".py", ".msg", ".srv")]

LINK = re.compile(r"(?<!\!)\[[^\]]*\]\(([^)\s]+)\)")
IMAGE = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
ROOTS = ("src", "test", "tools", "docs", "benchmarks", "requirements")


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_readme_is_for_a_newcomer():
    lines = README.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 150
    assert "make demo" in "\n".join(lines)
    assert "make test" in "\n".join(lines)


def test_pictures_of_the_demo_name_the_commit_that_they_are_of():
    with Image.open(ROOT / "docs" / "demo.png") as picture:
        # Of a tree with changes the name ends in "-dirty".
        assert re.fullmatch("[0-9a-f]{12}", picture.info["commit"])
    with Image.open(ROOT / "docs" / "demo.gif") as picture:
        assert re.fullmatch("[0-9a-f]{12}", picture.info["comment"].decode())


@pytest.mark.parametrize("page", readme_results.tables(), ids=relative)
def test_results_are_those_of_the_runs(page):
    text = page.read_text(encoding="utf-8")
    table = readme_results.tables()[page]
    assert readme_results.updated(text, table) == text, (
        "tools/readme_results.py --write brings it up"
    )


def test_results_of_the_readme_are_six_with_one_number_each():
    rows = readme_results.tables()[README].splitlines()[2:]
    assert len(rows) == 6
    for row in rows:
        answer, compared = row.strip("| ").split(" | ")[1:3]
        assert re.fullmatch(r"[\d.]+( (mm|ms|%|×))?", answer), row
        assert len(re.findall(r"[\d.]*\d", compared.replace("3D", ""))) == 1, row


@pytest.mark.parametrize("page", readme_results.tables(), ids=relative)
def test_results_are_comparable(page):
    rows = readme_results.tables()[page].splitlines()[2:]
    assert rows
    for row in rows:
        what, result, compared, of, command = row.strip("| ").split(" | ")
        assert what
        assert re.search(r"\d", result), row
        assert re.search(r"\d", compared), row
        assert re.search(r"\[\d+ .*\]\(", of), f"no denominator: {row}"
        assert command.startswith(("`intuitive-physics ", "`make ")), row


def published_tables() -> dict[Path, str]:
    """Return the table of each page as the page has it."""
    texts = {page: page.read_text(encoding="utf-8") for page in readme_results.tables()}
    return {
        page: text.partition(readme_results.BEGIN)[2].partition(readme_results.END)[0]
        for page, text in texts.items()
    }


def result_rows(tables: dict[Path, str]) -> dict[str, tuple[str, str]]:
    """Return the page that each row of the tables links to, and its command."""
    rows = {}
    for page, table in tables.items():
        for line in table.splitlines()[2:]:
            what, _, _, of, command = line.strip("| ").split(" | ")
            rows[what] = (relative((page.parent / LINK.findall(of)[0]).resolve()), command)
    return rows


def recorded_command(page: str, command: str) -> str:
    """Return the command that a row's run wrote down, as code."""
    benchmark = re.match(r"`make bench-([a-z]+)", command)
    if benchmark:
        assert page == "docs/benchmarks.md"
        part = re.search(r"--only ([a-z]+)", command)
        name = f"{benchmark[1]}_{part[1]}" if part else benchmark[1]
        record = ROOT / "benchmarks" / "results" / f"{name}.json"
        if not record.exists():
            return "none that was kept"
        return f"`{json.loads(record.read_text(encoding='utf-8'))['run']['command']}`"
    made = (ROOT / page).read_text(encoding="utf-8").partition("Made by ")[2]
    return made.partition(" at commit ")[0]


def differing_commands(tables: dict[Path, str]) -> list[str]:
    return [
        what
        for what, (page, command) in result_rows(tables).items()
        if command != recorded_command(page, command)
    ]


def test_each_result_names_the_command_that_its_run_recorded():
    assert not differing_commands(published_tables())


def test_an_option_that_is_left_out_of_a_command_is_noticed():
    tables = published_tables()
    checked = 0
    for what, (_, command) in result_rows(tables).items():
        for option in re.findall(r" (?:--|options=)[^`\s]*(?: [^`\s-]+)*", command):
            shorter = f"| {command.replace(option, '')} |"
            without = {
                page: table.replace(f"| {command} |", shorter) for page, table in tables.items()
            }
            assert what in differing_commands(without), option
            checked += 1
    assert checked >= 10


def settings_given(name: str) -> Any:
    """Return the settings of the paper's experiment that its row's command makes today."""
    command_line = importlib.import_module("intuitive_physics_cli.command_line")
    experiment_command = importlib.import_module(
        "intuitive_physics_experiments.commands.experiment_command"
    )
    (command,) = (
        command
        for _, command in result_rows(published_tables()).values()
        if f"experiment {name} " in command
    )
    options = command_line._parser().parse_args(shlex.split(command.strip("`"))[1:])
    (experiment,) = (one for one in experiment_command.EXPERIMENTS if one.name == name)
    return settings_from_options(experiment.settings, options)


def test_defaults_of_commands_are_those_of_their_runs():
    results = ROOT / "docs" / "results"

    curve = settings_given("learning-curve")
    rows = readme_results.table_file("docs/results/learning_curve/summary.csv")
    page = (results / "learning_curve" / "README.md").read_text(encoding="utf-8")
    assert {int(row["objects"]) for row in rows} == set(curve.objects)
    assert {int(row["samples"]) for row in rows} == set(curve.samples)
    assert {row["first_states"] for row in rows} == set(curve.initial_states)
    assert {int(row["repetitions"]) for row in rows} == {curve.repetitions}
    assert f"moved by `{curve.engine}`, {curve.iterations} iterations of `{curve.method}`." in page

    search = settings_given("search-methods")
    rows = readme_results.table_file("docs/results/search_methods/final.csv")
    page = (results / "search_methods" / "README.md").read_text(encoding="utf-8")
    assert {int(row["objects"]) for row in rows} == set(search.objects)
    assert {int(row["samples"]) for row in rows} == set(search.samples)
    # The row is of 10 objects.
    assert f"J after {search.iterations_of(10)} evaluations" in page
    assert f"mean ± σ over {search.runs} runs" in page

    rows = readme_results.table_file("docs/results/rgbd/errors_by_size.csv")
    assert {int(row["observations"]) for row in rows} == {settings_given("rgbd").throws}


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for target in [*LINK.findall(text), *IMAGE.findall(text)]:
        if target.startswith(("http://", "https://", "#")):
            continue
        path = (page.parent / target.partition("#")[0]).resolve()
        reference = ROOT / "docs" / "reference"
        if path.is_relative_to(reference):
            assert path.relative_to(reference).as_posix() in GENERATED, f"{page}: {target}"
        else:
            assert path.exists(), f"{page}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_paths_exist(page):
    for token in CODE.findall(page.read_text(encoding="utf-8")):
        if is_path(token):
            assert found(token, page), f"{page} names {token}"


def is_path(token: str) -> bool:
    if not re.fullmatch(r"[\w./-]+", token) or token.startswith(("/", "~", ".")):
        return False
    first = token.split("/")[0]
    in_tree = "/" in token and (first in ROOTS or first.startswith("intuitive_physics"))
    in_tree = in_tree and not is_message_type(token)
    return in_tree or token.endswith((".py", ".cpp", ".sh")) or bool(re.fullmatch(r"\w+/", token))


def is_message_type(token: str) -> bool:
    return bool(re.fullmatch(r"\w+_msgs/(msg|srv|action)/\w+", token))


def found(token: str, page: Path) -> bool:
    """Whether a path exists from the root, beside the page, or in the package it begins with."""
    package = ROOT / "src" / token.split("/")[0]
    if any((base / token).exists() for base in (ROOT, page.parent, package)):
        return True
    if token.startswith(("docs/_build", "docs/reference")):
        return True
    wanted = token.rstrip("/")
    return "/" not in wanted and any(
        path.name == wanted
        for folder in ("src", "benchmarks", "tools")
        for path in (ROOT / folder).rglob(wanted)
    )


def commands() -> Iterator[tuple[str, list[str]]]:
    """Yield each command line of a code block or of code in the text, with its page."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        blocks = re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        lines = [line for block in blocks for line in block.splitlines()]
        for line in [*lines, *CODE.findall(text)]:
            line = line.removeprefix("$ ").strip()
            if line.startswith(("intuitive-physics ", "make ")):
                try:
                    words = shlex.split(line, comments=True)
                except ValueError:
                    continue
                yield relative(page), words


def test_commands_exist():
    parser = importlib.import_module("intuitive_physics_cli.command_line")._parser()
    known = dict(command_pages.commands(parser))
    checked = 0
    for page, words in commands():
        if words[0] != "intuitive-physics" or not words[1].islower():
            continue
        name = " ".join(words[1:3]) if " ".join(words[1:3]) in known else words[1]
        assert name in known, f"{page} uses {' '.join(words)}"
        options = {o for action in known[name]._actions for o in action.option_strings}
        for word in words[2:]:
            if word.startswith("--"):
                assert word.split("=")[0] in options, f"{page} uses {' '.join(words)}"
                checked += 1
    assert checked > 20


def test_targets_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    used = {(page, words[1]) for page, words in commands() if words[0] == "make" and words[1:]}
    assert {target for _, target in used} >= {"demo", "test", "docs"}
    for page, target in used:
        assert target in targets or target.startswith("bench-"), f"{page} uses make {target}"


def nodes() -> dict[str, type]:
    return dict(node_pages.node_classes(ROOT))


def test_topics_named_in_the_pages_exist():
    known = set()
    for module, node_class in nodes().items():
        name = node_pages.node_name(node_class)
        for one in ros_endpoints.endpoints(node_class, plays_a_bag=module == node_pages.BAG_TOPICS):
            known |= {one.name, one.name.replace("~", f"/{name}")}
    assert {
        "intuitive_physics/environment",
        "/predictor_node/query",
        "/tf_static",
        "/clock",
    } <= known
    # Parts of names that only a running node knows are in braces.
    open_names = [re.sub(r"\\\{\w+\\\}", r"\\w+", re.escape(one)) for one in known if "{" in one]
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"(?:~|/\w+_node)/[a-z_/]+[a-z]", text):
            # That package's own README shows a node that does not exist.
            if page.parent.name != "intuitive_physics_ros":
                is_open = any(re.fullmatch(pattern, name) for pattern in open_names)
                assert name in known or is_open, f"{page} names {name}"


def test_parameters_named_as_most_often_set_exist():
    text = (ROOT / "docs" / "on_a_robot.md").read_text(encoding="utf-8")
    by_node = {
        node: {one.name for one in node_pages.parameters(node_class)}
        for node, node_class in nodes().items()
    }
    for node in ("perception", "learner", "predictor"):
        part = re.search(rf"^- {node}[^:\n]*:(.*?)^(?:- |\n)", text, re.MULTILINE | re.DOTALL)
        assert part, node
        names = set(CODE.findall(part[1]))
        assert names
        assert names <= by_node[f"{node}_node"], names - by_node[f"{node}_node"]


@pytest.mark.parametrize("page", SITE, ids=relative)
def test_names_of_the_code_exist(page):
    """Words such as `plane_sigmas` or `FrameResult` stand in some source."""
    known = {
        word for path in SOURCES for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))
    }
    known |= {one.name for node in nodes().values() for one in node_pages.parameters(node)}
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for token in CODE.findall(text):
        if re.fullmatch(r"[a-z]+(_[a-z]+)+|([A-Z][a-z]+){2,}", token):
            assert token in known or (ROOT / "src" / token).exists(), f"{page} names {token}"


def test_endpoint_that_only_a_running_node_knows_is_an_error():
    class Unclear:
        def __init__(self) -> None:
            self.create_publisher(str, self.name(), 1)

    with pytest.raises(ros_endpoints.UnresolvedEndpointError):
        ros_endpoints.endpoints(Unclear)


@pytest.fixture
def bounces(tmp_path):
    """A folder `seen` with two observations of a ball that bounces, 1 mm noise."""
    rng = np.random.default_rng(0)
    floor = Environment([Plane("floor", "floor", normal=(0, 0, 1), offset=0.0)])
    ball = SceneObject("ball", "rubber", Sphere(radius=0.05))
    theta = StaticParameters.uniform(["rubber", "floor"], restitution=0.8)
    times = np.arange(0.0, 1.5, 1.0 / 30.0)
    made = []
    for speed in (0.5, 1.0):
        state = ObjectState(position=(0, 0, 0.6), linear_velocity=(speed, 0, 0))
        path = simulate([Scene(floor, (ball,), (state,))], theta, times).positions[0, 0]
        noisy = path + rng.normal(0.0, 0.001, size=path.shape)
        thrown = ObservedObject(ball, Trajectory(times + 1e-9, noisy), state)
        made.append(Observation(floor, (thrown,), start_time=0.0))
    save_observations(made, tmp_path / "seen")
    return tmp_path


def test_python_of_the_readme_learns_and_simulates(bounces):
    (code,) = re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), re.M | re.S)
    code += "print(learned.parameters.pair('rubber', 'floor')['restitution'])\n"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=bounces, capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr
    shape, restitution = done.stdout.splitlines()
    assert shape == "(2, 1, 200, 3)"
    # 1 mm of noise at 45 points of each throw, three bounces: far below a hundredth.
    assert float(restitution) == pytest.approx(0.8, abs=0.01)


def test_example_of_recording_makes_a_bag_that_perception_reads(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "examples")
    example = importlib.import_module("record_depth_images")
    example.record(tmp_path / "throws", 0.3, lambda: np.full((480, 640), 2000, np.uint16))
    with BagReader(tmp_path / "throws") as bag:
        source = find_frame_source(bag)
        frames = list(read_frames(bag, source))
    assert len(frames) == source.frames > 0
    # 2 m along the optical axis, wherever the pixel.
    assert frames[0][1][..., 2] == pytest.approx(2.0)


def test_example_of_the_library_runs():
    example = ROOT / "docs" / "examples" / "predict_a_ball.py"
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert 0.0 <= float(done.stdout.splitlines()[-1]) <= 1.0
