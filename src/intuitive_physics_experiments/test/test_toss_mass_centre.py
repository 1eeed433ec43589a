"""The centre of mass of a tossed cube, learned from how it flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_experiments.recorded_sets.cube_tosses import CubeToss, cube_tosses
from intuitive_physics_experiments.recorded_sets.recorded_data import load_cube_tosses
from intuitive_physics_experiments.recorded_sets.toss_evaluation import evaluate_tosses
from intuitive_physics_experiments.recorded_sets.toss_mass_centre import (
    fit_mass_centre,
    with_mass_centre,
)
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.convergence import ConvergenceCriteria

TossArrays = Callable[..., dict[str, Any]]


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-0.03, 0.03)] * 3))
def test_the_centre_that_made_the_flights_is_found(toss_arrays, mass_centre):
    # Free flight of `stepped` is exact to rounding; a fall of 0.1 m takes 14 rows of 10 ms.
    fit = fit_mass_centre(cube_tosses(toss_arrays(5, "stepped", mass_centre=mass_centre)))
    assert fit.mass_centre == pytest.approx(mass_centre, abs=1e-6)


def test_the_deviation_is_that_of_the_noise(toss_arrays):
    # (c - c_true) / σ has mean square 1, and σ of 30 flights is itself good to √(2/30) in its
    # square; of 120, √(2/120) more: within 4 of both together 0.4 to 2 (false alarm 1e-4).
    centre = (0.004, -0.002, 0.006)
    tosses = cube_tosses(toss_arrays(30, "stepped", mass_centre=centre))
    rng = np.random.default_rng(5)
    pulls = []
    for _ in range(40):
        fit = fit_mass_centre([noisy(toss, rng) for toss in tosses])
        pulls.append((fit.mass_centre - centre) / fit.deviation)
    assert 0.4 < np.mean(np.square(pulls)) < 2.0


def noisy(toss: CubeToss, rng: np.random.Generator) -> CubeToss:
    (seen,) = toss.observation.objects
    path = seen.trajectory
    moved = Trajectory(path.times, path.positions + rng.normal(0.0, 5e-4, path.positions.shape))
    objects = (replace(seen, trajectory=moved),)
    return replace(toss, observation=replace(toss.observation, objects=objects))


def test_tosses_that_tell_nothing_are_refused(toss_arrays):
    toss = cube_tosses(toss_arrays(1, "stepped"))[0]
    (seen,) = toss.observation.objects
    few = Trajectory(seen.trajectory.times[:5], seen.trajectory.positions[:5])
    objects = (replace(seen, trajectory=few),)
    short = replace(
        toss,
        observation=replace(toss.observation, objects=objects),
        orientations=toss.orientations[:5],
    )
    with pytest.raises(InvalidInputError, match="no toss flies for 6 rows"):
        fit_mass_centre([short])
    unturned = replace(toss, orientations=np.tile(toss.orientations[:1], (60, 1)))
    for tosses in ([unturned] * 4, [toss]):
        with pytest.raises(InvalidInputError, match="3 or more that turn"):
            fit_mass_centre(tosses)


def test_a_lopsided_cube_is_predicted_better_with_its_centre_of_mass(toss_arrays):
    tosses = cube_tosses(toss_arrays(8, "stepped", mass_centre=(0.0, 0.006, 0.0)))
    options = LearningOptions(
        method="cma_es", criteria=ConvergenceCriteria(max_iterations=60), seed=2
    )
    plain, better = (
        evaluate_tosses(tosses, ["stepped"], options, 0.5, learn_mass_centre=learn)
        for learn in (False, True)
    )
    assert plain.mass_centre is None
    assert better.mass_centre is not None
    for part in range(2):
        errors = [e.fits["stepped"].fitted[part].position.mean() for e in (plain, better)]
        assert errors[1] < 0.5 * errors[0]


@pytest.mark.needs("recordings")
def test_the_recorded_cube_is_heavier_on_one_side(recording):
    # Two halves of the flights tell the same place, some 5 mm from the centre; and the cube comes
    # to rest on that side more often than on the other.
    tosses = load_cube_tosses(recording("cube_tosses.npz"))
    halves = [fit_mass_centre(tosses[start::2]) for start in (0, 1)]
    apart = halves[0].mass_centre - halves[1].mass_centre
    assert np.all(np.abs(apart) < 4.0 * np.hypot(halves[0].deviation, halves[1].deviation))
    centre = fit_mass_centre(tosses).mass_centre
    assert 0.004 < np.linalg.norm(centre) < 0.007
    heavy = int(np.argmax(np.abs(centre)))
    (cube,) = with_mass_centre(tosses[0], centre).observation.objects
    assert cube.object.mass_centre[heavy] == centre[heavy]
    last = np.array([toss.orientations[-1] for toss in tosses])
    x, y, z, w = last.T
    upwards = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    sides = np.sign(centre[heavy]) * upwards[heavy]
    assert np.sum(sides < -0.99) > 1.3 * np.sum(sides > 0.99)
