"""The learning benchmark's own functions: what it counts, disturbs and draws."""

from __future__ import annotations

import argparse
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.command import Outcome
from benchmarks.learning.__main__ import LINE, PARTS, run
from benchmarks.learning.attainable import attainable_from, true_fits
from benchmarks.learning.attainable import figures as attainable_figures
from benchmarks.learning.camera import TRUE_RANGES, draw_truth
from benchmarks.learning.disturbances import EARLIEST, LEAST_DEVIATION, Disturber
from benchmarks.learning.disturbed import SHARE, Counts, DisturbedSet, counted, disturbed_set
from benchmarks.learning.disturbed import figures as disturbed_figures
from benchmarks.learning.online import (
    AFTER,
    BEFORE,
    OBSERVATIONS_BEFORE,
    SPACING,
    Drift,
    changing_stream,
    mean_drift,
)
from benchmarks.learning.paper_sets import ball_throws, make_task
from benchmarks.learning.scores import (
    WITHIN,
    Coverage,
    coverage,
    dishonest,
    excess,
    share_within,
)
from benchmarks.learning.sets import figures as set_figures
from benchmarks.learning.stream import StreamCost, growth
from benchmarks.learning.stream import figures as stream_figures
from benchmarks.learning.stream_start import Start
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_experiments.paper.paper_dataset import POSITION_NOISE, make_paper_dataset
from intuitive_physics_experiments.paper.paper_room import ROOM_MATERIAL, dataset_simulator
from intuitive_physics_learner.joint_estimation.observation_blocks import (
    InitialStateDeviations,
    InitialStates,
)

MATERIALS = ("ball", "floor")
"""Of θ_s that are held against the truth."""

costs = st.floats(1e-3, 10.0)


@given(costs, costs, costs, st.floats(0.1, 10.0), st.floats(0.0, 5.0))
def test_excess_is_zero_at_the_truth_and_one_at_the_defaults(oracle, gain, cost, scale, shift):
    default = oracle + gain
    assert excess(oracle, oracle, default) == 0.0
    assert excess(default, oracle, default) == pytest.approx(1.0)
    moved = [scale * each + shift for each in (cost, oracle, default)]
    assert excess(*moved) == pytest.approx(excess(cost, oracle, default), rel=1e-6, abs=1e-6)


def test_excess_where_the_defaults_are_as_good_as_the_truth():
    assert excess(0.03, 0.03, 0.03) == 0.0
    assert excess(0.02, 0.03, 0.01) == 0.0
    assert excess(0.04, 0.03, 0.02) == np.inf


def stated(values: StaticParameters, deviations, intervals=None) -> LearnedParameters:
    identified = ~np.isnan(deviations)
    return LearnedParameters(values, deviations, identified, 1, 0.1, 1, "made up", intervals)


@settings(max_examples=30)
@given(st.floats(0.05, 3.9), st.sampled_from(["density", "rolling_friction", "restitution"]))
def test_errors_are_in_stated_deviations_on_the_scale_of_the_search(sigmas, kind):
    assume(abs(sigmas - WITHIN) > 1e-3)
    space = ParameterSpace(MATERIALS)
    names = parameter_names(MATERIALS)
    axis = next(i for i, name in enumerate(names) if name.startswith(kind))
    found, true = np.full(space.size, 0.5), np.full(space.size, 0.5)
    true[axis] += 0.02 * sigmas
    deviations = np.full(space.size, np.nan)
    deviations[axis] = 0.02 * space.slopes(found)[axis, axis]
    learned = stated(space.to_parameters(found), deviations)
    held = coverage(learned, space.to_parameters(true), np.ones(space.size, dtype=bool))
    assert held.identified == 1
    assert held.active == space.size
    assert held.scores == pytest.approx([-sigmas], rel=1e-3)
    assert held.within == int(sigmas <= WITHIN)


def test_what_is_not_active_or_not_identified_is_not_counted():
    space = ParameterSpace(MATERIALS)
    deviations = np.full(space.size, np.nan)
    deviations[[0, 3]] = 0.1
    active = np.ones(space.size, dtype=bool)
    active[0] = False
    values = StaticParameters.uniform(MATERIALS)
    held = coverage(stated(values, deviations), values, active)
    assert (held.identified, held.active) == (1, space.size - 1)


def test_truth_within_a_one_sided_interval_is_within_two_deviations():
    names = parameter_names(MATERIALS)
    axis = names.index("dynamic_friction[ball, floor]")
    learned = StaticParameters.uniform(MATERIALS, static_friction=0.9, dynamic_friction=0.3)
    true = StaticParameters.uniform(MATERIALS, static_friction=0.9, dynamic_friction=0.8)
    deviations = np.full(len(names), np.nan)
    deviations[axis] = 0.01
    active = np.ones(len(names), dtype=bool)
    assert coverage(stated(learned, deviations), true, active).within == 0
    intervals = np.full((len(names), 2), np.nan)
    intervals[axis] = 0.28, 1.0
    assert coverage(stated(learned, deviations, intervals), true, active).within == 1


def test_shares_are_of_all_identified_parameters_of_all_sets():
    first = Coverage(np.array([0.0, -1.0, 3.0]), np.zeros(3), 5)
    second = Coverage(np.array([-2.5]), np.zeros(1), 7)
    assert share_within([first, second]) == 0.5
    assert share_within([]) is None
    assert dishonest([first, second])[0].startswith("within_2_sigma: 0.500, bar 0.9 to 0.99")
    assert dishonest([])[0].startswith("within_2_sigma: nothing is identified")
    for outside, complaints in ((11, 1), (10, 0), (1, 0), (0, 1)):
        scores = np.where(np.arange(100) < outside, 3.0, 0.0)
        assert len(dishonest([Coverage(scores, np.zeros(100), 100)])) == complaints


def test_within_two_deviations_is_given_for_each_size_and_for_all():
    small = Coverage(np.array([0.0, -1.0, 3.0]), np.array([0.1, 0.2, 0.3]), 5)
    large = Coverage(np.zeros(5), np.zeros(5), 7)
    results = [
        SimpleNamespace(size=size, coverage=covered, excess=0.2, default_excess=1.0)
        for size, covered in (("1x50", small), ("20x50", large))
    ]
    shares = set_figures(results)["within_2_sigma"]
    assert shares == {"1x50": 0.667, "10x50": None, "20x50": 1.0, "all": 0.875}
    assert set_figures([])["within_2_sigma"]["all"] is None
    assert small.mean_error == pytest.approx(0.2)
    assert Coverage(np.zeros(0), np.zeros(0), 3).mean_error is None


def test_early_cost_is_over_the_first_seconds():
    task = make_task(1, 11)
    whole, early = task.exact_cost(), task.exact_cost(1.0)
    for observation, short in zip(whole.observations, early.observations, strict=True):
        times = short.objects[0].trajectory.times - short.start_time
        assert times[-1] <= 1.0 < observation.objects[0].trajectory.times[-1]
    # The mean length of three normal components is 2 √(2 / π).
    (cost,) = early.costs([task.dataset.parameters])
    assert cost == pytest.approx(2.0 * np.sqrt(2.0 / np.pi) * POSITION_NOISE, rel=0.1)


@pytest.fixture(scope="module")
def dataset():
    return make_paper_dataset(1, 15, np.random.default_rng(11))


@pytest.mark.parametrize("kind", ["kicked", "held", "mistracked"])
def test_disturbed_throw_is_the_true_one_first_and_far_from_it_later(dataset, kind):
    disturber = Disturber(dataset.parameters, dataset_simulator("auto"), dataset.training)
    rng = np.random.default_rng(5)
    for true in dataset.training[:4]:
        disturbed = disturber.disturb(true, kind, rng)
        away = np.linalg.norm(disturbed.positions - true.positions, axis=2)[0]
        times = true.observation.objects[0].trajectory.times
        assert away[times < EARLIEST].max() == 0.0
        assert away.max() >= LEAST_DEVIATION
        (seen,) = disturbed.observation.objects
        noise = seen.trajectory.positions - disturbed.positions[0]
        # 453 numbers: their standard deviation is within 5 standard errors of 3.3 %.
        assert noise.std() == pytest.approx(POSITION_NOISE, rel=0.17)
        assert disturbed.scene == true.scene
        assert disturbed.observation.id != true.observation.id


def test_a_fifth_of_the_training_throws_is_disturbed_and_the_rest_untouched(dataset):
    disturbed, kinds = disturbed_set(dataset, np.random.default_rng(2))
    before = {run.observation.id for run in dataset.training}
    after = {run.observation.id for run in disturbed.training}
    assert len(kinds) == round(SHARE * len(dataset.training))
    assert after - before == set(kinds)
    assert disturbed.test == dataset.test
    same, again = disturbed_set(dataset, np.random.default_rng(2))
    assert again == kinds
    assert [each.to_json() for each in same.training_observations] == [
        each.to_json() for each in disturbed.training_observations
    ]


def test_flags_are_counted_against_what_was_disturbed():
    kinds = {"a": "kicked", "b": "held"}
    good = frozenset("cdef")
    assessed = DisturbedSet(1, kinds, good, {"a", "c"}, 0.2, 0.1)
    assert counted([assessed]) == Counts(2, 1, 4, 1)
    assert counted([assessed], "held") == Counts(1, 0, 4, 1)
    assert disturbed_figures([assessed]) == {"excess": 0.2, "flagged": 0.5, "false": 0.25}
    unassessed = DisturbedSet(1, kinds, good, None, 0.2, 0.1)
    assert disturbed_figures([unassessed]) == {"excess": 0.2, "flagged": None, "false": None}


def test_stream_is_the_same_however_much_of_it_is_taken():
    short = [each.to_json() for each in itertools.islice(ball_throws(3), 4)]
    long = [each.to_json() for each in itertools.islice(ball_throws(3), 7)]
    assert long[:4] == short
    assert len(set(long)) == 7


def test_changing_stream_is_of_one_ball_and_the_same_until_the_change():
    stream = list(changing_stream(4, 2))
    assert len(stream) == OBSERVATIONS_BEFORE + 2
    balls = {each.objects[0].object.material for each in stream}
    assert len(balls) == 1
    unchanged = list(changing_stream(4, 0))
    assert [each.id for each in stream[:OBSERVATIONS_BEFORE]] == [each.id for each in unchanged]
    starts = [each.start_time for each in stream]
    assert np.diff(starts) == pytest.approx(SPACING)


def test_change_counts_until_the_published_value_is_near():
    assert Drift(0, (BEFORE, 0.78, AFTER + 0.005, AFTER)).observations == 2.0
    late = Drift(0, (BEFORE, 0.78))
    assert late.observations == np.inf
    assert mean_drift([Drift(0, (BEFORE, AFTER)), Drift(1, (BEFORE, 0.75, AFTER))]) == 1.5
    assert mean_drift([Drift(0, (BEFORE, AFTER)), late]) is None


def test_stream_figures_have_null_for_what_was_not_measured():
    found = {100: StreamCost(100, (0.2, 0.4), 3.0, 250.0), 1000: None}
    start = Start(100_000, 0.2, 0.1, 1.5, 200.0, 900.0)
    assert stream_figures(found, start) == {
        "cpu_s_at": {"100": 0.3, "1000": None},
        "start_s_at_100000": 1.5,
        "rss_mb": 250.0,
    }
    assert growth(found) is None
    assert growth({**found, 1000: StreamCost(1000, (0.6,), 9.0, 300.0)}) == pytest.approx(2.0)


def test_true_initial_states_are_those_that_estimation_calls_so():
    task = make_task(1, 6)
    observed = task.dataset.training_observations[:4]
    true = task.dataset.with_initial_states("true").training_observations[:4]
    for seen, truth, found in zip(observed, true, true_fits(observed, true), strict=True):
        states = InitialStates.of([InitialStateDeviations.of(seen)])
        (tracked,) = truth.objects
        expected = tracked.initial_state.to_vector()
        (reached,) = states.states(found.estimate[None, None], 1)[0, 0]
        # q and -q are one orientation.
        reached[3:7] *= np.sign(reached[3:7] @ expected[3:7])
        np.testing.assert_allclose(reached, expected, atol=1e-9)


def test_draws_about_the_truth_are_better_than_the_defaults():
    one = attainable_from("1x50", 2, make_task(1, 2))
    assert one.horizon > 0.5
    # All points tell more than some of them do, here by far more than 50 draws scatter.
    assert one.all_points < one.up_to_horizons < 1.0
    figures = attainable_figures([one])
    assert figures["1x50"]["all_points"] == pytest.approx(one.all_points, abs=1e-4)
    assert figures["10x50"] is None


@given(st.integers(0, 10_000))
def test_truth_of_a_camera_set_is_one_that_its_engine_can_express(seed):
    material, true = draw_truth(seed)
    pair = true.pair(material, ROOM_MATERIAL)
    assert pair["static_friction"] == pair["dynamic_friction"]
    for name, value in pair.items():
        bounds = TRUE_RANGES[name]
        assert bounds.lower - 1e-12 <= value <= bounds.upper + 1e-12


def test_last_line_has_all_keys_and_the_cost_of_each_part(monkeypatch):
    figures = {"mass_ratio_90": [3.9, 4.1]}
    monkeypatch.setitem(PARTS, "mass_ratio", lambda quick, first_seed: Outcome(key_figures=figures))
    outcome = run(argparse.Namespace(only=["mass_ratio"], quick=True, first_seed=7))
    assert tuple(outcome.key_figures) == LINE
    assert outcome.key_figures["mass_ratio_90"] == [3.9, 4.1]
    assert outcome.key_figures["stream"] is None
    assert [row[0] for row in outcome.tables[-1].rows] == ["mass_ratio"]
    # Those of other seeds stand beside the stored ones, and do not take their place.
    assert outcome.tables[0].columns[-1].heading == "seeds from 7"
    assert outcome.tables[0].rows[0][-1] == "[3.9, 4.1]"
    assert outcome.part == "mass_ratio_seed_7"
