"""Simulations end when their flag is set, whatever they simulate and however long."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from intuitive_physics.errors import SimulationStoppedError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.bullet import BulletSimulator
from intuitive_physics.simulation.core.engines import EventDrivenSimulator, SteppedSimulator
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.state import ObjectState

ELASTIC = StaticParameters.uniform(
    ["any"], static_friction=0.0, dynamic_friction=0.0, rolling_friction=0.0, restitution=1.0
)
FOREVER = [1e9]
"""s: years of computing."""


def bouncing(shape, count=5):
    """Objects that bounce without end."""
    return Scene(
        Environment([Plane("floor", "any", (0, 0, 1), 0.0)]),
        tuple(SceneObject(f"object {i}", "any", shape) for i in range(count)),
        tuple(ObjectState((0.3 * i, 0, 0.5 + 0.1 * i)) for i in range(count)),
    )


BOXES, BALLS = bouncing(Box((0.1, 0.12, 0.14))), bouncing(Sphere(0.05))


@pytest.mark.parametrize(
    ("simulator", "scene"),
    [
        (SteppedSimulator(), BOXES),
        (SteppedSimulator(), BALLS),
        (SteppedSimulator(threads=2), BOXES),
        (EventDrivenSimulator(max_events=10**15), BALLS),
        (EventDrivenSimulator(max_events=10**15, threads=2), BALLS),
        (EventDrivenSimulator(), BOXES),
        (BulletSimulator(), bouncing(Sphere(0.05), 1)),
    ],
)
def test_a_flag_ends_what_would_take_years(simulator, scene):
    flag = StopFlag()
    threading.Timer(0.05, flag.set).start()
    with pytest.raises(SimulationStoppedError):
        simulator.stopped_by(flag).rollout([scene] * 200, ELASTIC, FOREVER)


@pytest.mark.parametrize("name", ["auto", "stepped", "event_driven"])
def test_a_flag_that_is_not_set_changes_nothing(name):
    simulator, times = make_simulator(name), np.linspace(0.0, 1.0, 11)
    plain = simulator.rollout([BALLS], ELASTIC, times)
    flagged = simulator.stopped_by(StopFlag()).rollout([BALLS], ELASTIC, times)
    np.testing.assert_array_equal(flagged.positions, plain.positions)
    np.testing.assert_array_equal(flagged.orientations, plain.orientations)


def test_the_flag_of_one_simulator_leaves_the_one_it_came_from_alone():
    simulator, flag = make_simulator("auto"), StopFlag()
    flag.set()
    with pytest.raises(SimulationStoppedError):
        simulator.stopped_by(flag).rollout([BALLS], ELASTIC, [1.0])
    assert np.isfinite(simulator.rollout([BALLS], ELASTIC, [1.0]).positions).all()
