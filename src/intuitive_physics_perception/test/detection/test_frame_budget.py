"""A frame's time for hypotheses: what is followed comes first, and nothing waits for ever."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from intuitive_physics_perception.detection.fitted_sphere import Start
from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.detection.solids import SolidFinder
from intuitive_physics_perception.detection.spheres import SphereFinder
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

from ..conftest import BoxShape

SETTINGS = PerceptionSettings()
NEAR, FAR = np.array([1.2, -0.2, 0.5]), np.array([1.4, 0.3, 0.5])


@pytest.fixture
def frame(corner_model):
    """Two balls in the air: their frame, its clusters, and where they are in the sensor's frame."""
    room, model = corner_model
    points = room.points([(NEAR, 0.06), (FAR, 0.06)])
    clusters = ForegroundFinder(model, SETTINGS).find(points)
    places = [np.append((place - room.origin) @ room.rotation, 0.06) for place in (NEAR, FAR)]
    return model, points, clusters, places


def spent() -> FrameBudget:
    """A budget that is over."""
    return FrameBudget(0.0)


def centres(parts) -> list[np.ndarray]:
    return [sphere.center for part in parts for sphere in part.spheres]


class Clock:
    """Shows the time that it is set to, in s."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def time_of_hypotheses(budget: FrameBudget, clock: Clock) -> float:
    """Let a frame's hypotheses begin now; return how long they have, in s, to 0.01 s."""
    budget.begin()
    begun = clock.now
    while not budget.is_spent:
        clock.now += 0.01
    return clock.now - begun


def test_without_a_limit_time_is_never_over() -> None:
    assert not FrameBudget().is_spent


@pytest.mark.parametrize(("before", "left"), [(0.0, 10.0), (3.0, 7.0), (30.0, 4.0)])
def test_what_was_spent_before_counts_but_a_part_is_left_in_any_case(before, left) -> None:
    clock = Clock()
    budget = FrameBudget(10.0, clock)
    budget.begin_frame()
    clock.now += before
    assert time_of_hypotheses(budget, clock) == pytest.approx(left, abs=0.02)


@pytest.mark.parametrize(("step", "kept_free"), [(2.0, 2.0), (9.0, 5.0)])
def test_hypotheses_end_earlier_by_a_step_unless_they_are_urgent(step, kept_free) -> None:
    clock = Clock()
    budget = FrameBudget(10.0, clock)
    clock.now += step
    assert not budget.is_spent
    budget.begin_frame()
    assert time_of_hypotheses(budget, clock) == pytest.approx(10.0 - kept_free, abs=0.02)
    budget.is_urgent = True
    assert not budget.is_spent
    clock.now += kept_free
    assert budget.is_spent


def test_a_long_step_is_forgotten_frame_by_frame() -> None:
    clock = Clock()
    budget = FrameBudget(10.0, clock)
    clock.now += 2.0
    assert not budget.is_spent
    times = []
    for _ in range(30):
        budget.begin_frame()
        times.append(time_of_hypotheses(budget, clock))
    assert (np.diff(times) > 0.0).all()
    assert times[-1] > 9.8


def test_what_follows_on_hypotheses_counts_by_its_mean_time() -> None:
    clock = Clock()
    budget = FrameBudget(10.0, clock)
    for _ in range(60):
        budget.begin_frame()
        budget.begin()
        budget.end()
        clock.now += 3.0
        budget.end_frame()
    budget.begin_frame()
    assert time_of_hypotheses(budget, clock) == pytest.approx(7.0, abs=0.05)


def test_what_is_followed_is_found_when_the_time_is_over(frame) -> None:
    model, points, clusters, (near, _) = frame
    finder = SphereFinder(model, SETTINGS, np.random.default_rng(0))
    budget = spent()
    found = centres(finder.find(points, clusters, [Start(near)], budget))
    assert len(found) == 1
    assert found[0] == pytest.approx(near[:3], abs=0.01)
    assert budget.waiting == len(clusters.indices) - 1


def test_what_had_to_wait_is_found_in_the_next_frame(frame) -> None:
    model, points, clusters, places = frame
    finder = SphereFinder(model, SETTINGS, np.random.default_rng(0))
    assert centres(finder.find(points, clusters, budget=spent())) == []
    assert len(centres(finder.find(points, clusters))) == len(places)


def test_a_solid_that_has_to_wait_stays_what_it_was(corner_model) -> None:
    room, model = corner_model
    points = room.points([], (BoxShape((1.3, 0.0, 0.15), (0.2, 0.25, 0.3), 0.4),))
    clusters = ForegroundFinder(model, SETTINGS).find(points).indices
    finder = SolidFinder(model, SETTINGS, np.random.default_rng(0))
    assert finder.find(points, clusters, spent()) == [None] * len(clusters)
    (box,) = [solid for solid in finder.find(points, clusters) if solid is not None]
    assert box in finder.find(points, clusters, spent())


def test_a_thrown_ball_is_followed_where_each_frame_has_next_to_no_time(make_room) -> None:
    # Each look at the clock takes 1 ms: time is over after the first clusters.
    ticks = itertools.count()
    room = make_room()
    clutter = tuple(
        BoxShape((x, y, 0.05), (0.08, 0.08, 0.1), 0.3)
        for x in (1.5, 1.8, 2.1)
        for y in (-0.6, 0.0, 0.6)
    )
    with ThreadPoolExecutor(1) as background:
        pipeline = PerceptionPipeline(
            PerceptionSettings(environment_frames=3),
            np.random.default_rng(0),
            clock=lambda: 0.001 * next(ticks),
            background=background,
        )
        for k in range(3):
            pipeline.process(room.points(), k / 30)
        ids, waited = [], 0
        for k in range(12):
            place = np.array([1.2, -0.4 + 2.0 * k / 30, 0.5 + 1.5 * k / 30 - 4.9 * (k / 30) ** 2])
            result = pipeline.process(room.points([(place, 0.06)], clutter), (3 + k) / 30)
            ids.append([item.object.id for item in result.objects])
            waited += result.diagnostics.waiting
    assert waited > 0
    assert sum(len(names) == 1 for names in ids[4:]) == len(ids[4:])
