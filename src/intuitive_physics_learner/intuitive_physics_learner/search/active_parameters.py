"""Which parameters can matter to a set of observations at all, and a search among only those.

Most of θ_s belongs to pairs of materials that never stand in one scene, above all to pairs of two
static parts of the environment. J cannot depend on them, so leaving them out changes nothing but
the size of the search.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, StaticParameters, material_pairs
from intuitive_physics.observation import Observation
from intuitive_physics.parameter_space import ParameterSpace


def parameter_influence(
    observations: Sequence[Observation], materials: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether each observation can depend on each parameter, shape (n_observations, |θ_s|).

    A pair can matter where an object of one material is in a scene with an object or a static part
    of the other. A density can matter where an object is not alone: that of a lone object cancels
    from its equation of motion, as static parts do not move. (Air acts on a lone object as well,
    the more the lighter it is.)

    The parameters are in the order of `parameter_names`.
    """
    place = {frozenset(pair): k for k, pair in enumerate(material_pairs(materials))}
    index = {name: i for i, name in enumerate(materials)}
    pairs = np.zeros((len(observations), len(place)), dtype=bool)
    densities = np.zeros((len(observations), len(materials)), dtype=bool)
    for row, seen in enumerate(observations):
        things = [observed.object for observed in seen.objects]
        for i, thing in enumerate(things):
            near = [other.material for other in things[:i] + things[i + 1 :]]
            for material in (*near, *seen.environment.materials):
                pairs[row, place[frozenset((thing.material, material))]] = True
            in_air = thing.drag_coefficient > 0.0 or thing.magnus_coefficient > 0.0
            densities[row, index[thing.material]] |= bool(near) or in_air
    return np.hstack([densities, np.repeat(pairs, len(PAIR_COEFFICIENTS), axis=1)])


def active_parameters(
    observations: Sequence[Observation], materials: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether J can depend on each parameter, shape (|θ_s|,), as `parameter_influence`."""
    return np.asarray(parameter_influence(observations, materials).any(axis=0))


class ActiveSpace:
    """The unit cube of the active parameters; the others stay what they are.

    Parameters
    ----------
    space : of all parameters
    active : (|θ_s|,) bool
    others : θ_s that those not active are taken from
    """

    def __init__(
        self, space: ParameterSpace, active: NDArray[np.bool_], others: StaticParameters
    ) -> None:
        self._space = space
        self._active = active
        self._unit = space.to_unit(others)

    @property
    def size(self) -> int:
        """Number of active parameters."""
        return int(self._active.sum())

    @property
    def names(self) -> list[str]:
        """Name of each axis, as `parameter_names`."""
        return [n for n, active in zip(self._space.names, self._active, strict=True) if active]

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the cube, shape (size,), to θ_s."""
        whole = self._unit.copy()
        whole[self._active] = unit
        return self._space.to_parameters(whole)

    def to_unit(self, parameters: StaticParameters) -> NDArray[np.float64]:
        """Map θ_s to the cube, shape (size,)."""
        return self._space.to_unit(parameters)[self._active]
