"""Which parameters can matter to an observation at all.

Most of θ_s belongs to pairs of materials that never stand in one scene, above all to pairs of two
static parts of the environment: J cannot depend on them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, material_pairs
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment, SceneObject


def parameter_influence(
    observations: Sequence[Observation], materials: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether each observation can depend on each parameter, shape (n_observations, |θ_s|)."""
    worlds = [
        (observation.environment, [observed.object for observed in observation.objects])
        for observation in observations
    ]
    return influence_on_worlds(worlds, materials)


def influence_on_worlds(
    worlds: Sequence[tuple[Environment, Sequence[SceneObject]]], materials: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether the motion in each world can depend on each parameter, shape (n_worlds, |θ_s|).

    A pair can matter where an object of one material is in a scene with an object or a static part
    of the other. A density can matter where an object is not alone: that of a lone object cancels
    from its equation of motion, as static parts do not move. (Air acts on a lone object as well,
    the more the lighter it is.)

    The parameters are in the order of `parameter_names`.
    """
    place = {frozenset(pair): k for k, pair in enumerate(material_pairs(materials))}
    index = {name: i for i, name in enumerate(materials)}
    pairs = np.zeros((len(worlds), len(place)), dtype=bool)
    densities = np.zeros((len(worlds), len(materials)), dtype=bool)
    for row, (environment, objects) in enumerate(worlds):
        for i, body in enumerate(objects):
            near = [other.material for other in (*objects[:i], *objects[i + 1 :])]
            for material in (*near, *environment.materials):
                pairs[row, place[frozenset((body.material, material))]] = True
            densities[row, index[body.material]] |= bool(near) or body.has_air_forces
    return np.hstack([densities, np.repeat(pairs, len(PAIR_COEFFICIENTS), axis=1)])


def active_parameters(
    observations: Sequence[Observation], materials: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether J can depend on each parameter, shape (|θ_s|,), as `parameter_influence`."""
    return np.asarray(parameter_influence(observations, materials).any(axis=0))
