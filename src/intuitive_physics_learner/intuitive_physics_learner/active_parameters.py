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


def active_parameters(
    observations: Sequence[Observation], materials: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether J can depend on each parameter, shape (|θ_s|,), in the order of `parameter_names`.

    A pair can matter where an object of one material is in a scene with an object or a static part
    of the other. A density can matter where an object is not alone: that of a lone object cancels
    from its equation of motion, as static parts do not move.
    """
    meeting: set[frozenset[str]] = set()
    together: set[str] = set()
    for seen in observations:
        own = [thing.object.material for thing in seen.objects]
        for i, material in enumerate(own):
            others = own[:i] + own[i + 1 :]
            meeting |= {frozenset((material, other)) for other in others}
            meeting |= {frozenset((material, other)) for other in seen.environment.materials}
        if len(own) > 1:
            together |= set(own)
    pairs = [frozenset(pair) in meeting for pair in material_pairs(materials)]
    densities = [name in together for name in materials]
    return np.array([*densities, *np.repeat(pairs, len(PAIR_COEFFICIENTS))], dtype=bool)


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

    def to_parameters(self, unit: ArrayLike) -> StaticParameters:
        """Map a point of the cube, shape (size,), to θ_s."""
        whole = self._unit.copy()
        whole[self._active] = unit
        return self._space.to_parameters(whole)

    def to_unit(self, parameters: StaticParameters) -> NDArray[np.float64]:
        """Map θ_s to the cube, shape (size,)."""
        return self._space.to_unit(parameters)[self._active]
