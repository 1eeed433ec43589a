"""What tests learn from: tasks over observations, and observations of other ways."""

from dataclasses import replace

from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.search.learning_task import LearningTask

MATERIALS = ("ball", "floor")
E = parameter_names(MATERIALS).index("restitution[ball, floor]")
"""Index of the restitution among all parameters of these materials."""


def task_of(cost, start=None, space=None):
    """Learn θ_s from the observations of a cost, from a start or from the middle of all ranges."""
    start = start or StaticParameters.uniform(cost.materials)
    influence = parameter_influence(cost.observations, cost.materials)
    return LearningTask(cost, space or ParameterSpace(cost.materials), influence, start)


def rerouted(observation, way, **others):
    """The observation of one object on the way that takes its times (n,) and positions (n, 3)."""
    (thing,) = observation.objects
    times, positions = thing.trajectory.times, thing.trajectory.positions.copy()
    track = Trajectory(times, way(times, positions))
    return replace(observation, objects=(replace(thing, trajectory=track, **others),))
