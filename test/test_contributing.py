"""What CONTRIBUTING.md names exists; each package has a changelog that release tools read."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from tools.source_tree import PACKAGES

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")

PATHS = sorted(
    set(re.findall(r"(?<![\w/])(?:src|test|tools|benchmarks|docs)/[\w./*-]*[\w/*]", PAGE))
)


@pytest.mark.parametrize("path", PATHS)
def test_every_path_exists(path):
    assert list(ROOT.glob(path)), f"CONTRIBUTING.md names {path}, which does not exist"


def test_paths_are_found_on_the_page():
    assert "src/intuitive_physics/intuitive_physics/shapes.py" in PATHS


PERCEPTION = ROOT / "src" / "intuitive_physics_perception" / "intuitive_physics_perception"
SOURCES = {
    path: path.read_text(encoding="utf-8")
    for path in (ROOT / "src").rglob("*")
    if path.suffix in (".py", ".msg")
}


def section(heading: str) -> str:
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def test_every_name_of_the_code_exists():
    known = {word for text in SOURCES.values() for word in re.findall(r"\w+", text)}
    names = re.findall(r"`(_?[a-z]+(?:_[a-z]+)+|[A-Z]+_[A-Z_]+|(?:[A-Z][a-z]+){2,})`", PAGE)
    assert {"FURTHER_RULES", "MetropolisHastings", "detect_planes", "_errors_on_planes"} <= {*names}
    assert not [name for name in names if name not in known]


def test_examples_of_update_rules_are_where_the_page_says():
    folder = ROOT / "src/intuitive_physics_learner/intuitive_physics_learner/search/update_rules"
    rules = (folder / "single_point_search.py").read_text(encoding="utf-8")
    assert "`single_point_search.py`" in section("Add an update rule")
    for name in (
        "MetropolisHastings(ClimbingRule",
        "ClimbingRule(",
        "CoordinateDescent(ClimbingRule",
    ):
        assert f"class {name}" in rules


def test_all_that_uses_the_threshold_of_planes_is_named():
    text = section("Change how a plane is found")
    named = set(re.findall(r"`intuitive_physics_perception/([\w/]+\.py)`", text))
    users = {
        path.relative_to(PERCEPTION).as_posix()
        for path, source in SOURCES.items()
        if path.is_relative_to(PERCEPTION) and "plane_tolerance" in source
    }
    assert len(users) >= 5
    assert users <= named


@pytest.mark.parametrize("target", re.findall(r"^make ([a-z-]+)", PAGE, re.MULTILINE))
def test_every_command_of_make_exists(target):
    assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), f"there is no make {target}"


@pytest.mark.parametrize("package", PACKAGES)
@pytest.mark.filterwarnings("ignore::DeprecationWarning:catkin_pkg")
def test_changelog_begins_with_what_comes_next_or_the_released_version(package):
    from catkin_pkg import changelog

    folder = ROOT / "src" / package
    text = (folder / "CHANGELOG.rst").read_text(encoding="utf-8")
    changelog.populate_changelog_from_rst(changelog.Changelog(package), text)
    version = ElementTree.parse(folder / "package.xml").getroot().findtext("version")
    headings = re.findall(r"^(Forthcoming|\d+\.\d+\.\d+).*\n-+$", text, re.MULTILINE)
    assert text.splitlines()[1] == f"Changelog for package {package}"
    assert headings[0] in ("Forthcoming", version)
