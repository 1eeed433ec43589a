"""What tests learn from: tasks over observations, and observations of other ways."""

from dataclasses import replace

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.online import OnlineLearner, OnlineOptions, OnlineState
from intuitive_physics_learner.search.learning_task import LearningTask
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    VELOCITY_STEP,
    moved,
    states_at,
)

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


FLOOR = Environment([Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0)])
"""A floor alone."""


def box_throws(simulator, parameters, count, noise, generator):
    """Throws of a box of the material "ball" that tumbles over a floor for two seconds.

    Returns observations, with initial states that err by their deviations, and the true states
    (count, 61, 13) at all times.
    """
    thing = SceneObject("box", "ball", Box((0.15, 0.2, 0.3)))
    times = np.arange(61) / 30.0
    deviations = np.repeat([0.003, 0.03, 0.02, 0.2], 3)
    observations, states = [], []
    for number in range(count):
        turn = generator.normal(size=4)
        true = ObjectState(
            [0.0, 0.0, generator.uniform(0.5, 0.9)],
            turn / np.linalg.norm(turn),
            [*generator.uniform(0.5, 2.0, 2), generator.uniform(-0.5, 0.5)],
            generator.normal(0.0, 3.0, 3),
        )
        after = times + VELOCITY_STEP
        every = np.sort(np.concatenate([times, after]))
        rollout = simulator.rollout([Scene(FLOOR, (thing,), (true,))], parameters, every)
        states.append([states_at(rollout, np.array([2 * k]))[0, 0] for k in range(times.size)])
        seen = rollout.positions[0, 0, ::2] + generator.normal(0.0, noise, (times.size, 3))
        wrong = moved(true.to_vector(), generator.normal(0.0, deviations))
        believed = replace(ObjectState.from_vector(wrong), covariance=np.diag(deviations**2))
        track = ObservedObject(thing, Trajectory(times, seen), believed)
        observations.append(Observation(FLOOR, (track,), 0.0, id=f"throw_{number}"))
    return observations, np.array(states)


class StorelessLearner(OnlineLearner):
    """Keeps all observations itself."""

    def __init__(self, simulator, options=None, state=None, seen=()):
        self.seen = {observation.id: observation for observation in seen}
        super().__init__(
            simulator,
            options or OnlineOptions(),
            state or OnlineState(),
            lambda ids: [self.seen[name] for name in ids if name in self.seen],
        )

    def learn_from_all(self, observations, *others, **named):
        self.seen |= {observation.id: observation for observation in observations}
        return super().learn_from_all(observations, *others, **named)

    def learn_from(self, observation):
        """Learn from one more observation; return the newest published θ_s."""
        self.learn_from_all([observation])
        return self.state.published or LearnedParameters.defaults(observation.materials)
