"""Pairs are as many as can be and the cheapest together: checked against trying all."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intuitive_physics_perception.tracking.tracker import cheapest_pairs

COSTS = arrays(
    np.float64,
    st.tuples(st.integers(0, 4), st.integers(0, 4)),
    elements=st.one_of(st.floats(0.0, 100.0), st.just(np.inf)),
)


def best_by_trying_all(costs):
    """(number of pairs, their cost) of the best assignment."""
    costs = costs if costs.shape[0] <= costs.shape[1] else costs.T
    best = (0, 0.0)
    for columns in permutations(range(costs.shape[1]), costs.shape[0]):
        chosen = [c for c in costs[range(costs.shape[0]), columns] if np.isfinite(c)]
        best = max(best, (len(chosen), -sum(chosen)))
    return best


@given(COSTS)
def test_pairs_are_the_most_and_of_these_the_cheapest(costs) -> None:
    pairs = cheapest_pairs(costs)
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    chosen_costs = [costs[pair] for pair in pairs]
    assert np.isfinite(chosen_costs).all()
    count, negative = best_by_trying_all(costs)
    assert len(pairs) == count
    assert abs(sum(chosen_costs) + negative) < 1e-9


def test_the_nearest_pair_yields_where_that_leaves_another_alone() -> None:
    # Greedy pairing takes (0, 0) first and leaves the second without a partner.
    assert cheapest_pairs(np.array([[1.0, 4.0], [2.0, np.inf]])) == [(0, 1), (1, 0)]
