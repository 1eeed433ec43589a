"""The states of all objects of a scene, each by everything seen of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics.observation import Detections
from intuitive_physics.scene import SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.estimation.object_estimate import ObjectEstimate, Surroundings
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates


class SceneEstimate:
    """Follows the spheres of a scene, from frame to frame.

    The orientation of boxes and capsules is perceived, and so is how they turn.

    Parameters
    ----------
    rng : of all samples
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._surroundings: Surroundings | None = None
        self._followed: dict[str, ObjectEstimate] = {}

    def update(
        self,
        surroundings: Surroundings,
        objects: Sequence[SceneObject],
        states: Sequence[ObjectState],
        time: float,
        detections: Sequence[Detections | None],
    ) -> tuple[WeightedStates | None, ...]:
        """Take a frame, and return the states of each object at its time.

        Parameters
        ----------
        surroundings : that the objects move in
        objects : all that are tracked
        states : of each, as perceived
        time : s, of the states
        detections : new ones of each; None where there are none

        Returns
        -------
        None for an object whose perceived state is all there is
        """
        kept = {thing.id: self._followed.get(thing.id) for thing in objects}
        self._followed = {name: each for name, each in kept.items() if each is not None}
        is_new = surroundings is not self._surroundings
        self._surroundings = surroundings
        found: list[WeightedStates | None] = []
        for thing, state, seen in zip(objects, states, detections, strict=True):
            if not isinstance(thing.shape, Sphere):
                found.append(None)
                continue
            estimate = self._followed.setdefault(thing.id, ObjectEstimate(self._rng))
            if is_new:
                estimate.renew(surroundings, thing)
            estimate.update(surroundings, thing, state, time, seen)
            found.append(estimate.states)
        return tuple(found)
