"""What continues exactly from plain data, as that which is stored of a search that was stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, ClassVar

import numpy as np


class Resumable:
    """Continues from its state, plain data of the attributes that `remembered` names."""

    remembered: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """Return plain data from which one like this continues exactly."""
        return state_of(self, self.remembered)

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        restore(self, self.remembered, state)


def state_of(owner: object, names: Sequence[str]) -> dict[str, Any]:
    """Return attributes as plain data, by their names without the first underscore."""
    return {name.lstrip("_"): _plain(getattr(owner, name)) for name in names}


def restore(owner: object, names: Sequence[str], state: Mapping[str, Any]) -> None:
    """Set attributes to what `state_of` returned; a list becomes an array unless one is there."""
    for name in names:
        value, present = state[name.lstrip("_")], getattr(owner, name)
        if value is None and isinstance(present, float):
            value = np.inf
        elif isinstance(value, list) and not isinstance(present, list):
            value = np.array(value, dtype=getattr(present, "dtype", None))
        setattr(owner, name, copy(value))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    # JSON has no infinity.
    return None if isinstance(value, float) and np.isinf(value) else copy(value)
