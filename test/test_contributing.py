"""What CONTRIBUTING.md names exists; each package has a changelog that release tools read."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from tools.house.source_tree import SourceTree

ROOT = Path(__file__).parent.parent
TREE = SourceTree(ROOT)
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


@pytest.mark.parametrize("target", re.findall(r"^make ([a-z-]+)", PAGE, re.MULTILINE))
def test_every_command_of_make_exists(target):
    assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), f"there is no make {target}"


@pytest.mark.parametrize("package", TREE.packages)
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
