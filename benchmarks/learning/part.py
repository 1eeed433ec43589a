"""What all parts of the learning benchmark take and return."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from benchmarks.results.result import Table


@dataclass(frozen=True)
class Plan:
    """What is asked of every part.

    Parameters
    ----------
    quick : whether little is to be measured, for a first look
    first_seed : of the random sets; each part draws set i from seed `first_seed` + i
    """

    quick: bool
    first_seed: int


@dataclass(frozen=True)
class Findings:
    """What a part found.

    Parameters
    ----------
    tables : all that was measured, each figure with its denominator and that of the defaults
    figures : its entries of the last line, by key
    complaints : bars that were missed
    draw : writes the figure of the part to a path; None where there is no figure
    """

    tables: Sequence[Table] = ()
    figures: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    complaints: Sequence[str] = ()
    draw: Callable[[Path], None] | None = None


@dataclass(frozen=True)
class Part:
    """A part of the benchmark that can be run by itself.

    Parameters
    ----------
    name : by which it is chosen
    keys : of the last line that it gives
    measure : runs it
    """

    name: str
    keys: tuple[str, ...]
    measure: Callable[[Plan], Findings]
