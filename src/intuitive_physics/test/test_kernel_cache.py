"""Compiled kernels are found again only by what they were compiled from."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import intuitive_physics
from intuitive_physics.kernels import cache, entry
from intuitive_physics.simulation.compile import WARM_UPS

PACKAGE = Path(intuitive_physics.__file__).parent
SOURCES = sorted(PACKAGE.parents[1].glob("*/intuitive_physics*/**/*.py"))
ENTRIES = (
    ("intuitive_physics.simulation.core.kernel", "roll_worlds"),
    ("intuitive_physics.simulation.spheres.roots", "first_fall_quadratic"),
    ("intuitive_physics.simulation.rigid_bodies.overlaps", "find_overlaps"),
)

FALLING = """
from intuitive_physics.geometry.vectors import add_scaled
from intuitive_physics.kernels import entry

@entry
def height(speed, acceleration, t):
    moved = add_scaled((0.0, 0.0, 0.0), (0.0, 0.0, speed), t)
    return add_scaled(moved, (0.0, 0.0, acceleration), 0.5 * t * t)[2]
"""
"""A kernel of another module than what it calls."""

FALL = """
from intuitive_physics.falling import height
print(height(1.0, -2.0, 3.0), sum(height._cache_misses.values()))
"""
"""Prints the height, 3 - 9 m by v t + a t²/2, and how often the kernel was compiled."""


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """A folder with a copy of the library and the kernel of FALLING."""
    folder = tmp_path_factory.mktemp("packages")
    shutil.copytree(
        PACKAGE, folder / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__", "*.nb?")
    )
    (folder / PACKAGE.name / "falling.py").write_text(FALLING)
    return folder


@pytest.fixture
def fall(packages, tmp_path):
    """Return the height and the number of compilations, of a process that imports the copy."""
    (tmp_path / "home").mkdir()

    def run(**environment: str) -> tuple[float, int]:
        kept = {name: value for name, value in os.environ.items() if "CACHE" not in name}
        kept |= {"PYTHONPATH": str(packages), "HOME": str(tmp_path / "home")}
        # Python itself goes by the time of change.
        kept |= {"PYTHONDONTWRITEBYTECODE": "1"} | environment
        done = subprocess.run(
            [sys.executable, "-c", FALL], env=kept, capture_output=True, text=True, check=True
        )
        height, compilations = done.stdout.split()
        return float(height), int(compilations)

    return run


def replace_keeping_time(path: Path, old: str, new: str) -> None:
    """Edit a file to another of the same length and time of change."""
    before = path.stat()
    text = path.read_text()
    assert old in text
    assert len(old) == len(new)
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def reached(dispatcher: Dispatcher, found: set[Path]) -> set[Path]:
    """Files of a kernel and of all kernels that it calls, by the names in its code."""
    function = dispatcher.py_func
    found.add(Path(function.__code__.co_filename))
    for name in function.__code__.co_names:
        called = function.__globals__.get(name)
        if isinstance(called, Dispatcher) and called is not dispatcher:
            reached(called, found)
    return found


def test_an_edited_kernel_gives_the_new_physics(packages, fall):
    vectors = packages / PACKAGE.name / "geometry" / "vectors.py"
    assert fall() == (-6.0, 1)
    assert fall() == (-6.0, 0), "the kernel is compiled though nothing has changed"
    replace_keeping_time(vectors, "a[2] + s * b[2]", "a[2] - s * b[2]")
    assert fall() == (6.0, 1)
    assert fall() == (6.0, 0)
    replace_keeping_time(vectors, "a[2] - s * b[2]", "a[2] + s * b[2]")
    assert fall() == (-6.0, 0), "the kernel of the first sources is there still"


@pytest.mark.parametrize(("module", "name"), ENTRIES)
def test_each_kernel_that_is_called_is_part_of_the_key(module, name):
    kernel = getattr(importlib.import_module(module), name)
    followed = set(cache._sources(kernel.py_func).values())
    assert reached(kernel, set()) <= followed
    assert PACKAGE / "kernels" / "decorators.py" in followed


def test_every_engine_is_among_the_kernels_that_are_kept():
    assert len(WARM_UPS) <= len(ENTRIES)
    for module, name in ENTRIES:
        kernel = getattr(importlib.import_module(module), name)
        assert isinstance(kernel._cache, cache.KernelCache)


def test_imports_are_found_as_python_finds_them():
    assert len(SOURCES) > 200
    for path in SOURCES:
        source = path.read_text()
        expected = set()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Import):
                expected.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert not node.level, f"{path} names what it imports from its own place"
                expected.add(node.module)
                expected.update(f"{node.module}.{alias.name}" for alias in node.names)
        ours = {name for name in expected if name.startswith(cache.SUITE)}
        assert ours <= cache.imported_modules(source), path


@pytest.fixture
def fall_here(tmp_path, monkeypatch):
    """Return the height and the number of compilations, of the kernel imported once more here."""
    path = tmp_path / "intuitive_physics_falling.py"
    path.write_text(FALLING)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(cache.config, "CACHE_DIR", "")

    def run() -> tuple[float, int]:
        spec = importlib.util.spec_from_file_location(path.stem, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        height = module.height(1.0, -2.0, 3.0)
        return height, sum(module.height._cache_misses.values())

    return run


def test_a_compilation_is_noted_before_it_and_a_kernel_that_is_there_is_not(fall_here):
    noted = []
    with cache.compilations_noted(lambda: noted.append("compiling")):
        assert fall_here() == (-6.0, 1)
        assert noted == ["compiling"]
        assert fall_here() == (-6.0, 0)
    assert noted == ["compiling"]
    assert not cache.KernelCache.listeners


def test_folders_that_cannot_be_written_give_way_to_the_users_own(fall_here, tmp_path):
    # Nobody, not even root, makes a folder below a file.
    (tmp_path / "__pycache__").write_text("no folder")
    assert fall_here() == (-6.0, 1)
    assert fall_here() == (-6.0, 0)
    assert list((tmp_path / "home").rglob("height.*.nbc"))


def test_kernels_that_are_there_need_no_right_to_write(fall_here, tmp_path):
    assert fall_here() == (-6.0, 1)
    place = tmp_path / "__pycache__" / "kernels"
    before = {path: path.stat().st_mtime_ns for path in [place, *place.rglob("*")]}
    for path in before:
        path.chmod(0o555)
    assert fall_here() == (-6.0, 0)
    assert {path: path.stat().st_mtime_ns for path in [place, *place.rglob("*")]} == before


def test_kernels_are_compiled_where_nothing_can_be_written(
    fall_here, tmp_path, monkeypatch, caplog
):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr(cache.config, "CACHE_DIR", str(tmp_path / "file"))
    assert fall_here() == (-6.0, 1)
    assert "compiled kernels cannot be kept" in caplog.text


def test_files_that_are_cut_off_or_others_could_have_written_are_compiled_again(
    fall_here, tmp_path, monkeypatch
):
    monkeypatch.setattr(cache.config, "CACHE_DIR", str(tmp_path / "cache"))
    assert fall_here() == (-6.0, 1)
    (file,) = (tmp_path / "cache").rglob("height.*.nbc")
    whole = file.read_bytes()
    for damaged in (whole[:-100], whole[:10], b"", whole[:-1] + b"x"):
        file.write_bytes(damaged)
        assert fall_here() == (-6.0, 1)
    file.chmod(0o666)
    assert fall_here() == (-6.0, 1)
    assert fall_here() == (-6.0, 0)


def test_processes_that_compile_at_the_same_time_leave_one_good_file(fall, tmp_path):
    place = str(tmp_path / "cache")
    with ThreadPoolExecutor(3) as pool:
        runs = [pool.submit(fall, NUMBA_CACHE_DIR=place) for _ in range(3)]
    assert {run.result()[0] for run in runs} == {-6.0}
    assert fall(NUMBA_CACHE_DIR=place) == (-6.0, 0)
    assert len([path for path in Path(place).rglob("*") if path.is_file()]) == 1


def test_folders_of_old_sources_are_few(tmp_path):
    for number in range(3 * cache.MOST_VERSIONS):
        folder = tmp_path / f"intuitive_physics.a-{number:020x}"
        cache._write(folder / "kernel.nbc", b"")
        os.utime(folder, ns=(number, number))
    other = tmp_path / "intuitive_physics.a.b-0"
    cache._write(other / "kernel.nbc", b"")
    names = {folder.name for folder in tmp_path.iterdir()}
    newest = range(2 * cache.MOST_VERSIONS, 3 * cache.MOST_VERSIONS)
    assert names == {other.name} | {f"intuitive_physics.a-{number:020x}" for number in newest}


@pytest.mark.parametrize("given", ["", "relative/cache", "/absolute/cache"])
def test_no_place_is_relative_to_where_a_process_runs(monkeypatch, given):
    monkeypatch.setenv("XDG_CACHE_HOME", given)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(cache.config, "CACHE_DIR", "")
    places = list(cache._places(PACKAGE / "any.py"))
    assert places[0] == PACKAGE / "__pycache__" / "kernels"
    assert all(place.is_absolute() for place in places)
    assert (Path("/absolute/cache/intuitive_physics/kernels") in places) == (given[:1] == "/")


def test_functions_whose_sources_cannot_be_followed_are_not_kept():
    def inner(number):
        return number + offset

    offset = 1.0
    for function in (inner, lambda number: number, shutil.rmtree):
        assert not cache.keeps(function)
    assert not isinstance(entry(inner)._cache, cache.KernelCache)
