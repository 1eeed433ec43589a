"""Tests import only what set-up brings, or ask for more in the one way there is."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import distributions
from pathlib import Path

import pytest
from tools.needs import NEEDS, asked_by, asked_by_module
from tools.source_tree import PACKAGES

ROOT = Path(__file__).parent.parent
OWN = {*PACKAGES, "benchmarks", "tools"}

FILES = [
    path
    for pattern in ("conftest.py", "src/conftest.py", "src/*/test/**/*.py", "test/**/*.py")
    for path in sorted(ROOT.glob(pattern))
]
BENCHMARKS = sorted(ROOT.glob("benchmarks/**/*.py"))

OTHER_WAYS = {"pytest.importorskip", "pytest.skip", "pytest.mark.skip", "pytest.mark.skipif"}
"""Of skipping, which leave open what a run lacked."""


def names_in(file: str) -> set[str]:
    """Distributions that a file of requirements pins or names."""
    text = (ROOT / "requirements" / file).read_text(encoding="utf-8")
    return set(re.findall(r"^[a-z][\w.-]*", text, re.MULTILINE | re.IGNORECASE))


def brought_modules() -> set[str]:
    """Top-level modules of what set-up installs, and Python's own."""
    brought = {name.lower() for name in names_in("constraints.txt") - names_in("bench.txt")}
    # Some are installed for another Python than this one; these are modules of their own name.
    return set(sys.stdlib_module_names).union(
        brought,
        *(
            {file.parts[0].partition(".")[0] for file in one.files or ()}
            for one in distributions()
            if re.sub(r"[-_.]+", "-", one.metadata["Name"]).lower() in brought
        ),
    )


BROUGHT = brought_modules() | OWN


def unasked(node: ast.AST, asked: set[str]) -> Iterator[str]:
    """What a part of a module imports that neither set-up brings nor it asks for."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        asked = asked | asked_by(node.decorator_list)
    imported = []
    if isinstance(node, ast.Import):
        imported = [alias.name for alias in node.names]
    elif isinstance(node, ast.ImportFrom) and not node.level:
        imported = [str(node.module)]
    for name in imported:
        if name.split(".")[0] not in BROUGHT | asked:
            yield f"line {node.lineno} imports {name}"
    if isinstance(node, ast.Attribute) and ast.unparse(node) in OTHER_WAYS:
        yield f"line {node.lineno} skips by {ast.unparse(node)}"
    for child in ast.iter_child_nodes(node):
        yield from unasked(child, asked)


def unasked_in(text: str) -> list[str]:
    tree = ast.parse(text)
    return list(unasked(tree, asked_by_module(tree)))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_beyond_the_set_up_are_asked_for(path):
    found = unasked_in(path.read_text(encoding="utf-8"))
    assert not found, (
        f"{path}: {'; '.join(found)}; expected what make setup installs, or "
        f"pytest.mark.needs of a name in tools/needs.py"
    )


@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: str(path.relative_to(ROOT)))
def test_tests_can_import_benchmarks(path):
    """Only in functions do they import what their own targets of make install."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for function in [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]:
        function.body.clear()
    found = list(unasked(tree, set()))
    assert not found, f"{path}: {'; '.join(found)}; expected it in the function that uses it"


IMPORT = "from tf2_msgs.msg import TFMessage\n"
ASK = 'pytest.mark.needs("tf2_msgs")'


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (IMPORT, ["line 1 imports tf2_msgs.msg"]),
        (f"pytestmark = {ASK}\n{IMPORT}", []),
        (f"pytestmark = [pytest.mark.long, {ASK}]\n{IMPORT}", []),
        (f'pytestmark = pytest.mark.needs("tf2_ros")\n{IMPORT}', ["line 2 imports tf2_msgs.msg"]),
        (f"def test_tf():\n    {IMPORT}", ["line 2 imports tf2_msgs.msg"]),
        (f"@{ASK}\ndef test_tf():\n    {IMPORT}", []),
        (f"@{ASK}\ndef test_tf(): ...\n{IMPORT}", ["line 3 imports tf2_msgs.msg"]),
        ("import numpy, rclpy.node\nimport intuitive_physics_msgs.msg\nfrom . import camera\n", []),
        ('pytest.importorskip("tf2_msgs")\n', ["line 1 skips by pytest.importorskip"]),
        ("@pytest.mark.skipif(x)\ndef test(): ...\n", ["line 1 skips by pytest.mark.skipif"]),
    ],
)
def test_an_import_that_nobody_asked_for_is_found(text, found):
    assert unasked_in(text) == found


MADE_UP = """\
import pytest

pytestmark = pytest.mark.needs("unicorn")

import a_module_that_nobody_has


def test_never_run():
    raise AssertionError
"""

MIXED = """\
import pytest


@pytest.mark.needs("unicorn")
def test_never_run():
    raise AssertionError


def test_run():
    pass
"""

WITHOUT_UNICORN = """\
from tools import needs

pytest_plugins = ["tools.needs"]
needs.NEEDS["unicorn"] = needs.Need(lambda: False, "plant a forest")
"""


def run_pytest(folder: Path, *arguments: str) -> str:
    (folder / "pytest.ini").write_text(f"[pytest]\npythonpath = {ROOT}\nmarkers = needs\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:dash", "-ra", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.stdout + done.stderr


def test_test_without_its_needs_is_skipped_with_one_sentence(tmp_path):
    (tmp_path / "conftest.py").write_text(WITHOUT_UNICORN)
    (tmp_path / "test_made_up.py").write_text(MADE_UP)
    (tmp_path / "test_mixed.py").write_text(MIXED)
    said = run_pytest(tmp_path)
    assert "1 passed, 2 skipped" in said, said
    for place in ("test_made_up.py:1", "test_mixed.py:4"):
        assert f"SKIPPED [1] {place}: lacks unicorn; to bring it: plant a forest" in said, said


def test_a_need_that_is_unknown_is_an_error(tmp_path):
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["tools.needs"]\n')
    (tmp_path / "test_mixed.py").write_text(MIXED)
    said = run_pytest(tmp_path)
    assert f"a test needs unicorn; expected some of {', '.join(NEEDS)}" in said, said
    assert "Traceback" not in said
