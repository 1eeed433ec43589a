"""The three nodes as processes, connected."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from intuitive_physics_bringup.connections import NODES, module, remappings
from intuitive_physics_experiments.rendering.corner_room import BALL_RADII, ROOM_MATERIAL
from intuitive_physics_experiments.rendering.depth_bag_writer import CAMERA_INFO_TOPIC, DEPTH_TOPIC
from intuitive_physics_ros.node_process import NodeProcess
from intuitive_physics_ros.peer import Peer


class Suite:
    """Starts perception, learner and predictor, and stops them at the end.

    Parameters
    ----------
    database : file in which the learner keeps what it hears
    horizon : s the predictor looks ahead
    log_folder : where each node's output is written when they end
    """

    def __init__(self, database: Path, horizon: float, log_folder: Path) -> None:
        balls = list(BALL_RADII.items())
        parameters: dict[str, list[str]] = {
            "perception_node": [
                "input:=depth",
                f"plane_material:={ROOM_MATERIAL}",
                f"known_object_names:=[{', '.join(name for name, _ in balls)}]",
                f"known_object_radii:=[{', '.join(str(radius) for _, radius in balls)}]",
                f"known_object_materials:=[{', '.join(name for name, _ in balls)}]",
            ],
            # The demo asks for one search, which starts from the same place each time.
            "learner_node": [f"database:={database}", "online:=false"],
            # The bag's stamps are of the day it was rendered.
            "predictor_node": [f"horizon:={horizon}", "carry_forward:=false"],
        }
        inputs = [("~/depth/image", DEPTH_TOPIC), ("~/depth/camera_info", CAMERA_INFO_TOPIC)]
        self._log_folder = log_folder
        self.nodes: dict[str, NodeProcess] = {}
        try:
            for name in NODES:
                renamed = remappings(name) + (inputs if name == "perception_node" else [])
                arguments = [part for value in parameters[name] for part in ("-p", value)]
                arguments += [part for a, b in renamed for part in ("-r", f"{a}:={b}")]
                self.nodes[name] = NodeProcess(module(name), arguments)
        except BaseException:
            self.stop()
            raise

    def wait_until_up(self, peer: Peer) -> None:
        """Wait until all three nodes are seen by others."""

        def all_are_seen() -> bool:
            self.check()
            return set(NODES) <= set(peer.node.get_node_names())

        peer.spin_until(all_are_seen, f"the nodes {', '.join(NODES)}")

    def check(self) -> None:
        """Raise `NodeProcessError` if a node has ended."""
        for process in self.nodes.values():
            process.check_running()

    def stop(self) -> None:
        """Stop all nodes and keep what they wrote."""
        for name, process in self.nodes.items():
            process.stop()
            (self._log_folder / f"{name}.log").write_text(process.output, encoding="utf-8")

    def __enter__(self) -> Suite:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()
