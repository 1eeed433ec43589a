"""Public arrays state their shape; what counts as that is tried on a module made up for it."""

from __future__ import annotations

import ast
import textwrap
from pathlib import Path

from tools.array_documentation import undocumented_arrays
from tools.source_tree import PYTHON_PACKAGES, syntax_of


def found(source: str) -> list[str]:
    return undocumented_arrays([(Path("a.py"), ast.parse(textwrap.dedent(source)))])


LEFT_OUT = {"intuitive_physics_bringup", "intuitive_physics_cli", "intuitive_physics_experiments"}
"""Packages that nobody imports, and that are not on the reference pages."""


def test_public_arrays_state_their_shape():
    # All at once: base classes may be those of another package.
    packages = [package for package in PYTHON_PACKAGES if package not in LEFT_OUT]
    modules = [module for package in packages for module in syntax_of(package)]
    assert not undocumented_arrays(modules)


def test_undocumented_arrays_of_functions():
    assert found(
        '''
        def bare(a: NDArray[np.float64], b: float) -> None:
            """Nothing of its shape (it has one)."""

        def with_entries(
            a: ArrayLike, b: np.ndarray | None, c: "list[NDArray]", d: NDArray
        ) -> NDArray[np.float64]:
            """Add.

            Parameters
            ----------
            a, b : (n, 3) m
            c : array
                (n_worlds, 4), one for each
            d : array of metres

            Returns
            -------
            sum : (n, 3) m
            """

        def in_text(points: NDArray, q: NDArray) -> NDArray:
            """Return the distances (n,) of points (n, 3) m and `q`, shape (4,)."""

        def result_without(f: Callable[[NDArray], NDArray]) -> tuple[NDArray, int]:
            """Return something."""

        def _private(a: NDArray) -> NDArray:
            pass
        '''
    ) == [
        "a.py:2 bare(a)",
        "a.py:6 with_entries(d)",
        "a.py:25 result_without → result",
    ]


def test_undocumented_arrays_of_classes():
    assert found(
        '''
        @dataclass(frozen=True)
        class Record:
            """Arrays.

            Parameters
            ----------
            a : (n, 3) m
            """

            a: NDArray
            b: NDArray
            c: NDArray
            """(n,) s, in a docstring of its own."""
            d: ClassVar[NDArray]

        class Base:
            """A base.

            Parameters
            ----------
            start : (n,)
            """

            def __init__(self, start: ArrayLike, end: ArrayLike) -> None:
                pass

            def move(self, by: NDArray) -> NDArray:
                """Return positions (n, 3), moved by (3,)."""

        class Derived(Base):
            def __init__(self, start: ArrayLike) -> None:
                pass

            def move(self, by: NDArray) -> NDArray:
                pass
        '''
    ) == ["a.py:12 Record.b", "a.py:25 Base.__init__(end)"]
