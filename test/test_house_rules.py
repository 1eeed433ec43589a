"""The layout's rules: arrows point down only, ROS stays in its rooms, nothing grows back."""

from __future__ import annotations

import re
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from tools.house.import_graph import imports_of
from tools.house.layout_rules import ALLOWED_IMPORTS
from tools.house.measures import MEASURES
from tools.house.source_tree import SourceTree

ROOT = Path(__file__).parent.parent
TREE = SourceTree(ROOT)

CEILINGS = {
    "largest_folder": 15,
    "single_importer_modules": 49,
    "largest_argument_list": 11,
    "longest_function": 66,
    "readme_lines": 150,
    "undocumented_arrays": 0,
    "module_constants_without_docstring": 0,
    "upward_imports": 0,
    "circles": 0,
}
"""What each number of `make house` may be at most; lower it whenever the number falls."""

ROOMS = {
    *("src", "test", "docs", "benchmarks", "tools", "requirements"),
    *(".ci", ".github", ".devcontainer"),
}
"""Folders at the top, as docs/architecture.md has them, and those that services look for."""


def test_every_number_has_a_ceiling():
    assert CEILINGS.keys() == MEASURES.keys()


@pytest.mark.parametrize("key", CEILINGS)
def test_number_stays_below_its_ceiling(key):
    value = MEASURES[key].value(TREE)
    assert value <= CEILINGS[key], (
        f"{key} is {value}, at most {CEILINGS[key]} is allowed; see which it are with "
        f'make house options="--details {key}":\n'
        + "\n".join(str(place) for place in MEASURES[key].places(TREE)[:20])
    )


@pytest.mark.needs("clone")
def test_the_tree_holds_what_was_put_there():
    """Nothing that a run left behind was committed: rooms are known, and names are plain."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    names = [Path(name) for name in listed.stdout.split("\0") if name]
    assert {name.parts[0] for name in names if len(name.parts) > 1} <= ROOMS
    assert not [str(name) for name in names if not re.fullmatch(r"[\w./-]+", str(name), re.ASCII)]


def test_every_package_has_a_row_in_the_layout():
    assert set(TREE.packages) <= set(ALLOWED_IMPORTS)


def test_arrows_of_the_layout_point_down():
    """No package may import one that may import it, by however many steps."""
    for package in ALLOWED_IMPORTS:
        reached, ahead = set(), set(ALLOWED_IMPORTS[package])
        while ahead:
            name = ahead.pop()
            reached.add(name)
            ahead |= ALLOWED_IMPORTS[name] - reached
        assert package not in reached


def test_no_module_is_named_after_a_node_that_it_is_not():
    names = [module.path.as_posix() for module in TREE.package_modules]
    assert not [name for name in names if re.search(r"_of_\w*_node\.py$", name)]


@pytest.mark.parametrize("package", TREE.packages)
def test_manifest_is_whole(package):
    folder = ROOT / "src" / package
    root = ElementTree.parse(folder / "package.xml").getroot()
    assert root.findtext("name") == package
    assert root.findtext("license") == "Apache-2.0"
    assert root.findtext("version") == "0.1.0"
    assert root.findtext("description")
    assert root.find("maintainer") is not None
    declared = {element.text for tag in ("depend", "exec_depend") for element in root.findall(tag)}
    if package in TREE.python_packages:
        used = {
            item.module.split(".")[0]
            for module in TREE.package_modules
            if module.package == package
            for item in imports_of(module)
        } & set(TREE.packages)
        assert used - {package} <= declared, f"{package} lacks {used - declared}"
        assert (folder / "resource" / package).exists()
