"""Tables and a progress bar for people at a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import TextIO

BAR_WIDTH = 30
"""Characters."""

UPDATE_PERIOD = 0.1
"""s between two drawings of the bar."""


def format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return lines of columns, the first one left-aligned, the others right-aligned."""
    cells = [list(header), *map(list, rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = [
        "  ".join(
            text.ljust(width) if k == 0 else text.rjust(width)
            for k, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


class ProgressBar:
    """A context with a bar on a stream, standard error if None; it is shown at a terminal only."""

    def __init__(self, label: str, stream: TextIO | None = None) -> None:
        self._label = label
        self._stream = sys.stderr if stream is None else stream
        self._shown_at = -float("inf")
        self._length = 0

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._length:
            self._stream.write("\r" + " " * self._length + "\r")
            self._stream.flush()

    def update(self, done: int, total: int, note: str = "") -> None:
        """Show how much is done; at most ten times a second."""
        now = time.monotonic()
        if not self._stream.isatty() or now - self._shown_at < UPDATE_PERIOD:
            return
        self._shown_at = now
        share = done / total if total else 0.0
        filled = round(min(share, 1.0) * BAR_WIDTH)
        bar = "█" * filled + "·" * (BAR_WIDTH - filled)
        line = f"{self._label} {bar} {done}/{total} {note}".rstrip()
        self._stream.write("\r" + line.ljust(self._length))
        self._stream.flush()
        self._length = len(line)
