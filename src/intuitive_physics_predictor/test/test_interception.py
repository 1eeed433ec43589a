"""The best place and time to wait for an object, where one can say which it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.regions import BoxRegion
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.queries.events import best_interception

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
TIMES = np.linspace(0.0, 1.0, 51)


def distribution(paths, weights=None):
    paths = np.asarray(paths, dtype=float)
    weights = np.full(len(paths), 1 / len(paths)) if weights is None else np.asarray(weights)
    return TrajectoryDistribution(("ball",), TIMES, paths[:, None], weights)


def lines(starts, velocities):
    return np.asarray(starts)[:, None] + TIMES[:, None] * np.asarray(velocities)[:, None]


def box(center, size):
    return BoxRegion(center, UPRIGHT, (size,) * 3)


def test_where_paths_cross_is_best():
    # Three balls from different sides that are all at (1, 0, 0) after 0.6 s.
    velocities = np.array([[2.0, 0, 0], [0, 1.5, 0], [1.0, 1.0, 1.0]])
    starts = np.array([1.0, 0, 0]) - 0.6 * velocities
    interception = best_interception(
        distribution(lines(starts, velocities)), "ball", box((1, 0, 0), 1), 0.05
    )
    assert interception.probability == pytest.approx(1.0)
    assert interception.time == pytest.approx(0.6, abs=0.011)
    np.testing.assert_allclose(interception.position, [1, 0, 0], atol=0.05)


def test_the_likelier_of_two_futures_and_never_the_middle():
    # Left with 0.3, right with 0.7: the mean, straight on, is where it never is.
    paths = lines(np.zeros((10, 3)), [[1, -1, 0]] * 3 + [[1, 1, 0]] * 7)
    interception = best_interception(
        distribution(paths), "ball", box((0.8, 0, 0), 2.0), 0.1, earliest=0.5
    )
    assert interception.probability == pytest.approx(0.7)
    assert interception.position[1] > 0.4


def test_interception_is_of_the_heaviest_samples():
    paths = lines(np.zeros((2, 3)), [[1, -1, 0], [1, 1, 0]])
    heavy = distribution(paths, [0.9, 0.1])
    interception = best_interception(heavy, "ball", box((0.8, 0, 0), 2.0), 0.1, earliest=0.5)
    assert interception.probability == pytest.approx(0.9)
    assert interception.position[1] < -0.4


def test_unreachable_object_has_probability_zero():
    interception = best_interception(
        distribution(lines(np.zeros((3, 3)), np.ones((3, 3)))), "ball", box((-5, 0, 0), 1.0), 0.1
    )
    assert interception.probability == 0.0


@given(st.integers(0, 2**31), st.floats(0.02, 0.3), st.floats(0.0, 0.9))
@settings(max_examples=40)
def test_interception_has_the_stated_probability(seed, reach, earliest):
    # In the box, not before the earliest time, and that many samples are really within reach; the
    # position of any sample at any allowed time in the box would be no better.
    rng = np.random.default_rng(seed)
    paths = lines(rng.normal(size=(30, 3)) * 0.2, rng.normal(size=(30, 3)))
    reachable = box((0.3, 0, 0), 0.8)
    interception = best_interception(
        distribution(paths), "ball", reachable, reach, earliest=earliest
    )
    if interception.probability == 0.0:
        return
    assert reachable.contains(interception.position[None])[0]
    assert interception.time >= earliest

    def chance(place, k):
        return (np.linalg.norm(paths[:, k] - place, axis=-1) <= reach).mean()

    k = int(np.searchsorted(TIMES, interception.time - 1e-9))
    assert chance(interception.position, k) == pytest.approx(interception.probability, abs=0.034)
    for _ in range(20):
        sample, other = rng.integers(30), rng.integers(TIMES.size)
        place = paths[sample, other]
        if TIMES[other] >= earliest and reachable.contains(place[None])[0]:
            assert chance(place, other) <= interception.probability + 1e-9


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"reach": 0.0}, "reach"),
        ({"reach": float("nan")}, "reach"),
        ({"earliest": -1.0}, "earliest"),
        ({"earliest": 2.0}, "horizon"),
    ],
)
def test_bad_questions_are_refused(changes, word):
    paths = distribution(lines(np.zeros((1, 3)), np.ones((1, 3))))
    options = {"reach": 0.1, "earliest": 0.0, **changes}
    with pytest.raises(InvalidInputError, match=word):
        best_interception(
            paths, "ball", box((0, 0, 0), 1.0), options["reach"], earliest=options["earliest"]
        )
    with pytest.raises(UnknownNameError):
        best_interception(paths, "cup", box((0, 0, 0), 1.0), 0.1)
