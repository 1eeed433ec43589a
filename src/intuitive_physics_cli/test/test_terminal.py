from __future__ import annotations

import io

from intuitive_physics_cli.terminal import ProgressBar, format_table


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_tables_align_names_left_and_numbers_right() -> None:
    table = format_table(["name", "J"], [["learned", "0.1"], ["μ", "12.25"]])
    assert table.splitlines() == [
        "name         J",
        "-------  -----",
        "learned    0.1",
        "μ        12.25",
    ]


def test_the_bar_shows_progress_and_leaves_no_trace() -> None:
    stream = Terminal()
    with ProgressBar("learning", stream) as bar:
        bar.update(1, 2, "J 0.1 m")
        bar.update(2, 2)
    assert "learning" in stream.getvalue()
    assert "1/2 J 0.1 m" in stream.getvalue()
    assert stream.getvalue().endswith("\r")


def test_nothing_is_written_where_nobody_watches() -> None:
    stream = io.StringIO()
    with ProgressBar("learning", stream) as bar:
        bar.update(1, 2)
    assert stream.getvalue() == ""
