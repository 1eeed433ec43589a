"""From collisions to predictions: what only a ratio of two masses is known of is drawn so."""

from __future__ import annotations

import numpy as np
from benchmarks.learning.mass_ratio import RATIO, measure_mass_ratio


def test_predictions_use_a_mass_ratio_of_which_neither_mass_is_known():
    found = measure_mass_ratio(0, collisions=20, iterations=1000)
    low, high = found.ratio
    assert 0.9 * RATIO < low < RATIO < high < 1.1 * RATIO
    # Each density by itself is known to hardly more than its bounds, which are a factor of 160.
    for ends in (found.heavy, found.light):
        assert np.log(ends[1] / ends[0]) > np.log(20.0)
