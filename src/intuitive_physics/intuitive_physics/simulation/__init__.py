"""Simulators: one interface, several engines, always over a batch of worlds."""

from intuitive_physics.simulation.choose import ENGINE_GUIDE, SIMULATORS, make_simulator, simulate
from intuitive_physics.simulation.rollout import Rollout, WorldStatus
from intuitive_physics.simulation.simulator import Simulator
from intuitive_physics.simulation.world_batch import WorldBatch, pack_worlds

__all__ = [
    "ENGINE_GUIDE",
    "SIMULATORS",
    "Rollout",
    "Simulator",
    "WorldBatch",
    "WorldStatus",
    "make_simulator",
    "pack_worlds",
    "simulate",
]
