"""Finished parts of an experiment on disk, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError

SETTINGS_NAME = "settings.json"
"""File that says what a folder's cells were made with."""

CELLS_NAME = "cells"
"""Folder of the finished cells."""

Cell = Callable[[], dict[str, Any]]
"""Computes one part: plain data that JSON holds."""


class CellStore:
    """A folder of finished cells, all made with the same settings.

    Parameters
    ----------
    folder : made where it is missing
    settings : plain data; whatever changes the cells' content must be in it

    Raises
    ------
    InvalidInputError
        When the folder cannot be written or holds cells of other settings.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        self.folder = folder
        wanted = json.loads(json.dumps(settings))
        try:
            (folder / CELLS_NAME).mkdir(parents=True, exist_ok=True)
            path = folder / SETTINGS_NAME
            if path.exists():
                self._check_same(path, wanted)
            else:
                write_whole(path, json.dumps(wanted, indent=1) + "\n")
        except OSError as error:
            raise InvalidInputError(f"cannot use the folder {folder}: {error.strerror}") from None

    def run(
        self,
        cells: Mapping[str, Cell],
        on_progress: Callable[[int, int, str], None] = lambda done, total, name: None,
        processes: int = 1,
    ) -> dict[str, dict[str, Any]]:
        """Compute the cells that are missing, and return all by name.

        Parameters
        ----------
        cells : by name, which becomes a file name
        on_progress : called with the cells done, the cells in all, and the next or last one
        processes : that compute cells side by side
        """
        missing = {name: cell for name, cell in cells.items() if not self._path(name).exists()}
        done = len(cells) - len(missing)
        if processes == 1:
            for more, name in enumerate(missing):
                on_progress(done + more, len(cells), name)
                self._compute(name, missing[name])
        elif missing:
            on_progress(done, len(cells), "")
            for more, name in enumerate(self._computed_side_by_side(missing, processes)):
                on_progress(done + more + 1, len(cells), name)
        on_progress(len(cells), len(cells), "")
        return {name: self._read(self._path(name)) for name in cells}

    def _computed_side_by_side(self, cells: Mapping[str, Cell], processes: int) -> Iterator[str]:
        """Yield the names of cells as they are finished."""
        # Forked children inherit the cells, which hold what cannot be pickled.
        with ProcessPoolExecutor(
            processes, get_context("fork"), initializer=_inherit, initargs=(self, cells)
        ) as pool:
            futures = {pool.submit(_compute_inherited, name): name for name in cells}
            try:
                for future in as_completed(futures):
                    future.result()
                    yield futures[future]
            finally:
                pool.shutdown(cancel_futures=True)

    def _compute(self, name: str, cell: Cell) -> None:
        write_whole(self._path(name), json.dumps(cell(), allow_nan=False))

    def _path(self, name: str) -> Path:
        return self.folder / CELLS_NAME / f"{name}.json"

    def _check_same(self, path: Path, wanted: dict[str, Any]) -> None:
        there = self._read(path)
        other = sorted(
            key for key in {*there, *wanted} if there.get(key, ...) != wanted.get(key, ...)
        )
        if other:
            raise InvalidInputError(
                f"{self.folder} was begun with other settings ({', '.join(other)}); "
                "expected the same as before, or another folder"
            )

    @staticmethod
    def _read(path: Path) -> dict[str, Any]:
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InvalidInputError(
                f"cannot read {path}: {error}; remove it to have it made again"
            ) from None
        if not isinstance(data, dict):
            raise InvalidInputError(f"{path} is no cell of an experiment; expected a JSON object")
        return data


_inherited: dict[str, Any] = {}
"""In a child process: the store and its cells."""


def _inherit(store: CellStore, cells: Mapping[str, Cell]) -> None:
    _inherited.update(store=store, cells=cells)


def _compute_inherited(name: str) -> None:
    _inherited["store"]._compute(name, _inherited["cells"][name])


def write_whole(path: Path, text: str) -> None:
    """Write a file that appears whole or not at all.

    Raises
    ------
    InvalidInputError
        When it cannot be written.
    """
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=path.parent, prefix=f".{path.name}", delete=False
        ) as file:
            file.write(text)
        os.chmod(file.name, 0o644)
        os.replace(file.name, path)
    except OSError as error:
        raise InvalidInputError(f"cannot write {path}: {error.strerror}") from None
