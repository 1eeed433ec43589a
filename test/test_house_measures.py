"""Each number of `make house`, on a source tree made up for it."""

from __future__ import annotations

import json
import textwrap

import pytest
from tools.house.__main__ import main
from tools.house.measures import MEASURES, measure
from tools.house.source_tree import SourceTree

LIBRARY = "src/intuitive_physics/intuitive_physics"
LEARNER = "src/intuitive_physics_learner/intuitive_physics_learner"


@pytest.fixture
def write(tmp_path):
    """Write a file below the made-up repository; packages get manifest, setup.py and __init__."""

    def write_file(path: str, text: str = "") -> None:
        parts = path.split("/")
        if parts[0] == "src":
            for name in ("package.xml", "setup.py"):
                (tmp_path / "src" / parts[1]).mkdir(parents=True, exist_ok=True)
                (tmp_path / "src" / parts[1] / name).touch()
        target = tmp_path / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(textwrap.dedent(text), encoding="utf-8")

    return write_file


@pytest.fixture
def found(tmp_path):
    """Return the places behind a number of the made-up repository, as `file:line text`."""

    def find(key: str) -> list[str]:
        places = MEASURES[key].places(SourceTree(tmp_path))
        return [f"{place.path.split('/')[-1]}:{place.line} {place.text}" for place in places]

    return find


def test_an_empty_repository_measures_zero(tmp_path):
    assert set(measure(tmp_path).values()) == {0}


def test_largest_folder_counts_modules_directly_in_it(tmp_path, write):
    for name in ("__init__", "a", "b", "c", "inner/d", "inner/e", "inner/deep/f", "inner/deep/g"):
        write(f"{LIBRARY}/{name}.py")
    write("src/intuitive_physics/test/test_a.py")
    assert measure(tmp_path)["largest_folder"] == 3


def test_single_importer_modules(write, found):
    write(f"{LIBRARY}/once.py")
    write(f"{LIBRARY}/twice.py")
    write(f"{LIBRARY}/never.py")
    write(
        f"{LIBRARY}/user.py", "import intuitive_physics.once\nfrom intuitive_physics import twice"
    )
    write(f"{LEARNER}/late.py", "def load():\n    from intuitive_physics.twice import name")
    write("src/intuitive_physics/test/test_once.py", "import intuitive_physics.once")
    assert found("single_importer_modules") == [
        "once.py:1 intuitive_physics.once is imported by intuitive_physics.user only"
    ]


def test_an_importer_is_seen_through_a_package_that_exports_again(write, found):
    write(f"{LIBRARY}/room/__init__.py", "from intuitive_physics.room.inner import Name")
    write(f"{LIBRARY}/room/inner.py")
    assert found("single_importer_modules") == [
        "inner.py:1 intuitive_physics.room.inner is imported by intuitive_physics.room only"
    ]
    write(f"{LIBRARY}/user.py", "from intuitive_physics.room import Name")
    assert found("single_importer_modules") == []


def test_homes_of_entry_points_are_not_single_importer_modules(write, found):
    write(f"{LIBRARY}/command.py")
    write(f"{LIBRARY}/user.py", "from .command import main")
    assert len(found("single_importer_modules")) == 1
    write(
        "src/intuitive_physics/setup.py",
        'setup(entry_points={"console_scripts": ["run = intuitive_physics.command:main"]})',
    )
    assert found("single_importer_modules") == []


def test_largest_argument_list_leaves_out_self_and_fields(tmp_path, write, found):
    write(
        f"{LIBRARY}/a.py",
        """
        @dataclass
        class Many:
            a: int
            b: int
            c: int
            d: int
            e: int

            def method(self, a, /, b, *, c):
                pass

            @classmethod
            def build(cls, a):
                pass

            @staticmethod
            def free(a, b):
                pass

        def function(a, *rest, b=1, **others):
            pass
        """,
    )
    assert measure(tmp_path)["largest_argument_list"] == 4
    assert found("largest_argument_list") == [
        "a.py:21 function has 4 parameters",
        "a.py:10 method has 3 parameters",
        "a.py:18 free has 2 parameters",
        "a.py:14 build has 1 parameters",
    ]


def test_longest_function_leaves_out_decorators_and_docstring(tmp_path, write):
    write(
        f"{LIBRARY}/a.py",
        '''
        @cache
        def long(
            a,
        ):
            """One line.

            Two lines.
            """
            b = a
            return b
        ''',
    )
    assert measure(tmp_path)["longest_function"] == 5


def test_readme_lines(tmp_path, write):
    write("README.md", "one\n\nthree\n")
    assert measure(tmp_path)["readme_lines"] == 3


def test_undocumented_arrays_of_functions(write, found):
    write(
        f"{LIBRARY}/a.py",
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
        ''',
    )
    assert found("undocumented_arrays") == [
        "a.py:2 bare(a)",
        "a.py:6 with_entries(d)",
        "a.py:25 result_without → result",
    ]


def test_undocumented_arrays_of_classes(write, found):
    write(
        f"{LIBRARY}/a.py",
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
        ''',
    )
    assert found("undocumented_arrays") == ["a.py:12 Record.b", "a.py:25 Base.__init__(end)"]


def test_module_constants_without_docstring(write, found):
    write(
        f"{LIBRARY}/a.py",
        '''
        # A comment is no docstring.
        BARE = 1.0
        _BARE, OTHER = 1, 2
        TOLD: float = 1e-9
        """What it is."""
        BODY = np.dtype([("x", "f8")])
        __all__ = ["BARE"]
        T = TypeVar("T")
        Alias = dict[str, int]

        def function():
            INSIDE = 1
        ''',
    )
    assert found("module_constants_without_docstring") == ["a.py:3 BARE", "a.py:4 _BARE, OTHER"]


def test_upward_imports_between_packages(write, found):
    write(f"{LIBRARY}/a.py", "from intuitive_physics_learner.a import b")
    write(f"{LEARNER}/a.py", "import intuitive_physics.a\nimport intuitive_physics_predictor.a")
    write("src/intuitive_physics_new/intuitive_physics_new/a.py", "import intuitive_physics.a")
    assert found("upward_imports") == [
        "a.py:1 imports intuitive_physics_learner",
        "a.py:2 imports intuitive_physics_predictor",
        "a.py:1 imports intuitive_physics",
    ]


def test_ros_is_imported_by_folder(write, found):
    text = "import rclpy\nfrom std_msgs.msg import Header\nimport intuitive_physics_ros.qos"
    write(f"{LEARNER}/learner_node.py", text)
    write(f"{LEARNER}/nodes/learner_node.py", text)
    write("src/intuitive_physics_ros/intuitive_physics_ros/qos.py", "import rclpy")
    assert found("upward_imports") == [
        "learner_node.py:1 imports rclpy",
        "learner_node.py:2 imports std_msgs",
        "learner_node.py:3 imports intuitive_physics_ros",
    ]


def test_circles_are_found_through_late_imports_and_packages(write, found):
    write(f"{LIBRARY}/a.py", "def late():\n    import intuitive_physics.room.deep")
    write(f"{LIBRARY}/room/__init__.py", "import intuitive_physics.a")
    write(f"{LIBRARY}/room/deep.py", "from intuitive_physics.b import name")
    write(f"{LIBRARY}/b.py")
    write("benchmarks/c.py", "from benchmarks import d")
    write("benchmarks/d.py", "if TYPE_CHECKING:\n    import benchmarks.c")
    assert found("circles") == ["a.py:1 intuitive_physics.a ↔ intuitive_physics.room"]
    write("benchmarks/d.py", "import benchmarks.c")
    assert found("circles")[0] == "c.py:1 benchmarks.c ↔ benchmarks.d"


def test_a_package_that_exports_its_modules_is_no_circle(write, found):
    write(f"{LIBRARY}/room/__init__.py", "from intuitive_physics.room.a import name")
    write(f"{LIBRARY}/room/a.py", "from intuitive_physics.room.b import name")
    write(f"{LIBRARY}/room/b.py")
    assert found("circles") == []


def test_main_prints_one_json_line_or_the_places(tmp_path, write, capsys):
    write(f"{LIBRARY}/a.py", "SIZE = 1")
    main([], tmp_path)
    line = capsys.readouterr().out
    assert line.count("\n") == 1
    assert list(json.loads(line)) == [
        "largest_folder",
        "single_importer_modules",
        "largest_argument_list",
        "longest_function",
        "readme_lines",
        "undocumented_arrays",
        "module_constants_without_docstring",
        "upward_imports",
        "circles",
    ]
    main(["--details", "module_constants_without_docstring"], tmp_path)
    assert capsys.readouterr().out == f"{LIBRARY}/a.py:1 SIZE\n"
