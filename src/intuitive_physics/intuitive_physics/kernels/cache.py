"""The cache of compiled kernels: found again only by what it was compiled from.

Numba's own cache looks at one file's time and does not notice that what a kernel calls has changed.
Here the folder of a kernel is named by a hash of its module, of all modules that this one imports
from this suite, of theirs, and of the versions of what compiles them. Whatever way the files came
here (pip, colcon, an editor), a kernel of other sources is in another folder.

Each version of a kernel is a file of its own, written elsewhere and renamed: processes that compile
at the same time cannot mix their files. A file that is cut off, or that another user could have
written, is not read: to load one is to run it.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import platform
import re
import shutil
import sys
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from pickle import loads
from typing import Any, ClassVar

import numba
import numpy as np
from numba.core import config
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

SUITE = "intuitive_physics"
"""How the names of the packages begin whose sources are followed."""

MOST_VERSIONS = 4
"""Folders of one module that are kept in a place, those of other sources among them."""

_FROM = re.compile(
    rf"^[ \t]*from[ \t]+({SUITE}[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)", re.MULTILINE
)
"""`from … import …` of this suite's modules, with what is imported, on one line or in brackets."""

_IMPORT = re.compile(rf"^[ \t]*import[ \t]+({SUITE}[\w.]*)", re.MULTILINE)
"""`import …` of this suite's modules."""


class KernelCache(_Cache):
    """Where the versions of one kernel are kept.

    Parameters
    ----------
    function : a function of a module of this suite
    """

    used: ClassVar[set[Path]] = set()
    """Folders that kernels of this process came from or went to."""

    listeners: ClassVar[dict[int, Callable[[], None]]] = {}
    """What is called before a kernel is compiled, by the thread that needs the kernel."""

    def __init__(self, function: Callable) -> None:
        self._source = Path(function.__code__.co_filename)
        self._name = function.__qualname__
        versions = f"{function.__module__}-{_digest_of_sources(function)[:20]}"
        self._folders = [place / versions for place in _places(self._source)]
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """Where a kernel that is compiled next would be kept, if that can be written."""
        return str(self._folders[0])

    def enable(self) -> None:
        """Load and save from here on."""
        self._enabled = True

    def disable(self) -> None:
        """Neither load nor save from here on."""
        self._enabled = False

    def flush(self) -> None:
        """Remove all versions of this kernel."""
        for folder in self._folders:
            for file in folder.glob(f"{self._name}.*"):
                file.unlink(missing_ok=True)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the version for types of arguments, or None where there is none."""
        target_context.refresh()
        if not self._enabled:
            return None
        name = self._file_name(sig, target_context.codegen())
        for folder in self._folders:
            content = self._read(folder / name)
            if content is not None:
                self.used.add(folder)
                return CompileResult._rebuild(target_context, *loads(content))
        self.listeners.get(threading.get_ident(), lambda: None)()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a version in the first place that can be written."""
        if not self._enabled or data.library.has_dynamic_globals:
            return
        name = self._file_name(sig, data.codegen)
        content = dumps(data._reduce())
        for folder in self._folders:
            try:
                _write(folder / name, content)
            except OSError as error:
                reason = error
            else:
                self.used.add(folder)
                return
        _warn_once(f"compiled kernels cannot be kept and are compiled at each start: {reason}")

    def _file_name(self, sig: Any, codegen: Any) -> str:
        """Name of the file of a version: of types of arguments on a kind of processor."""
        options = [str(_option(name)) for name in ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")]
        kind = repr((str(sig), codegen.magic_tuple(), options))
        return f"{self._name}.{hashlib.sha256(kind.encode()).hexdigest()[:20]}.nbc"

    def _read(self, path: Path) -> bytes | None:
        try:
            with path.open("rb") as file:
                state = os.fstat(file.fileno())
                trusted = {0, os.getuid(), self._source.stat().st_uid}
                if state.st_uid not in trusted or state.st_mode & 0o002:
                    return None
                digest, content = file.read(hashlib.sha256().digest_size), file.read()
        except OSError:
            return None
        return content if hashlib.sha256(content).digest() == digest else None


@contextmanager
def compilations_noted(note: Callable[[], None]) -> Iterator[None]:
    """Call `note` each time that this thread finds a kernel nowhere, and so compiles it next."""
    thread = threading.get_ident()
    KernelCache.listeners[thread] = note
    try:
        yield
    finally:
        del KernelCache.listeners[thread]


def keeps(function: Callable) -> bool:
    """Whether a function's sources can be followed: one of a module of this suite, as a file."""
    return (
        function.__module__.startswith(SUITE)
        and "." not in function.__qualname__
        and Path(function.__code__.co_filename).is_file()
    )


def imported_modules(source: str) -> frozenset[str]:
    """Names of this suite's modules that a source imports, and of what may be modules.

    Parameters
    ----------
    source : of a module; what it imports is named in full

    Returns
    -------
    for `from a import b` both `a` and `a.b`, as `b` may be a module
    """
    names = set(_IMPORT.findall(source))
    for module, what in _FROM.findall(source):
        names.add(module)
        names.update(f"{module}.{name}" for name in re.findall(r"\w+", what))
    return frozenset(names)


def _digest_of_sources(function: Callable) -> str:
    """Hash of all that a kernel's code depends on."""
    digest = hashlib.sha256(repr(_versions()).encode())
    for module, path in sorted(_sources(function).items()):
        digest.update(f"{module}\n{_read_source(path, *_stamp(path))[0]}\n".encode())
    return digest.hexdigest()


def _versions() -> tuple[str, ...]:
    return (
        platform.python_implementation(),
        sys.version,
        np.__version__,
        numba.__version__,
        version("llvmlite"),
    )


def _sources(function: Callable) -> dict[str, Path]:
    """Files of a kernel's module and of all that this one imports, by the modules' names."""
    found = {function.__module__: Path(function.__code__.co_filename)}
    waiting = list(found.values())
    while waiting:
        path = waiting.pop()
        for module in _read_source(path, *_stamp(path))[1]:
            imported = None if module in found else _file_of(module)
            if imported is not None:
                found[module] = imported
                waiting.append(imported)
    return found


@cache
def _file_of(module: str) -> Path | None:
    """File of one of this suite's modules; None for a name that is none."""
    package, *rest = module.split(".")
    folder = _folder_of(package)
    if folder is None:
        return None
    path = folder.joinpath(*rest)
    for file in (path / "__init__.py", path.with_suffix(".py")):
        if file.is_file():
            return file
    return None


@cache
def _folder_of(package: str) -> Path | None:
    spec = importlib.util.find_spec(package)
    return Path(spec.origin).parent if spec is not None and spec.origin is not None else None


def _stamp(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_mtime_ns, state.st_size


@lru_cache(maxsize=1024)
def _read_source(path: Path, time: int, size: int) -> tuple[str, frozenset[str]]:
    """Hash of a file and the modules it imports; time and size say when to read it once more."""
    source = path.read_bytes()
    return hashlib.sha256(source).hexdigest(), imported_modules(source.decode())


def _places(source: Path) -> Iterator[Path]:
    """Folders that hold kernels, the first that can be read and written first."""
    if _option("CACHE_DIR"):
        yield Path(_option("CACHE_DIR")) / f"{SUITE}_kernels"
        return
    yield source.parent / "__pycache__" / "kernels"
    # The XDG specification says to ignore a path that is not absolute.
    user = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not user.is_absolute():
        user = Path(os.path.expanduser("~")) / ".cache"
    if user.is_absolute():
        yield user / SUITE / "kernels"


def _option(name: str) -> Any:
    """Return what Numba was given by the variable NUMBA_`name` of the environment."""
    return getattr(config, name)


def _write(path: Path, content: bytes) -> None:
    """Write a file of the cache; where its folder is new, remove the oldest of its module."""
    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_oldest(path.parent)
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}.tmp")
    # Readable for all, as the sources are, and written by nobody else.
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(hashlib.sha256(content).digest())
            file.write(content)
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def _remove_oldest(folder: Path) -> None:
    """Remove the folders of the same module but the newest, that of `folder` among these."""
    module = folder.name.rpartition("-")[0]
    others = [other for other in folder.parent.glob(f"{module}-*") if other != folder]
    ages = {}
    for other in others:
        try:
            ages[other] = other.stat().st_mtime_ns
        except FileNotFoundError:  # Another process removes it too.
            continue
    for other in sorted(ages, key=ages.__getitem__, reverse=True)[MOST_VERSIONS - 1 :]:
        shutil.rmtree(other, ignore_errors=True)


@cache
def _warn_once(message: str) -> None:
    logging.getLogger(__name__).warning(message)
