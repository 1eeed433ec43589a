"""Update rules of the parameter search (Sec. III-D), with the settings of Table I as defaults."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from intuitive_physics_learner.errors import UnknownMethodError
from intuitive_physics_learner.search.update_rules.cma_es import CmaEs
from intuitive_physics_learner.search.update_rules.grid_and_random_search import (
    GridSearch,
    RandomSearch,
)
from intuitive_physics_learner.search.update_rules.hybrid_search import (
    HybridRandomSearch,
    HybridSearch,
)
from intuitive_physics_learner.search.update_rules.single_point_search import (
    AdaptiveRandomSearch,
    BoundedAdaptiveRandomSearch,
    CoordinateDescent,
    MetropolisHastings,
    ParameterGradientSearch,
)
from intuitive_physics_learner.search.update_rules.update_rule import UpdateRule

__all__ = ["ALL_RULES", "FURTHER_RULES", "UPDATE_RULES", "UpdateRule", "make_update_rule"]

UPDATE_RULES: dict[str, type[UpdateRule]] = {
    rule.name: rule
    for rule in (
        GridSearch,
        RandomSearch,
        CoordinateDescent,
        ParameterGradientSearch,
        AdaptiveRandomSearch,
        HybridSearch,
        HybridRandomSearch,
        MetropolisHastings,
        CmaEs,
    )
}
"""The paper's nine."""

FURTHER_RULES: dict[str, type[UpdateRule]] = {
    rule.name: rule for rule in (BoundedAdaptiveRandomSearch,)
}
"""For what the nine are not made for: a J that is large beside the interval."""

ALL_RULES: dict[str, type[UpdateRule]] = {**UPDATE_RULES, **FURTHER_RULES}
"""The nine and the further ones."""


def make_update_rule(
    name: str,
    size: int,
    generator: np.random.Generator,
    start: ArrayLike | None = None,
    **settings: Any,
) -> UpdateRule:
    """Return the update rule of that name.

    Parameters
    ----------
    name : one of `UPDATE_RULES` or `FURTHER_RULES`
    size : number of parameters n
    generator : the only source of randomness; owned by the rule from now on
    start : (n,) point of the unit cube proposed before all others
    settings : of the rule, instead of its `defaults`

    Raises
    ------
    UnknownMethodError
        When the name is none of these.
    UnknownNameError, InvalidInputError
        When the rule has no such setting, or one is not above zero.
    """
    if name not in ALL_RULES:
        raise UnknownMethodError.among(name, ALL_RULES)
    return ALL_RULES[name](size, generator, start, **settings)
