"""The report holds what it was given, is one file, and needs no network."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tools.needs import BROWSER

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import parameter_names
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.evaluation.prequential import Predicted
from intuitive_physics_experiments.demo.demo_result import (
    DemoResult,
    ExampleFrame,
    LearningOutcome,
    PredictionOutcome,
    ThrowErrors,
)
from intuitive_physics_experiments.demo.figures import _pixels, _silhouette
from intuitive_physics_experiments.demo.report import write_report
from intuitive_physics_experiments.rendering.corner_room import (
    MATERIALS,
    corner_camera,
    corner_environment,
    true_parameters,
)


def example_frame() -> ExampleFrame:
    camera = corner_camera()
    time = np.linspace(0.0, 0.6, 19)[:, None]
    track = np.array([0.2, 0.2, 0.5]) + time * [1.0, 0.7, 1.0] - 4.905 * time**2 * [0.0, 0.0, 1.0]
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    nothing = np.zeros(4)
    return ExampleFrame(
        depth=np.full((camera.height, camera.width), 2000, np.uint16),
        camera_matrix=camera.matrix(),
        rotation=camera.rotation,
        translation=camera.position,
        environment=corner_environment(),
        plane_outlines=(
            np.column_stack([square, nothing]),
            np.column_stack([nothing + 1.0, square]),
            np.column_stack([square[:, :1], nothing + 1.0, square[:, 1:]]),
        ),
        sphere_center=track[9],
        sphere_radius=0.05,
        track=track,
    )


@pytest.fixture(scope="module")
def result():
    rng = np.random.default_rng(0)
    frame = example_frame()
    names = parameter_names(MATERIALS)
    identified = [name.startswith("restitution") and "room" in name for name in names]
    learned = LearnedParameters(
        true_parameters(),
        np.where(identified, 0.01, np.nan),
        identified,
        version=1,
        cost=0.02,
        observation_count=3,
        method="cma_es",
    )
    times = np.linspace(0.0, 0.6, 19)
    samples = frame.track + rng.normal(0.0, 0.02, (25, 1, 3)) * times[:, None]
    seen = (frame.environment, 0.05, times)
    noise = np.broadcast_to(0.002**2 * np.eye(3), (19, 3, 3))
    return DemoResult(
        frame,
        LearningOutcome(true_parameters(), learned, np.geomspace(0.2, 0.02, 80), 0.1, 0.012),
        (ThrowErrors("throw <1>", "foam", 0.07, 60, 0.0021, 0.02, 0.012, 0.1),),
        PredictionOutcome(
            frame.environment,
            "rubber",
            0.05,
            times,
            samples,
            samples.mean(axis=0),
            times,
            frame.track,
            frame.track,
        ),
        Predicted(
            cases=(
                PredictionCase("throw <1>: ball", *seen, samples, frame.track, noise),
                PredictionCase("throw 2", *seen, samples + 1.0, frame.track, noise),
            ),
            bounced=(PredictionCase("throw 2", *seen, samples, frame.track, noise),),
            left_out=1,
        ),
        {"learned_J_m": 0.0213, "prediction_rate_hz": 99.9},
        {"seed": "0", "command": "make demo & more"},
    )


class PageParser(HTMLParser):
    """Collects the tags and checks that they nest; what a tag would load is in `sources`."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_page_is_whole_and_self_contained(result, tmp_path):
    paths = write_report(result, tmp_path / "new" / "folder")
    with Image.open(paths.picture) as picture:
        assert picture.format == "PNG"
        assert picture.info.items() >= result.about.items()
    page = paths.page.read_text(encoding="utf-8")
    parser = PageParser()
    parser.feed(page)
    assert parser.open == []
    # The camera frame.
    assert len(parser.sources) == 1
    assert all(source.startswith("data:image/png;base64,") for source in parser.sources)
    assert page.count("Plotly.newPlot(") >= 5
    # The worst case stands first.
    assert page.index("throw 2:") < page.index("throw &lt;1&gt;: ball:")
    for text in (
        "throw <1>",
        "0.0213",
        "learned J (m)",
        "prediction rate (Hz)",
        "make demo & more",
        "those that claim 50 % hold",
        # Of two throws: √(0.5 · 0.5 / 2).
        "± 35 %",
        # Of one, after its bounce.
        "Of the regions of 1 motions",
        "± 50 %",
        "Left out: 1",
    ):
        assert text in parser.text
    assert "restitution[foam, room]" in parser.text
    assert "Not identified" in parser.text


def test_the_silhouette_is_where_rays_touch_the_sphere():
    frame = example_frame()
    rim = _silhouette(frame)
    to_rim, to_center = rim - frame.translation, rim - frame.sphere_center
    assert np.linalg.norm(to_center, axis=1) == pytest.approx(frame.sphere_radius)
    assert np.abs((to_rim * to_center).sum(axis=1)).max() < 1e-12
    center = _pixels(frame, frame.sphere_center[None])[0]
    assert _pixels(frame, rim).mean(axis=0) == pytest.approx(center, abs=0.5)


def test_nothing_identified_is_no_reason_to_fail(result, tmp_path):
    learning = replace(result.learning, learned=LearnedParameters.defaults(MATERIALS))
    paths = write_report(replace(result, learning=learning), tmp_path)
    assert "Not identified" in paths.page.read_text(encoding="utf-8")


def test_a_folder_that_cannot_be_written_is_one_clear_error(result, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match="cannot write the report"):
        write_report(result, tmp_path / "file")


# Writes into the page what only a browser knows: pixels it is too wide by, pictures it shows.
MEASURE = """<script>
addEventListener("load", () => setTimeout(() => {
  const root = document.documentElement;
  document.body.dataset.overflow = root.scrollWidth - root.clientWidth;
  document.body.dataset.pictures = [...document.images].filter(i => i.naturalWidth > 0).length;
}, 3000));
</script>"""


def in_browser(page: str, folder: Path, width: int) -> tuple[str, list[str]]:
    """Open a page in headless Chromium; return its document once drawn, and console errors."""
    path = folder / f"opened_{width}.html"
    path.write_text(page.replace("</body>", MEASURE + "</body>"), encoding="utf-8")
    done = subprocess.run(
        [
            str(BROWSER),
            *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run"),
            *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
            *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
            f"--user-data-dir={folder / 'browser'}",
            f"--window-size={width},1000",
            "--virtual-time-budget=20000",
            "--enable-logging=stderr",
            "--dump-dom",
            path.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
    )
    errors = [
        line
        for line in done.stderr.splitlines()
        if "CONSOLE" in line and ("Uncaught" in line or "rror" in line)
    ]
    return done.stdout, errors


@pytest.mark.long
@pytest.mark.needs("chromium")
@pytest.mark.parametrize("width", [1200, 500])
def test_a_browser_draws_every_plot_and_reports_no_error(result, tmp_path, width):
    page = write_report(result, tmp_path).page.read_text(encoding="utf-8")
    document, errors = in_browser(page, tmp_path, width)
    assert errors == []
    plots = re.findall(r'<div id="[\w-]+" class="plot[^"]*"', document)
    assert len(plots) == page.count("Plotly.newPlot(") >= 5
    assert all("js-plotly-plot" in plot for plot in plots)
    # Plotly makes one of these where it could draw, none where WebGL or the data failed.
    assert document.count('class="plot-container') == len(plots)
    assert 'data-overflow="0"' in document
    assert f'data-pictures="{page.count("<img ")}"' in document


@pytest.mark.long
@pytest.mark.needs("chromium")
def test_an_error_in_the_page_is_found(result, tmp_path):
    page = write_report(result, tmp_path).page.read_text(encoding="utf-8")
    broken = page.replace("</body>", "<script>Plotly.noSuchFunction()</script></body>")
    assert any("noSuchFunction" in error for error in in_browser(broken, tmp_path, 1200)[1])
