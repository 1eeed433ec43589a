"""Which package may import which, and where ROS may be imported."""

from __future__ import annotations

from tools.house.import_graph import imports_of
from tools.house.source_tree import Place, SourceModule, SourceTree

LIBRARY = "intuitive_physics"
"""The library, which knows nothing of the others."""

MESSAGES = "intuitive_physics_msgs"
"""The package of messages, services and actions."""

NODE_PLUMBING = "intuitive_physics_ros"
"""What all nodes share."""

ALLOWED_IMPORTS: dict[str, frozenset[str]] = {
    LIBRARY: frozenset(),
    MESSAGES: frozenset(),
    NODE_PLUMBING: frozenset({LIBRARY, MESSAGES}),
    "intuitive_physics_perception": frozenset({LIBRARY}),
    "intuitive_physics_learner": frozenset({LIBRARY}),
    "intuitive_physics_predictor": frozenset({LIBRARY}),
    "intuitive_physics_recordings": frozenset({LIBRARY}),
    "intuitive_physics_cli": frozenset(
        {
            LIBRARY,
            "intuitive_physics_perception",
            "intuitive_physics_learner",
            "intuitive_physics_predictor",
            "intuitive_physics_recordings",
        }
    ),
    "intuitive_physics_experiments": frozenset(
        {
            LIBRARY,
            "intuitive_physics_perception",
            "intuitive_physics_learner",
            "intuitive_physics_predictor",
            "intuitive_physics_recordings",
            "intuitive_physics_cli",
            "intuitive_physics_bringup",
        }
    ),
    "intuitive_physics_bringup": frozenset({LIBRARY, MESSAGES, NODE_PLUMBING}),
    "intuitive_physics_examples": frozenset({MESSAGES}),
}
"""What each package of the suite may import of the others; a package without a row: nothing."""

ALLOWED_IN_NODES = frozenset({MESSAGES, NODE_PLUMBING})
"""What modules in a `nodes/` folder may import besides."""

ROS_PACKAGES = frozenset({NODE_PLUMBING, "intuitive_physics_bringup"})
"""Packages that may import ROS anywhere."""

ROS_NAMES = frozenset({"rclpy", "launch", "launch_ros", "tf2_ros", "ament_index_python"})
"""Python packages of ROS, besides the interfaces."""

ROS_SUFFIXES = ("_msgs", "_srvs", "_interfaces")
"""Endings of the names of packages of messages, services and actions."""


def is_ros(name: str) -> bool:
    """Whether a top-level Python package belongs to ROS; our own messages do."""
    return name in ROS_NAMES or name.endswith(ROS_SUFFIXES)


def upward_imports(tree: SourceTree) -> list[Place]:
    """Imports between packages of `src/` that the layout forbids, and ROS outside its rooms.

    ROS may be imported in a `nodes/` folder, in intuitive_physics_ros and in
    intuitive_physics_bringup; `ALLOWED_IMPORTS` has the rest. Imports for types only count too.
    """
    return [
        module.place(line, f"imports {name}")
        for module in tree.package_modules
        for line, name in _forbidden(module, set(tree.packages) | set(ALLOWED_IMPORTS))
    ]


def _forbidden(module: SourceModule, suite: set[str]) -> list[tuple[int, str]]:
    """Return line and top-level name of each import that a module must not have."""
    ours = {module.package} | ALLOWED_IMPORTS.get(module.package, frozenset())
    if module.in_nodes_folder:
        ours |= ALLOWED_IN_NODES
    ros_allowed = module.in_nodes_folder or module.package in ROS_PACKAGES
    found = set()
    for item in imports_of(module):
        name = item.module.split(".")[0]
        if name not in ours and (name in suite or (is_ros(name) and not ros_allowed)):
            found.add((item.line, name))
    return sorted(found)
