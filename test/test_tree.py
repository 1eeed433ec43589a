"""What the repository holds: rooms that are known, whole manifests, folders one can look over."""

from __future__ import annotations

import re
import subprocess
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path

import pytest
from tools.source_tree import PACKAGES, PYTHON_PACKAGES, imported_packages, syntax_of

ROOT = Path(__file__).parent.parent

ROOMS = {
    *("src", "test", "docs", "benchmarks", "tools", "requirements"),
    *(".ci", ".github", ".devcontainer"),
}
"""Folders at the top, as docs/architecture.md has them, and those that services look for."""


MOST_MODULES = 15
"""Modules in a folder of a package."""


def test_folders_can_be_looked_over():
    modules = (path for package in PYTHON_PACKAGES for path, _ in syntax_of(package))
    counts = Counter(path.parent for path in modules if path.name != "__init__.py")
    assert {folder for folder, count in counts.items() if count > MOST_MODULES} == set()


@pytest.mark.needs("clone")
def test_the_tree_holds_what_was_put_there():
    """Nothing that a run left behind was committed: rooms are known, and names are plain."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    names = [Path(name) for name in listed.stdout.split("\0") if name]
    assert {name.parts[0] for name in names if len(name.parts) > 1} <= ROOMS
    assert not [str(name) for name in names if not re.fullmatch(r"[\w./-]+", str(name), re.ASCII)]


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_is_whole(package):
    folder = ROOT / "src" / package
    root = ElementTree.parse(folder / "package.xml").getroot()
    assert root.findtext("name") == package
    assert root.findtext("license") == "Apache-2.0"
    assert root.findtext("version") == "0.1.0"
    assert root.findtext("description")
    assert root.find("maintainer") is not None
    declared = {element.text for tag in ("depend", "exec_depend") for element in root.findall(tag)}
    if package in PYTHON_PACKAGES:
        used = {
            name for _, syntax in syntax_of(package) for name in imported_packages(syntax)
        } & set(PACKAGES)
        assert used - {package} <= declared, f"{package} lacks {used - declared}"
        assert (folder / "resource" / package).exists()
