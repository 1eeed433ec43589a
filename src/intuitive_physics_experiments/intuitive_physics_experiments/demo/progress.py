"""What the demo says while it works."""

from __future__ import annotations

import sys
import time

WIDTH = 28
"""Characters of the bar."""


class Progress:
    """Headings of stages, and one bar that is drawn over itself where a person watches."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._live = sys.stdout.isatty()
        self._bar_length = 0

    def stage(self, text: str) -> None:
        """Begin a stage."""
        self.end_bar()
        print(f"[{time.monotonic() - self._start:5.1f} s] {text}", flush=True)

    def detail(self, text: str) -> None:
        """Say something within a stage."""
        self.end_bar()
        print(f"          {text}", flush=True)

    def bar(self, done: float, total: float, text: str = "") -> None:
        """Show how far a stage is; not in a log, where each step would be a line."""
        if not self._live:
            return
        part = min(1.0, done / total) if total > 0 else 1.0
        filled = int(part * WIDTH)
        line = f"          {'█' * filled}{'·' * (WIDTH - filled)} {100 * part:3.0f} % {text}"
        print("\r" + line.ljust(self._bar_length), end="", flush=True)
        self._bar_length = len(line)

    def end_bar(self) -> None:
        """Leave the bar behind."""
        if self._bar_length:
            print(flush=True)
            self._bar_length = 0
