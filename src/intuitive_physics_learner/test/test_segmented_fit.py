"""Throws cut into segments: their equations, how they go on, and the θ_s that they lead to."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner import ConvergenceCriteria, TrajectoryCost
from intuitive_physics_learner.joint_estimation.joint_fit import (
    FIXED_HORIZONS,
    JointEstimationSettings,
    JointFit,
)
from intuitive_physics_learner.joint_estimation.normal_equations import OUTLIER_LENGTH
from intuitive_physics_learner.joint_search import joint_search, separate_fits
from intuitive_physics_learner.joint_search.joint_search import JointSearch
from intuitive_physics_learner.joint_search.separate_fits import may_tumble, tumbles
from intuitive_physics_learner.joint_search.staged_fit import StagedFit
from intuitive_physics_learner.online import joint_fits
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.search.convergence import StopReason
from intuitive_physics_learner.segmented_estimation.chaotic_states import CHANGE_SPREADS, moved
from intuitive_physics_learner.segmented_estimation.continuations import (
    MOTIONS,
    Continuations,
    Stretch,
)
from intuitive_physics_learner.segmented_estimation.segment_equations import (
    SegmentEquations,
    segment_equations,
)
from intuitive_physics_learner.segmented_estimation.segmented_fit import AVERAGED, SegmentedFit
from intuitive_physics_learner.segmented_estimation.segmented_throws import (
    LARGEST_LINK_LOSS,
    SegmentedThrows,
)
from intuitive_physics_learner.segmented_estimation.shooting import Shooting
from intuitive_physics_learner.segmented_estimation.smoothed_states import KnownStates

from .cases import MATERIALS, StorelessLearner, box_throws, task_of

TRUE = StaticParameters.uniform(MATERIALS).with_pair(
    "ball", "floor", dynamic_friction=0.3, static_friction=0.4, restitution=0.55
)
NOISE = 0.005
DYNAMIC_FRICTION, RESTITUTION = 1, 3  # among the four parameters of a box and a floor


@pytest.fixture(scope="module")
def seen(event_driven):
    """Twelve throws of a box, and their true states."""
    return box_throws(event_driven, TRUE, 12, NOISE, np.random.default_rng(4))


@pytest.fixture(scope="module")
def task(event_driven, seen):
    return task_of(TrajectoryCost(seen[0], event_driven))


@pytest.fixture(scope="module")
def true_unit(task):
    return task.searched.to_unit(TRUE)


@pytest.fixture(scope="module")
def single(task):
    """The fit of single initial states that a fit in segments begins at."""
    fit = JointFit(task.fit_task, JointEstimationSettings())
    for _ in range(20):
        fit.step()
    return fit


def true_path(throws, states):
    """The states (A, K, 13) of the true motions where segments begin."""
    begins = np.concatenate([np.zeros((len(states), 1), int), throws.points.ends[:, :-1]], axis=1)
    return np.take_along_axis(states, begins[..., None], axis=1)


def drawn_equations(generator, count):
    """Equations of a throw of `count` segments, and the whole matrix of its states."""
    d, n = 12, 3
    factors = generator.normal(size=(count * d, 2 * count * d))
    whole = factors @ factors.T / (2 * d) + np.eye(count * d)
    blocks = whole.reshape(count, d, count, d).swapaxes(1, 2)
    across, gradient = generator.normal(size=(count, d, n)), generator.normal(size=(count, d))
    next_blocks = np.zeros((count, d, d))
    for k in range(count - 1):
        next_blocks[k] = blocks[k, k + 1]
    own = np.array([blocks[k, k] for k in range(count)]) + count * np.eye(d)
    matrix = np.zeros((count, d, count, d))
    for k in range(count):
        matrix[k, :, k] = own[k]
        if k + 1 < count:
            matrix[k, :, k + 1], matrix[k + 1, :, k] = next_blocks[k], next_blocks[k].T
    links = generator.uniform(1.0, 2.0, size=(count, d))
    equations = SegmentEquations(
        own[None],
        next_blocks[None],
        across[None],
        gradient[None],
        np.eye(n)[None],
        np.ones((1, n)),
        links[None],
    )
    return equations, matrix.reshape(count * d, count * d)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.floats(0.0, 1.0))
def test_segments_are_eliminated_as_one_matrix(seed, count, damping):
    """H x = g for the whole block tridiagonal H, its diagonal times 1 + λ."""
    equations, matrix = drawn_equations(np.random.default_rng(seed), count)
    matrix += damping * np.diag(np.diag(matrix))
    across, gradient = equations.parameter_blocks[0], equations.gradients[0]
    n = across.shape[2]
    gains, offsets = equations.solved(damping)
    np.testing.assert_allclose(
        gains[0].reshape(-1, n), np.linalg.solve(matrix, across.reshape(-1, n)), atol=1e-8
    )
    np.testing.assert_allclose(
        offsets[0].ravel(), np.linalg.solve(matrix, gradient.ravel()), atol=1e-8
    )


@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.data())
def test_states_are_smoothed_as_by_the_whole_matrix(seed, count, data):
    """H of a throw is the inverse of the covariance of its states. With one of them given the mean
    of those before it is Σ_bk Σ_kk⁻¹ δ, and where δ has just the loss ½ δᵀ P δ by what is before
    it, P is the Schur complement of H with the link alone in place of the state's own block."""
    d, generator = 12, np.random.default_rng(seed)
    equations, matrix = drawn_equations(generator, count)
    covariance = np.linalg.inv(matrix).reshape(count, d, count, d)
    smoothed = equations.smoothed
    for k in range(count):
        np.testing.assert_allclose(smoothed.covariances[0, k], covariance[k, :, k], atol=1e-9)
    k = data.draw(st.integers(1, count - 1))
    change = generator.normal(size=d)
    follow = covariance[:k, :, k] @ np.linalg.solve(covariance[k, :, k], change)
    np.testing.assert_allclose(smoothed.before(0, k, change), follow, atol=1e-8)
    before, across = matrix[: k * d, : k * d], matrix[: k * d, k * d : (k + 1) * d]
    information = np.diag(equations.link_precisions[0, k - 1])
    information -= across.T @ np.linalg.solve(before, across)
    np.testing.assert_allclose(smoothed.precisions[0, k], information, atol=1e-8)


@given(st.integers(0, 2**32 - 1))
def test_states_are_drawn_with_their_covariance(seed):
    """Of n draws the variance errs by √(2 / n) of itself, one standard deviation."""
    generator = np.random.default_rng(seed)
    equations, matrix = drawn_equations(generator, 3)
    smoothed, count = equations.smoothed, 4000
    (drawn,) = smoothed.drawn(np.array([0]), np.array([1]), np.full(count, 2.0), generator)
    variances = 4.0 * np.diag(np.linalg.inv(matrix))[12:24]
    np.testing.assert_allclose(drawn.var(axis=0), variances, rtol=6.0 * np.sqrt(2.0 / count))


def test_the_true_motion_leaves_noise_alone(single, event_driven, seen, true_unit):
    """Its links err because the engine's steps restart with each segment, which chaos amplifies.
    Its points have noise.

    The loss of a point is half of χ² with three degrees of freedom, 1.5 on the average.
    """
    throws = SegmentedThrows(single, event_driven)
    path = true_path(throws, seen[1])
    counts = throws.points.counts
    spreads = throws.spreads(path, 1.0)
    losses = throws.losses(throws.worlds([true_unit]), path, counts, spreads)
    assert np.median(losses.links) < 0.1
    assert (losses.links > LARGEST_LINK_LOSS).mean() < 0.05
    points = np.isfinite(throws.points.times).sum()
    assert losses.points.sum() / points == pytest.approx(1.5, abs=5.0 * np.sqrt(1.5 / points))
    assert throws.explained(losses, counts).sum() > 0.9 * counts.sum()


def test_throws_have_nothing_to_do_with_each_other(single, event_driven, seen, true_unit):
    """Given θ_s, the losses of some throws are the same simulated alone and with all others."""
    members = np.array([2, 5, 11])
    whole = SegmentedThrows(single, event_driven)
    part = SegmentedThrows(single, event_driven, members)
    path = true_path(whole, seen[1])
    paths = path, path[members, : part.shape[1]]
    of_all, of_some = (
        throws.losses(
            throws.worlds([true_unit]), states, throws.points.counts, throws.spreads(states, 1.0)
        )
        for throws, states in zip((whole, part), paths, strict=True)
    )
    np.testing.assert_allclose(of_some.points, of_all.points[members, : part.shape[1]])
    np.testing.assert_allclose(of_some.links, of_all.links[members, : part.shape[1]])
    np.testing.assert_allclose(of_some.first, of_all.first[members])


def test_slopes_of_segments_are_those_of_the_loss(single, event_driven, seen, true_unit):
    """The gradient of half the squared residuals, by differences of the loss along each unknown.

    Only before the first contact, where residuals have no kinks: central differences of the loss
    over a step h then err by the third derivative, less than 1 % here.
    """
    throws = SegmentedThrows(single, event_driven)
    path = true_path(throws, seen[1])
    path[:, 0, 0] += 0.004
    path[:, 1, 8] -= 0.01
    explained = np.full(len(path), 2)
    spreads = throws.spreads(path, 1.0)
    deviations = np.full((*throws.shape, 12), 1e-3)
    equations = segment_equations(
        throws, path, explained, spreads, deviations, true_unit, np.full(true_unit.size, 1e-3)
    )
    worlds = throws.worlds([true_unit])

    def totals(states):
        return throws.losses(worlds, states, explained, spreads).totals(explained)

    for k, component, column in ((0, 0, 0), (0, 8, 9), (1, 1, 1), (1, 7, 8)):
        step = 1e-4
        up, down = path.copy(), path.copy()
        up[:, k, column] += step
        down[:, k, column] -= step
        slopes = (totals(up) - totals(down)) / (2.0 * step)
        smooth = np.abs(slopes) > 1.0
        index = component if column < 3 else column - 1
        np.testing.assert_allclose(
            equations.gradients[smooth, k, index], slopes[smooth], rtol=0.05, atol=5.0
        )


def test_a_motion_that_is_lost_is_found_again(single, event_driven, seen, true_unit):
    """From the true states before it a motion goes on, although nothing is known of it there."""
    throws = SegmentedThrows(single, event_driven)
    path = true_path(throws, seen[1])
    rows = np.arange(len(path))
    lengths = np.full(rows.size, 2)
    worlds = throws.worlds([true_unit])
    begun = np.repeat(path[:, :1], MOTIONS, axis=1)
    stretch = Stretch(throws, worlds, rows, lengths, 1.0)
    followed = Continuations(stretch, begun, np.random.default_rng(0)).follow(
        path, lengths, throws.points.counts, np.zeros((rows.size, MOTIONS))
    )
    assert (followed.counts >= np.minimum(4, throws.points.counts)).mean() > 0.9
    states = path.copy()
    for a in rows:
        states[a, : followed.counts[a]] = followed.states[a, : followed.counts[a]]
    spreads = throws.spreads(states, 1.0)
    losses = throws.losses(worlds, states, followed.counts, spreads)
    assert (throws.explained(losses, followed.counts) >= 3).mean() > 0.7


SHOT_SPREADS = 0.2 * CHANGE_SPREADS
"""Of states from which motions are shot: no drawn one of a box flies on as its points do."""


@pytest.fixture
def shots(single, event_driven, seen, true_unit):
    """Throws of which one segment is explained, the true path, and what begins beside it."""
    throws = SegmentedThrows(single, event_driven)
    path = true_path(throws, seen[1])
    generator, count = np.random.default_rng(3), len(path)
    known = KnownStates(
        moved(path[:, 0], SHOT_SPREADS * generator.normal(size=(count, 12))),
        np.tile(np.diag(SHOT_SPREADS**-2.0), (count, 1, 1)),
        np.tile(SHOT_SPREADS, (count, 1)),
    )
    drawn = SHOT_SPREADS * generator.normal(size=(count, 16, 12))
    worlds, explained = throws.worlds([true_unit]), np.ones(count, int)
    stretch = Stretch(throws, worlds, np.arange(count), explained, level=0.1)
    shooting = Shooting(stretch, throws.points.counts, known)
    return throws, shooting, moved(known.centres[:, None], drawn)


def test_motions_are_led_to_the_points(shots, true_unit):
    """Beyond what any of them explains as it was drawn, as one motion: its links leave nothing but
    what chaos makes of an engine's steps that restart with each segment."""
    throws, shooting, begun = shots
    flight = shooting._flown(begun, np.full(len(begun), 2))
    allowed = throws.points.largest_losses[:, None, :2]
    drawn = (flight.losses <= allowed).all(axis=2).any(axis=1)
    found = shooting.go_on(begun)
    farther = found.counts > 1
    assert drawn.mean() < 0.4
    assert farther.mean() > 0.6
    states = np.zeros((*throws.shape, 13))
    states[..., 6] = 1.0
    for a in np.flatnonzero(farther):
        states[a, : found.counts[a]] = found.states[a, : found.counts[a]]
    losses = throws.losses(
        throws.worlds([true_unit]), states, found.counts, throws.spreads(states, 0.1)
    )
    np.testing.assert_array_equal(
        throws.explained(losses, found.counts)[farther], found.counts[farther]
    )
    assert np.median(losses.links[farther]) < 0.1


def test_slopes_of_shots_are_those_of_their_loss(shots):
    """By central differences of the loss along each component, over a step h: they err by the third
    derivative, the forward differences of the method by the second. Only of motions that have not
    touched anything by then, where residuals have no kinks and none is an outlier."""
    _, shooting, _ = shots
    states = shooting._known.centres[:, None]
    first = np.ones(len(states), int)
    flight, _, gradient = shooting._linearised(states, first)
    lengths = np.linalg.norm(shooting._residuals(flight.offsets)[:, 0], axis=-1)
    smooth = lengths.max(axis=(1, 2)) < OUTLIER_LENGTH
    assert smooth.any()

    def losses(moves):
        trying = moved(states, moves)
        return shooting._flown(trying, first).losses.sum(axis=2) + shooting._known.losses(trying)

    for component in range(12):
        moves = np.zeros(12)
        moves[component] = 1e-3 * SHOT_SPREADS[component]
        slopes = (losses(moves) - losses(-moves)) / (2.0 * moves[component])
        np.testing.assert_allclose(
            (gradient[smooth, 0, component] - slopes[smooth, 0]) * SHOT_SPREADS[component],
            0.0,
            atol=0.1 * max(1.0, np.abs(slopes * SHOT_SPREADS[component]).max()),
        )


def test_what_tumbles_is_learned_in_segments(single, event_driven, true_unit):
    """The posterior holds the truth, is narrower than that of the motion up to the horizons, and
    with loose links more of it is explained."""
    assert tumbles(single)
    fit = SegmentedFit(single, event_driven, np.random.default_rng(0))
    units, explained = [], []
    while not fit.finished:
        fit.step()
        units.append(fit.unit)
        explained.append(fit.explained.sum() * 10 / 30.0)
    said = single.prior.joined(fit.knowledge())
    np.testing.assert_allclose(said.mean, np.mean(units[-AVERAGED:], axis=0), atol=1e-6)
    scores = (said.mean - true_unit) / said.deviations
    assert np.abs(scores).max() < 4.0
    for parameter in (DYNAMIC_FRICTION, RESTITUTION):
        assert said.deviations[parameter] < 0.03
        assert abs(said.mean[parameter] - true_unit[parameter]) < 0.05
    assert max(explained) > 1.5 * sum(each.horizon for each in single.observation_fits())


def test_one_motion_goes_on_from_how_throws_began(single, seen, task, event_driven):
    """A fit of single initial states that begins at the states found, with θ_s found, leaves noise
    up to the stated times: a loss of 1.5 a point on the average."""
    fit, before = SegmentedFit(single, event_driven, np.random.default_rng(0)), single.state()
    while not fit.finished:
        fit.step()
    begun = fit.observation_fits()
    found = [k for k, each in enumerate(begun) if each is not None]
    assert len(found) > 0.8 * len(begun)
    horizons = np.array([begun[k].horizon for k in found])
    assert horizons.mean() > 1.5 * single.horizons[found].mean()
    again = JointFit(task.fit_task, FIXED_HORIZONS)
    again.begin_at(fit.unit, fit.deviations, begun)
    points, losses = 0, 0.0
    model, estimate = again.model, again.estimate
    for (block, part), linear in zip(
        model.parts(estimate), model.linearised(estimate), strict=True
    ):
        used = np.isin(block.members, found)
        points += (block.times <= part.horizons[:, None])[used].sum()
        present = part.estimate[None], linear.residuals[None]
        of_states = 0.5 * ((part.estimate / block.prior_deviations) ** 2).sum(axis=1)
        losses += (part.losses(block, *present)[0] - of_states)[used].sum()
    assert losses / points < 1.5 + 5.0 * np.sqrt(1.5 / points)
    assert single.state() == before


def staged(task, simulator):
    generator = np.random.default_rng(1)
    return StagedFit(
        task.fit_task,
        in_segments=lambda fit: SegmentedFit(fit, simulator, generator.spawn(1)[0]),
    )


@pytest.fixture
def few_steps(monkeypatch):
    monkeypatch.setattr(separate_fits, "SEPARATE_STEPS", 8)


@pytest.mark.parametrize("stopped_after", [5, 11, 60])
def test_a_fit_in_segments_continues_exactly(task, event_driven, few_steps, stopped_after):
    """Before it, in the middle of it, and with what it said."""
    whole, begun = staged(task, event_driven), staged(task, event_driven)
    for _ in range(stopped_after):
        whole.step()
        begun.step()
    resumed = staged(task, event_driven)
    resumed.load_state(begun.state())
    for _ in range(3):
        whole.step()
        resumed.step()
    assert (whole.segment_steps > 0) == (stopped_after > 8)
    np.testing.assert_array_equal(whole.joint.unit, resumed.joint.unit)
    np.testing.assert_array_equal(whole.task.prior.precision, resumed.task.prior.precision)
    whole.conclude()
    resumed.conclude()
    np.testing.assert_array_equal(whole.joint.unit, resumed.joint.unit)


def test_what_is_known_by_segments_does_not_count_again(task, event_driven, few_steps):
    fit = staged(task, event_driven)
    while fit.task.counted.all():
        fit.step()
    assert not fit.task.counted.any()
    known = fit.task.prior
    for _ in range(3):
        fit.step()
    np.testing.assert_allclose(fit.joint.unit, np.clip(known.mean, 0.0, 1.0), atol=1e-3)
    assert fit.joint.misfits == 0.0


def test_without_time_nothing_is_fitted_in_segments(task, event_driven, few_steps):
    search = JointSearch(replace(task, simulator=event_driven), np.random.default_rng(0))
    search.plan(ConvergenceCriteria(time_limit=1e-3))
    for _ in range(12):
        search.step(1000)
    assert search._staged.segment_steps == 0


def test_fits_in_segments_leave_time_for_those_after_them(
    task, event_driven, few_steps, monkeypatch
):
    """They end with the step in which their share of the time has passed."""
    monkeypatch.setattr(joint_search, "LONE_SEGMENT_STAGE_SHARE", 0.0)
    search = JointSearch(replace(task, simulator=event_driven), np.random.default_rng(0))
    search.plan(ConvergenceCriteria(time_limit=100.0))
    while not search._staged._segments.ended:
        search.step(1000)
    assert search._staged.segment_steps == 1


def test_a_search_is_exhausted_only_when_all_stages_have_converged(
    task, event_driven, few_steps, monkeypatch
):
    """A step of the last throws in segments simulates less than one evaluation of J."""
    monkeypatch.setattr(joint_search, "LARGEST_MISFIT_SHARE", 1.0)
    search = JointSearch(replace(task, simulator=event_driven), np.random.default_rng(0))
    search._motions = 10**6
    outcome = search.run(ConvergenceCriteria(max_iterations=None, time_limit=100.0))
    assert outcome.stop_reason is StopReason.EXHAUSTED
    assert search._staged.settled


def test_what_was_learned_in_segments_stays_there(event_driven, seen, monkeypatch):
    """Also where a fit of single states that begins at the result gets far."""
    learner = StorelessLearner(event_driven, OnlineOptions())
    state, throws = learner.state, [*seen[0]]
    while len(state.kept) < 4 or not all(member.in_segments for member in state.kept):
        learner.learn_from(throws.pop(0))
    monkeypatch.setattr(joint_fits, "tumbles", lambda fit: False)
    state.next_refit = 0
    learner.learn_from(throws.pop(0))
    assert all(member.in_segments for member in state.kept)


def test_boxes_are_learned_online_in_segments(event_driven, seen, true_unit):
    """At refits; between these nothing of what they say is taken from fits of single states."""
    learner = StorelessLearner(event_driven, OnlineOptions())
    state = learner.state
    more, _ = box_throws(event_driven, TRUE, 8, NOISE, np.random.default_rng(8))
    throws = [*seen[0], *(replace(each, id=f"later {each.id}") for each in more)]
    while len(state.kept) < 8 or not all(member.in_segments for member in state.kept):
        learner.learn_from(throws.pop(0))
    information = sum(member.likelihood.information for member in state.kept)
    places = state.kept[0].likelihood.parameters
    np.testing.assert_allclose(state.posterior.precision[np.ix_(places, places)], information)
    held = OnlineState.from_json(state.to_json())
    assert all(member.in_segments for member in held.kept)
    learner.learn_from_all(throws[:2])
    np.testing.assert_array_equal(state.unit, held.unit)
    later = [member.weight for member in state.window if not member.in_segments]
    assert later
    assert not any(later)
    published = state.published
    assert published is not None
    pair, true_pair = (each.pair("ball", "floor") for each in (published.parameters, TRUE))
    for name, coefficient in zip(("dynamic_friction", "restitution"), (1, 3), strict=True):
        error = abs(pair[name] - true_pair[name])
        assert error < 4.0 * published.standard_deviations[places[coefficient]]
        assert error < 0.05


@pytest.mark.parametrize("materials", [("ball", "wood"), ("ball", "wood", "rubber")])
def test_each_object_is_learned_by_itself(
    materials, event_driven, seen, throws, true_parameters, monkeypatch
):
    """Two boxes in segments, and a ball, thrown in turn: nothing ties the parameters of one to
    those of another, and true restitutions are within four deviations of what is known."""
    # Throws of two seconds do not show of every box that it tumbles.
    monkeypatch.setattr(joint_fits, "tumbles", may_tumble)
    other = TRUE.with_pair("ball", "floor", dynamic_friction=0.2, restitution=0.6)
    others, _ = box_throws(event_driven, other, 6, NOISE, np.random.default_rng(5))
    balls = throws(6, seed=1, noise=0.003)
    learner = StorelessLearner(event_driven, OnlineOptions())
    state = learner.state
    for k, throw in enumerate(zip(seen[0], others, balls, strict=False)):
        named = zip(throw, materials, strict=False)
        learner.learn_from_all([of(each, name, f"{name} {k}") for each, name in named])
        if any(member.in_segments for member in state.kept):
            break
    for member in state.kept:
        assert member.in_segments != member.id.startswith("rubber")
    families = [state.families[tuple(sorted((name, "floor")))] for name in materials]
    for own, beside in itertools.permutations(families, 2):
        assert not state.posterior.precision[np.ix_(own, beside)].any()
    true = StaticParameters.uniform(state.materials)
    for name, its in zip(materials, (TRUE, other, true_parameters), strict=False):
        restitution = its.pair("ball", "floor")["restitution"]
        true = true.with_pair(name, "floor", restitution=restitution)
    restitutions = [family[3] for family in families]
    errors = np.abs(state.unit - state.space.to_unit(true))[restitutions]
    assert (errors < 4.0 * state.prior.deviations[restitutions]).all()
    assert (errors < 0.05).all()


def of(observation, material, name):
    """The same motion of an object of another material."""
    (thrown,) = observation.objects
    named = replace(thrown.object, id=material, material=material)
    observed = replace(thrown, object=named)
    return replace(observation, objects=(observed,), id=name)
