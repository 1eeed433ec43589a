"""Recursive learning: what is published, what is set aside, what is remembered, what it takes."""

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import parameter_names
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.simulation import Simulator
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import LearningOptions
from intuitive_physics_learner.assessment.reasons import Reason
from intuitive_physics_learner.given_parameters import FIXED, PRIOR, given_parameters
from intuitive_physics_learner.joint_estimation.joint_fit import LARGEST_VOTE, JointFit
from intuitive_physics_learner.joint_estimation.several_starts import LEFT, SeveralStarts
from intuitive_physics_learner.online import memory
from intuitive_physics_learner.online.doubt import assessed
from intuitive_physics_learner.online.memory import grow_older
from intuitive_physics_learner.online.online_learner import OnlineLearner
from intuitive_physics_learner.online.online_state import OnlineState, Signs
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.publication import (
    FEWEST_COMPARED,
    is_to_be_published,
    publish,
)
from intuitive_physics_learner.online.stored_online_learning import StoredOnlineLearning
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.store.observation_entries import DOUBTFUL, USED, Assessment
from intuitive_physics_learner.stored_learning import learn_from_store

from .cases import E, StorelessLearner, rerouted

OPTIONS = OnlineOptions(window=6)
"""A small window, so that observations leave it soon."""


def noisy_throws(throws, count, seed):
    return throws(count, seed, noise=0.003, state_noise=0.01, times=24)


class CountingSimulator(Simulator):
    """Simulates by another engine, and counts the points that it was asked for."""

    def __init__(self, engine):
        self.name, self._engine, self.points = engine.name, engine, 0

    def _rollout(self, worlds, times, orientations):
        self.points += int(np.isfinite(times).sum())
        return self._engine._rollout(worlds, times, orientations)


def restitution(learned):
    return learned.parameters.pair("ball", "floor")["restitution"], learned.standard_deviations[E]


def kicked(observation):
    """The same throw, but that the ball was kicked on its way."""
    kick = [2.0, -1.0, 1.0]
    return rerouted(observation, lambda t, path: path + np.maximum(t - 0.4, 0.0)[:, None] * kick)


@pytest.fixture(scope="module")
def stream(event_driven, throws):
    """Versions that a learner published after each of some throws, and the learner."""
    engine = CountingSimulator(event_driven)
    learner = StorelessLearner(engine, OPTIONS)
    counts, published = [], []
    for observation in noisy_throws(throws, 24, 0):
        before = engine.points
        published.append(learner.learn_from(observation))
        counts.append(engine.points - before)
    return learner, published, counts


def test_data_that_confirm_make_the_published_uncertainty_smaller(stream, true_parameters):
    _, published, _ = stream
    truth = true_parameters.pair("ball", "floor")["restitution"]
    (_, early), (value, late) = restitution(published[3]), restitution(published[-1])
    assert late < 0.7 * early
    assert abs(value - truth) < 4.0 * late < 0.02
    versions = [version.version for version in published]
    assert versions == sorted(versions)
    assert published[-1].version > published[3].version
    assert published[-1].observation_count == 24


def test_retired_observations_still_count(stream):
    learner, published, _ = stream
    state = learner.state
    assert len(state.window) == OPTIONS.window
    everything = state.posterior.precision[E, E]
    of_window = sum(
        member.weight
        * member.likelihood.information[list(member.likelihood.parameters).index(E)][-1]
        for member in state.window
    )
    assert everything > 1.5 * of_window
    assert published[-1].posterior.information[E, E] > 0.0


def test_an_observation_takes_no_more_the_more_there_were(stream):
    _, _, counts = stream
    assert np.mean(counts[16:]) < 1.5 * np.mean(counts[8:16])


def held(observation):
    """The same throw, but that a hand caught the ball in mid-air and holds it."""

    def way(times, positions):
        caught = np.searchsorted(times, 0.3)
        noise = np.random.default_rng(0).normal(0.0, 0.003, positions[caught:].shape)
        positions[caught:] = positions[caught] + noise
        return positions

    return rerouted(observation, way)


@pytest.mark.parametrize("disturbed", [kicked, held])
def test_a_disturbed_throw_is_set_aside_and_changes_nothing(
    event_driven, throws, stream, disturbed
):
    learner = StorelessLearner(
        event_driven,
        OPTIONS,
        OnlineState.from_json(stream[0].state.to_json()),
        stream[0].seen.values(),
    )
    before, information = learner.state.published, learner.state.posterior.precision.copy()
    (observation,) = noisy_throws(throws, 1, 77)
    (assessment,) = learner.learn_from_all([disturbed(observation)])
    assert (assessment.id, assessment.status) == (observation.id, DOUBTFUL)
    assert assessment.weight < 0.5
    assert any(assessment.reason.startswith(reason.value) for reason in Reason)
    assert learner.state.set_aside == 1
    assert restitution(learner.state.published)[0] == pytest.approx(
        restitution(before)[0], abs=2.0 * restitution(before)[1]
    )
    assert np.diag(learner.state.posterior.precision) == pytest.approx(
        np.diag(information), rel=0.5
    )


def test_a_disturbed_throw_among_the_first_is_set_aside_later(event_driven, throws):
    # Of two nobody can say which one is right; of eight one can, also where it left the window.
    first, *others = noisy_throws(throws, 8, 21)
    observed = {each.id: each for each in (kicked(first), *others)}
    learner = StorelessLearner(event_driven, OnlineOptions(window=4))
    noted = [learner.learn_from_all([each]) for each in observed.values()]
    assert not noted[0]
    assert [each.id for some in noted for each in some] == [first.id]
    assert [member.id for member in learner.state.doubtful] == [first.id]
    assert len(learner.state.kept) == learner.state.used == 7


@pytest.mark.parametrize("is_there", [True, False])
def test_one_that_left_the_window_is_set_aside_and_examined_at_once(event_driven, throws, is_there):
    # Its observation is not at hand any more: it is read again, unless somebody has deleted it.
    observed = {each.id: each for each in noisy_throws(throws, 13, 23)}
    *first, last = observed.values()
    learner = OnlineLearner(
        event_driven,
        OnlineOptions(window=4),
        OnlineState(),
        lambda ids: [observed[name] for name in ids if name in observed],
    )
    learner.learn_from_all(first)
    member = learner.state.past[0]
    assert member.id not in learner._observations
    member.signs = replace(member.signs, log_p=-30.0)
    if not is_there:
        del observed[member.id]
    noted = learner.learn_from_all([last])
    assert (noted[0].id, noted[0].status) == (member.id, DOUBTFUL)
    known = [each.id for each in (*learner.state.kept, *learner.state.doubtful)]
    assert (member.id in known) == is_there


def test_what_a_user_includes_is_never_set_aside(event_driven, throws):
    # A kick is doubted when it comes, and later beside the others: not where a user knows better.
    first, *others = noisy_throws(throws, 8, 21)
    observed = {each.id: each for each in (kicked(first), *others)}
    learner = StorelessLearner(event_driven, OnlineOptions(window=4))
    for each in observed.values():
        assert not learner.learn_from_all([each], trusted=[first.id])
    assert not learner.state.doubtful
    assert first.id in [member.id for member in learner.state.kept]
    again = OnlineState.from_json(learner.state.to_json())
    assert [member.id for member in again.kept if member.trusted] == [first.id]
    late = StorelessLearner(event_driven, OnlineOptions(window=4))
    late.learn_from_all(list(observed.values()))
    assert [member.id for member in late.state.doubtful] == [first.id]
    late.learn_from_all([observed[first.id]], trusted=[first.id])
    assert [member.id for member in late.state.kept if member.trusted] == [first.id]
    assert not late.state.doubtful


def test_signs_are_judged_beside_one_another():
    generator = np.random.default_rng(22)
    signs = {
        str(k): Signs(float(np.log(generator.random())), "law", 2.0 + generator.random(), 0.0)
        for k in range(12)
    }
    worse = Signs(-30.0, "law at t = 1.00 s", 2.0, 0.0), Signs(-0.5, "law", 60.0, 1.5)
    assessments = assessed({**signs, **dict(zip("ab", worse, strict=True))})
    assert [each.id for each in assessments if each.status == DOUBTFUL] == ["a", "b"]
    assert [each.reason for each in assessments[-2:]] == [
        "law at t = 1.00 s",
        Reason.UNEXPLAINED.at(1.5),
    ]
    # Where motion is so chaotic that most stand out, none does.
    wild = {name: replace(each, misfit=30.0 * each.misfit) for name, each in signs.items()}
    assert {each.status for each in assessed({**wild, "b": worse[1]})} == {USED}


def test_learner_resumes_exactly(event_driven, throws):
    # Some have left the window when all are fitted again.
    observed = {observation.id: observation for observation in noisy_throws(throws, 12, 1)}
    whole, parts = StorelessLearner(event_driven, OPTIONS), StorelessLearner(event_driven, OPTIONS)
    for observation in observed.values():
        whole.learn_from(observation)
        state = OnlineState.from_json(parts.state.to_json())
        parts = StorelessLearner(event_driven, OPTIONS, state, parts.seen.values())
        parts.learn_from(observation)
    assert parts.state.to_json() == whole.state.to_json()
    assert whole.state.next_refit >= 16
    assert len(whole.state.past) > 0


def test_the_same_observation_counts_once(event_driven, throws):
    learner = StorelessLearner(event_driven, OPTIONS)
    (observation,) = noisy_throws(throws, 1, 2)
    learner.learn_from_all([observation, observation])
    learner.learn_from(observation)
    assert learner.state.processed == len(learner.state.window) == 1


@pytest.mark.parametrize("wrong", ["challenger", "published"])
def test_what_has_moved_far_is_published_after_it_has_won(event_driven, throws, wrong):
    learner = StorelessLearner(event_driven, OPTIONS)
    observed = noisy_throws(throws, 9, 11)
    learner.learn_from_all(observed[:6])
    state = learner.state
    version = state.published.version
    # One of the two knows the truth, and all that the other one knows is far from it.
    far = np.where(state.posterior.precision.diagonal() > 0.0, 0.5, 0.0)
    name = "posterior" if wrong == "challenger" else "published_information"
    before = getattr(state, name)
    setattr(state, name, Gaussian(before.precision, before.pull + before.precision @ far))
    state.unit = np.clip(state.prior.mean, 0.0, 1.0)
    for observation in observed[6:]:
        assert not is_to_be_published(state)
        learner._take(observation)
    assert state.compared == FEWEST_COMPARED
    again = OnlineState.from_json(state.to_json())
    assert again.challenger.equals(state.challenger)
    most = LARGEST_VOTE * state.compared
    won = wrong == "published"
    assert (0.0 < state.score <= most) if won else (-most <= state.score < 0.0)
    assert is_to_be_published(state) == won
    if won:
        publish(state, 0.1)
    assert state.published.version == version + won
    assert (state.compared, state.score) == (0, 0.0)


def test_forgets_with_the_time_constant(event_driven, throws):
    learner = StorelessLearner(event_driven, OnlineOptions(window=6, time_constant=10.0))
    (first,) = noisy_throws(throws, 1, 3)
    learner.learn_from(first)
    matrix = learner.state.posterior.precision.copy()
    grow_older(learner.state, first.start_time + 10.0, 10.0)
    assert learner.state.posterior.precision == pytest.approx(matrix / np.e)
    # An observation that is older than the last one makes nothing younger.
    grow_older(learner.state, first.start_time, 10.0)
    assert learner.state.posterior.precision == pytest.approx(matrix / np.e)


def later(observation, seconds):
    """The same motion, seen later."""
    (ball,) = observation.objects
    path = ball.trajectory
    moved = replace(ball, trajectory=Trajectory(path.times + seconds, path.positions))
    return replace(observation, objects=(moved,), start_time=observation.start_time + seconds)


def test_what_is_published_forgets_with_the_time_constant(glide, gliding):
    # Ten time constants apart, an observation counts e⁻¹⁰ of the next one: the first of those with
    # another restitution is nearly all that is known, and three more predict by it. No change is
    # looked for.
    generator = np.random.default_rng(14)
    options = OnlineOptions(window=24, time_constant=100.0, false_alarm_rate=0.0)
    learner = StorelessLearner(glide, options)
    published = [
        restitution(learner.learn_from(later(gliding(generator, e), 1000.0 * k)))[0]
        for k, e in enumerate(8 * [0.8] + 8 * [0.6])
    ]
    assert published[7] == pytest.approx(0.8, abs=0.02)
    assert published[12:] == pytest.approx(4 * [0.6], abs=0.02)
    assert len(learner.state.kept) == 1


def test_a_change_is_followed_by_forgetting_alone(glide, gliding):
    # Ten observations to a time constant: of 15 before the change 10 (1 - e⁻¹·⁵) = 7.8 are
    # remembered, and 7.8 e^(-n/10) < 10 (1 - e^(-n/10)) from the sixth after it on.
    generator = np.random.default_rng(15)
    options = OnlineOptions(window=24, time_constant=100.0, false_alarm_rate=0.0)
    learner = StorelessLearner(glide, options)
    published = [
        restitution(learner.learn_from(later(gliding(generator, e), 10.0 * k)))[0]
        for k, e in enumerate(15 * [0.8] + 8 * [0.6])
    ]
    assert published[:18] == pytest.approx(18 * [0.8], abs=0.02)
    assert published[21:] == pytest.approx(2 * [0.6], abs=0.02)


def test_a_floor_that_was_waxed_is_noticed(event_driven, gliding, glide):
    generator = np.random.default_rng(4)
    learner = StorelessLearner(glide, OPTIONS)
    for _ in range(10):
        learner.learn_from(gliding(generator, 0.8))
    assert learner.state.changes == []
    estimates = [restitution(learner.learn_from(gliding(generator, 0.7)))[0] for _ in range(15)]
    ((change, before),) = learner.state.changes
    assert change.pair == ("ball", "floor")
    assert before in (9, 10)
    assert OnlineState.from_json(learner.state.to_json()).changes == learner.state.changes
    assert estimates[-1] == pytest.approx(0.7, abs=0.01)
    # Later refits are to what came after the change alone.
    assert learner.state.next_refit == 16
    assert min(member.number for member in learner.state.kept) > before


@pytest.fixture(scope="session")
def gliding(glides):
    """Make observations of a ball that glides on the floor, with noise, also in its first state."""

    def make(generator, e):
        observation = glides(generator, e, counts=(12,))
        (ball,) = observation.objects
        state, level = ball.initial_state, np.array([1.0, 1.0, 0.0])
        height = [0.0, 0.0, ball.object.shape.radius]
        noise = generator.normal(0.0, 0.002, (12, 3))
        state = replace(
            state,
            position=state.position * level + height,
            linear_velocity=state.linear_velocity * level,
            covariance=np.diag(np.repeat([1.0, 0.0, 0.0, 0.0], 3)) * 0.002**2,
        )
        return rerouted(
            observation, lambda _, path: path * level + height + noise, initial_state=state
        )

    return make


def test_a_wrong_optimum_is_left_when_there_is_more_evidence(folded_glide, folded, monkeypatch):
    generator = np.random.default_rng(0)
    observations = [folded(generator) for _ in range(20)]
    defaults = LearnedParameters.defaults(("ball", "floor"))
    start = replace_value(defaults, folded_glide.wrong, np.nan)

    def estimates():
        learner = StorelessLearner(folded_glide, OPTIONS)
        learner.adopt(start, informed=False)
        return [restitution(learner.learn_from(each)) for each in observations]

    values = estimates()
    assert values[4][0] == pytest.approx(folded_glide.wrong, abs=0.02)
    value, deviation = values[-1]
    assert abs(value - folded_glide.true) < 4.0 * deviation < 0.02
    # Linear as they are, earlier observations hold the wrong one for ever.
    monkeypatch.setattr(OnlineState, "refit_is_due", False)
    assert estimates()[-1][0] == pytest.approx(folded_glide.wrong, abs=0.02)


def test_the_fit_of_the_window_leaves_time_for_refits(glide, gliding, monkeypatch):
    monkeypatch.setattr(JointFit, "settled", False)
    generator = np.random.default_rng(31)
    learner = StorelessLearner(glide, replace(OPTIONS, seconds=1.0))
    learner.learn_from_all([gliding(generator, 0.8) for _ in range(4)], lambda: 0.0)
    left = iter(np.arange(1.0, 0.0, -0.12).tolist())
    learner.learn_from_all([gliding(generator, 0.8)], lambda: next(left))
    # One step has gone beyond the half of a second that there is for it.
    assert 0.25 < next(left) < 0.5


# Besides the present estimate: of four starts, those that are left in the end.
@pytest.mark.parametrize(("seconds", "others"), [(np.inf, LEFT), (0.0, 0)], ids=["all", "none"])
def test_starts_that_had_no_time_are_not_chosen_from(glide, gliding, monkeypatch, seconds, others):
    generator, counts, choose = np.random.default_rng(32), [], SeveralStarts.choose

    def counting(starts, beyond):
        counts.append(len(starts.fits))
        return choose(starts, beyond)

    monkeypatch.setattr(SeveralStarts, "choose", counting)
    observed = [gliding(generator, 0.8) for _ in range(4)]
    StorelessLearner(glide, OPTIONS).learn_from_all(observed, lambda: seconds)
    assert counts == [1 + others]


def test_optima_that_data_cannot_tell_apart_widen_what_is_published(glide, gliding):
    # f(e) = 0.64 - |e - ½|: both e = 0.42 and e = 0.58 give the 0.56 observed.
    generator = np.random.default_rng(23)
    observed = [gliding(generator, 0.56) for _ in range(4)]
    learner = StorelessLearner(type(glide)(lambda e: 0.64 - abs(e - 0.5)), OPTIONS)
    learner.learn_from_all(observed)
    value, deviation = restitution(learner.state.published)
    assert abs(value - 0.5) == pytest.approx(0.08, abs=0.01)
    # Of the fits, from two to four, at least one ends at each.
    assert 0.16 / 2.0 < deviation < 0.16
    assert OnlineState.from_json(learner.state.to_json()).spread.any()
    alone = StorelessLearner(glide, OPTIONS)
    alone.learn_from_all(observed)
    value, deviation = restitution(alone.state.published)
    assert abs(value - 0.56) < 4.0 * deviation < 0.02


def test_a_refit_is_bounded(glide, gliding, monkeypatch):
    monkeypatch.setattr(memory, "MOST_KEPT", 8)
    generator, counts = np.random.default_rng(18), []
    engine = CountingSimulator(glide)
    learner = StorelessLearner(engine, OPTIONS)
    for _ in range(32):
        before = engine.points
        learner.learn_from(gliding(generator, 0.8))
        counts.append(engine.points - before)
        assert len(learner.state.kept) <= 8
    assert learner.state.next_refit == 64
    assert counts[31] < 1.5 * counts[15]
    # Each start takes one step where the time is over.
    first, second = CountingSimulator(glide), CountingSimulator(glide)
    observed = [gliding(generator, 0.8) for _ in range(8)]
    StorelessLearner(first, OPTIONS).learn_from_all(observed, lambda: 0.0)
    StorelessLearner(second, OPTIONS).learn_from_all(observed)
    assert first.points < second.points


@pytest.mark.parametrize("away", [0.0, 0.3])
def test_what_is_gone_counts_while_it_agrees_with_a_refit(glide, gliding, away):
    generator = np.random.default_rng(19)
    learner = StorelessLearner(glide, OPTIONS)
    learner.learn_from_all([gliding(generator, 0.8) for _ in range(7)])
    state = learner.state
    mean, matrix = state.unit.copy(), np.zeros_like(state.posterior.precision)
    mean[E] -= away
    matrix[E, E] = state.posterior.precision[E, E]
    state.retired = state.retired.joined(Gaussian.about(mean, matrix))
    learner.learn_from(gliding(generator, 0.8))
    assert restitution(state.published)[0] == pytest.approx(0.8, abs=0.01)
    assert bool(state.retired.precision[E, E]) == (away == 0.0)


@pytest.mark.parametrize("text", ["", "{}", '{"format": "other"}', "[1]", '{"format": 3}'])
def test_a_state_that_is_none_is_refused(text):
    with pytest.raises(InvalidInputError, match="state of on-line learning"):
        OnlineState.from_json(text)


def learn_all(store, simulator):
    learning = StoredOnlineLearning(store, simulator, OPTIONS)
    while learning.advance():
        pass
    return learning


def test_values_that_a_user_sets_are_knowledge_to_go_on_from(store, glide, gliding):
    generator = np.random.default_rng(5)
    store.add_all([gliding(generator, 0.8) for _ in range(5)])
    learn_all(store, glide)
    given = store.newest_parameters()
    given = replace_value(given, 0.3, deviation=0.001)
    stored = store.add_parameters(given)
    store.add(gliding(generator, 0.3))
    learning = learn_all(store, glide)
    newest = store.newest_parameters()
    assert restitution(newest)[0] == pytest.approx(0.3, abs=0.003)
    assert newest.version >= stored.version
    assert learning.pending == 0
    assert len(learning.learner.state.window) == 1


@pytest.mark.parametrize(("searched", "met"), [(4, 5), (9, 1)], ids=["few", "many"])
def test_window_is_learned_again_after_a_search(store, glide, gliding, searched, met):
    generator = np.random.default_rng(9)
    first = [gliding(generator, 0.8) for _ in range(searched)]
    store.add_all(first)
    known = restitution(learn_from_store(store, glide, LearningOptions()).learned)[1]
    if met > 1:
        store.include([entry.id for entry in store.entries(statuses=[DOUBTFUL])])
    store.add(gliding(generator, 0.8))
    learning = learn_all(store, glide)
    assert learning.learner.state.processed == met
    assert len(learning.learner.state.window) == met
    value, deviation = restitution(store.newest_parameters())
    assert value == pytest.approx(0.8, abs=0.01)
    searched_again = learn_from_store(store, glide, LearningOptions()).learned
    # Information adds: what n observations say is σ, and one more makes it σ √(n / (n + 1)).
    added = known * np.sqrt(searched / (searched + 1))
    assert deviation < 1.1 * max(restitution(searched_again)[1], added)


@pytest.mark.parametrize("doubtful", [0, 2])
def test_what_comes_after_a_search_is_learned_whatever_it_doubted(store, glide, gliding, doubtful):
    generator = np.random.default_rng(15)
    store.add_all([gliding(generator, 0.8) for _ in range(8)])
    learned = learn_from_store(store, glide, LearningOptions()).learned
    ids = [entry.id for entry in store.entries()]
    doubts = [Assessment(name, 0.1, "kicked", DOUBTFUL) for name in ids[:doubtful]]
    assert store.add_improvement(learned, learned.version, ids, doubts) is not None
    store.add_all([gliding(generator, 0.8) for _ in range(3)])
    learning = learn_all(store, glide)
    assert learning.learner.state.processed == 3
    # What a user gives back is learned from again.
    store.exclude(ids[7:])
    store.include(ids[7:])
    assert learning.pending == 1


def test_what_a_search_left_out_is_learned(store, glide, gliding):
    generator = np.random.default_rng(16)
    observations = [gliding(generator, 0.8) for _ in range(10)]
    store.add_all(observations)
    ids = [observation.id for observation in observations]
    learn_from_store(store, glide, LearningOptions(observation_ids=ids[3:]))
    learning = learn_all(store, glide)
    assert {member.id for member in learning.learner.state.window} == set(ids[:3])


def test_a_one_sided_interval_is_kept(glide, gliding):
    # What is known of μ_d is that it lies between two values; the glides say nothing of it.
    generator = np.random.default_rng(17)
    learned = LearnedParameters.defaults(("ball", "floor"))
    place = parameter_names(learned.materials).index("dynamic_friction[ball, floor]")
    before = learned.whole_posterior()
    mean, ends = before.mean.copy(), np.full((before.mean.size, 2), np.nan)
    mean[place], ends[place] = 0.4, (0.35, 1.0)
    factor = np.zeros((1, mean.size))
    factor[0, place] = 1.0 / 0.01
    posterior = ParameterPosterior(learned.materials, mean, factor, before.bounds, ends)
    learned = replace(
        learned,
        parameters=posterior.space.to_parameters(mean),
        identified=posterior.identified,
        standard_deviations=posterior.standard_deviations(),
        intervals=ends,
        posterior=posterior,
        version=1,
        method="joint_estimation",
    )
    learner = StorelessLearner(glide, OPTIONS)
    learner.adopt(learned, informed=True)
    # A number that is uniform in it, but for its ends, has the deviation l / √12.
    assert learner.state.prior.mean[place] == pytest.approx(0.675, abs=0.01)
    assert learner.state.prior.deviations[place] == pytest.approx(0.65 / np.sqrt(12), rel=0.2)
    for _ in range(4):
        learner.learn_from(gliding(generator, 0.8))
    published = learner.state.published
    assert published.version > 1
    np.testing.assert_array_equal(published.intervals, ends)
    draws = published.posterior.draw(4000, np.random.default_rng(0))[:, place]
    assert np.quantile(draws, [0.05, 0.95]) == pytest.approx([0.38, 0.97], abs=0.03)


def test_what_only_has_to_be_large_enough_is_an_interval(glide, gliding):
    # f(e) = min(e, 0.6): all e from 0.6 on glide alike.
    generator = np.random.default_rng(35)
    learner = StorelessLearner(type(glide)(lambda e: np.minimum(e, 0.6)), OPTIONS)
    for _ in range(8):
        learner.learn_from(gliding(generator, 0.6))
    published = learner.state.published
    low, high = published.intervals[E]
    assert low == pytest.approx(0.6, abs=0.03)
    assert high == pytest.approx(1.0, abs=0.03)
    assert np.isnan(np.delete(published.intervals, E, axis=0)).all()
    draws = published.posterior.draw(4000, np.random.default_rng(0))[:, E]
    assert np.quantile(draws, [0.1, 0.9]) == pytest.approx([0.64, 0.96], abs=0.03)
    # Bound on both sides there is none.
    learner = StorelessLearner(glide, OPTIONS)
    for _ in range(8):
        learner.learn_from(gliding(generator, 0.6))
    assert np.isnan(learner.state.published.intervals).all()


@pytest.mark.parametrize("away", [0.0, 0.1])
def test_what_an_earlier_fit_disagrees_with_is_less_certain(glide, gliding, away):
    generator = np.random.default_rng(36)
    learner = StorelessLearner(glide, OPTIONS)
    for _ in range(8):
        learner.learn_from(gliding(generator, 0.8))
    state = learner.state
    assert [each.used for each in state.refitted] == [4, 8]
    state.refitted[0].unit[E] += away
    learner.learn_from(gliding(generator, 0.8))
    _, deviation = restitution(state.published)
    if away:
        assert away <= deviation < 2.0 * away
    else:
        assert deviation < 0.01
    # A change ends what was fitted before it.
    state.count_from(1)
    assert not state.refitted


def replace_value(learned, value, deviation):
    parameters = learned.parameters.with_pair("ball", "floor", restitution=value)
    deviations = np.full(len(learned.identified), np.nan)
    deviations[E] = deviation
    return LearnedParameters(
        parameters, deviations, np.isfinite(deviations), 0, float("nan"), 0, ""
    )


def given_restitution(value, deviation, as_what):
    learned = replace_value(LearnedParameters.defaults(("ball", "floor")), value, deviation)
    return given_parameters(learned, as_what, ["restitution[ball, floor]"])


@pytest.mark.parametrize("value", [0.3, 0.1 + 0.2, 0.8123456789])
def test_a_value_that_is_held_never_moves(store, glide, gliding, value):
    generator = np.random.default_rng(9)
    held = store.add_parameters(given_restitution(value, np.nan, FIXED))
    store.add_all([gliding(generator, 0.8) for _ in range(3)])
    learning = learn_all(store, glide)
    newest = store.newest_parameters()
    assert restitution(newest) == restitution(held) == (value, 0.0)
    state = learning.learner.state
    assert all(E not in member.likelihood.parameters for member in state.window)
    assert newest.given.fixed[E]


def test_others_are_learned_beside_a_value_that_is_held(event_driven, throws, true_parameters):
    truth = true_parameters.pair("ball", "floor")["restitution"]
    given = given_restitution(truth, np.nan, FIXED)
    learner = StorelessLearner(event_driven, OPTIONS)
    learner.adopt(replace(given, version=1), informed=True)
    observed = noisy_throws(throws, 8, 5)
    learner.learn_from_all(observed)
    newest = learner.state.published
    assert newest.version > 1
    assert restitution(newest) == (truth, 0.0)
    free = StorelessLearner(event_driven, OPTIONS)
    free.learn_from_all(observed)
    others = newest.identified & ~newest.given.fixed
    assert others.any()
    # Knowing one value exactly makes no other less certain.
    mine, theirs = learner.state.prior.deviations[others], free.state.prior.deviations[others]
    assert (mine < 1.2 * theirs).all()
    again = OnlineState.from_json(learner.state.to_json())
    kept = StorelessLearner(event_driven, OPTIONS, again, learner.seen.values())
    kept.learn_from_all(noisy_throws(throws, 2, 6))
    assert restitution(kept.state.published) == (truth, 0.0)


def test_a_prior_counts_as_the_inverse_of_its_variance(glide, gliding):
    generator = np.random.default_rng(10)
    observations = [gliding(generator, 0.8) for _ in range(3)]
    free = StorelessLearner(glide, OPTIONS)
    free.learn_from_all(observations)
    value, deviation = restitution(free.state.published)
    information = free.state.posterior.precision[E, E]
    slope = free.state.space.slopes(free.state.unit)[E, E]
    deviation = slope / np.sqrt(information)
    prior = given_restitution(value + 2.0 * deviation, deviation, PRIOR)
    learner = StorelessLearner(glide, OPTIONS)
    # The result of a search that used the prior: what it was given is knowledge all the same.
    learner.adopt(replace(prior, version=1, method="joint_estimation"), informed=False)
    learner.learn_from_all(observations)
    coefficients = learner.state.parameters.pair("ball", "floor")["restitution"]
    assert coefficients == pytest.approx(value + deviation, abs=0.3 * deviation)
    assert learner.state.published.given is not None


def test_given_knowledge_is_not_forgotten(glide, gliding):
    learner = StorelessLearner(glide, OnlineOptions(window=6, time_constant=10.0))
    learner.adopt(replace(given_restitution(0.5, 0.01, PRIOR), version=1), informed=True)
    matrix = learner.state.retired.precision.copy()
    grow_older(learner.state, 0.0, 10.0)
    grow_older(learner.state, 1000.0, 10.0)
    assert matrix.any()
    assert learner.state.retired.precision == pytest.approx(matrix)


def test_an_unreadable_row_is_passed_over(store, glide, gliding):
    generator = np.random.default_rng(6)
    store.add_all([gliding(generator, 0.8) for _ in range(3)])
    with store.database.writing() as connection:
        connection.execute("UPDATE observations SET json = '{' WHERE rowid = 2")
        connection.execute("UPDATE observation_entries SET status = 'used'")
    learning = learn_all(store, glide)
    assert "is passed over" in learning.problem
    assert learning.learner.state.processed == 2


def test_excluded_observation_returns_when_included(store, glide, gliding):
    generator = np.random.default_rng(7)
    store.add_all([gliding(generator, 0.8) for _ in range(3)])
    learn_all(store, glide)
    first = store.entries()[0].id
    store.exclude([first])
    learning = learn_all(store, glide)
    assert first not in [member.id for member in learning.learner.state.window]
    store.include([first])
    learning = learn_all(store, glide)
    assert first in [member.id for member in learning.learner.state.window]


def test_included_observation_is_trusted(store, glide, gliding):
    generator = np.random.default_rng(21)
    store.add_all([gliding(generator, 0.8) for _ in range(6)])
    learn_all(store, glide)
    odd = gliding(generator, 0.3)
    store.add(odd)
    assert [member.id for member in learn_all(store, glide).learner.state.doubtful] == [odd.id]
    store.include([odd.id])
    state = learn_all(store, glide).learner.state
    assert not state.doubtful
    assert [member.id for member in state.kept if member.trusted] == [odd.id]


def test_excluded_observation_takes_part_in_no_refit(store, glide, gliding):
    generator = np.random.default_rng(20)
    store.add_all([gliding(generator, 0.8) for _ in range(10)])
    state = learn_all(store, glide).learner.state
    gone = state.past[0].id
    assert len(state.kept) == 10
    store.exclude([gone])
    store.add_all([gliding(generator, 0.8) for _ in range(6)])
    learning = learn_all(store, glide)
    assert learning.learner.state.next_refit == 32
    assert gone not in [member.id for member in learning.learner.state.kept]
    assert len(learning.learner.state.kept) == 15


def test_a_state_that_cannot_be_read_only_takes_time(store, glide, gliding):
    generator = np.random.default_rng(8)
    store.add_all([gliding(generator, 0.8) for _ in range(3)])
    learn_all(store, glide)
    with store.database.writing() as connection:
        connection.execute("UPDATE online_state SET json = '{'")
    learning = learn_all(store, glide)
    assert "cannot be read" in learning.problem
    assert learning.learner.state.processed == 3
    assert OnlineState.from_json(learning.learner.state.to_json()).processed == 3
