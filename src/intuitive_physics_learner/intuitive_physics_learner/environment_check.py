"""Whether a simulator can express the environments in which observations were made."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_learner.errors import IncompatibleEnvironmentError

PROBE_HEIGHT = 1e3
"""m along the direction against gravity, where a probe touches nothing."""


def check_environments(observations: Sequence[Observation], simulator: Simulator) -> None:
    """Put a lone ball of one of its materials into each environment and look what happens.

    Every engine knows balls, so one that refuses this scene refuses the environment.

    Raises
    ------
    IncompatibleEnvironmentError
        When the simulator refuses one.
    """
    for seen in observations:
        material = seen.objects[0].object.material
        gravity = np.asarray(seen.environment.gravity)
        up = -gravity / max(float(np.linalg.norm(gravity)), 1e-12)
        probe = Scene(
            seen.environment,
            (SceneObject("probe", material, Sphere(0.01)),),
            (ObjectState(PROBE_HEIGHT * up),),
        )
        neutral = StaticParameters.uniform(probe.materials, static_friction=0.4)
        try:
            simulator.rollout([probe], neutral, np.array([0.0, 1e-3]))
        except UnsupportedSceneError as error:
            raise IncompatibleEnvironmentError(
                f"environment of observation {seen.id} cannot be simulated: {error}"
            ) from None
