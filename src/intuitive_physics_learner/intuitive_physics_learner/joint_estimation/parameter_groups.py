"""Parameters that share no observation, which one simulation of all observations can move at once.

Curtis, Powell and Reid (1974), *On the estimation of sparse Jacobian matrices*: columns of a
Jacobian without a common row are found by one difference together. Here a row is an observation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def separate_groups(influence: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Part parameters into groups of which no two members influence the same observation.

    Greedy, those that influence most first.

    Parameters
    ----------
    influence : (n_observations, n_parameters) bool

    Returns
    -------
    Groups of indices of parameters; those that influence nothing are in none.
    """
    taken: list[NDArray[np.bool_]] = []
    groups: list[list[int]] = []
    reach = influence.sum(axis=0)
    for parameter in np.argsort(-reach, kind="stable")[: np.count_nonzero(reach)]:
        column = influence[:, parameter]
        for group, occupied in zip(groups, taken, strict=True):
            if not (occupied & column).any():
                group.append(int(parameter))
                occupied |= column
                break
        else:
            groups.append([int(parameter)])
            taken.append(column.copy())
    return [np.array(group) for group in groups]
