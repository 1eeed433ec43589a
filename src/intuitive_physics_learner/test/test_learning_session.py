"""From observations to a version of θ_s."""

import json
from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError, SimulationStoppedError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.parameter_space import Bounds
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningOptions,
    NoObservationsError,
    StopReason,
    TrajectoryCost,
    UnknownMethodError,
    learn,
)
from intuitive_physics_learner.search import parameter_search

from .cases import rerouted


def options(iterations=600, **others):
    return LearningOptions(criteria=ConvergenceCriteria(iterations), **others)


def known(parameters):
    """θ_s of which everything is said to be identified."""
    size = len(parameter_names(parameters.materials))
    return LearnedParameters(parameters, np.full(size, 0.1), np.ones(size, bool), 7, 0.1, 3, "x")


@pytest.mark.parametrize(
    "method", ["levenberg_marquardt", "cma_es", "hybrid_random", "adaptive_random"]
)
def test_learning_recovers_the_true_parameters(event_driven, throws, true_parameters, method):
    observed = throws(8, 3)
    learned = learn(observed, event_driven, options(1500, method=method)).learned
    got, true = (theta.pair("ball", "floor") for theta in (learned.parameters, true_parameters))
    assert got["restitution"] == pytest.approx(true["restitution"], abs=0.01)
    assert got["dynamic_friction"] == pytest.approx(true["dynamic_friction"], abs=0.02)
    assert got["rolling_friction"] == pytest.approx(true["rolling_friction"], rel=0.1)
    assert learned.cost < 0.02
    assert learned.method == method
    assert learned.observation_count == 8
    assert learned.version == 1


def test_balls_that_never_meet_say_what_they_say_one_by_one(event_driven, throws):
    # The likelihood of independent motions is the product of theirs.
    one_by_one = throws(8, 3, noise=0.005, state_noise=0.02)
    away = np.array([100.0, 0.0, 0.0])

    def elsewhere(observation):
        (ball,) = observation.objects
        track, state = ball.trajectory, ball.initial_state
        return replace(
            ball,
            object=replace(ball.object, id="other"),
            trajectory=Trajectory(track.times, track.positions + away),
            initial_state=replace(state, position=state.position + away),
        )

    pairs = [
        replace(a, objects=(*a.objects, elsewhere(b)), id="")
        for a, b in zip(one_by_one[::2], one_by_one[1::2], strict=True)
    ]
    alone, together = (learn(each, event_driven, options(1500)) for each in (one_by_one, pairs))
    assert len(together.assessments) == 4
    for name in ("dynamic_friction", "rolling_friction", "restitution"):
        k = parameter_names(alone.learned.materials).index(f"{name}[ball, floor]")
        deviation = alone.learned.standard_deviations[k]
        values = [each.learned.parameters.pair("ball", "floor")[name] for each in (alone, together)]
        assert values[0] == pytest.approx(values[1], abs=0.2 * deviation)
        assert together.learned.standard_deviations[k] == pytest.approx(deviation, rel=0.3)


def test_the_distance_that_is_asked_for_is_minimised(glide, glides):
    # x(t) = x(0) + e v t with e = 0.5, but for the last point, which is where e = 0.7 would be.
    (ball,) = (observation := glides(np.random.default_rng(0), 0.5)).objects
    times, positions = ball.trajectory.times, ball.trajectory.positions.copy()
    positions[-1] += 0.2 * times[-1] * ball.initial_state.linear_velocity
    observation = rerouted(observation, lambda *_: positions)
    # D̄ is least at the weighted median, D̂ where the last two points are as far off.
    before, last = times[-2:]
    lowest = {"mean": 0.5, "max": (0.7 * last + 0.5 * before) / (last + before)}
    for distance, e in lowest.items():
        how = options(600, method="cma_es", distance=distance)
        learned = learn([observation], glide, how).learned
        restitution = learned.parameters.pair("ball", "floor")["restitution"]
        assert restitution == pytest.approx(e, abs=0.002)
        cost = TrajectoryCost([observation], glide, ("ball", "floor"), distance)
        assert learned.cost == cost.costs([learned.parameters])[0]


def test_joint_estimation_has_no_distance_to_choose(event_driven, throws):
    with pytest.raises(InvalidInputError, match=r"distance is 'max'.*update rule, such as cma_es"):
        learn(throws(2, 0), event_driven, options(10, distance="max"))


def test_noisy_observations_cost_no_more_than_the_truth(event_driven, throws, true_parameters):
    observed = throws(8, 4, noise=0.01, state_noise=0.005)
    learned = learn(observed, event_driven, options(2000)).learned
    oracle = TrajectoryCost(observed, event_driven, ("ball", "floor")).costs([true_parameters])
    assert learned.cost < 1.05 * oracle[0]


def test_parameters_without_data_keep_their_values(event_driven, throws):
    learned = learn(throws(4, 0, noise=0.003), event_driven, options(300)).learned
    defaults = StaticParameters.uniform(learned.materials)
    assert (learned.parameters.density == defaults.density).all()
    assert learned.parameters.pair("ball", "ball") == defaults.pair("ball", "ball")
    names = parameter_names(learned.materials)
    assert not learned.identified[names.index("density[ball]")]
    assert np.isnan(learned.standard_deviations[names.index("density[ball]")])


def test_starts_from_earlier_version_and_keeps_other_materials(glide, glides):
    # Known: e of ball and floor, to the digit; and what stone is like, which nobody observed.
    before = known(StaticParameters.uniform(["stone", "ball", "floor"], density=2700.0))
    before = known(
        before.parameters.with_pair("floor", "ball", restitution=0.37).with_pair(
            "stone", "floor", static_friction=0.9
        )
    )
    observed = [glides(np.random.default_rng(0), 0.37)]
    result = learn(observed, glide, options(30, method="random"), previous=before)
    assert result.search.history[0] < 1e-9
    after = result.learned
    assert after.version == 8
    assert after.materials == ("stone", "ball", "floor")
    np.testing.assert_allclose(after.parameters.coefficients, before.parameters.coefficients)
    assert (after.parameters.density == 2700.0).all()
    # Only e of ball and floor was judged anew.
    assert after.identified.all()
    assert (after.standard_deviations != before.standard_deviations).sum() == 1


def test_the_posterior_agrees_with_the_standard_deviations(event_driven, throws):
    for method in ("levenberg_marquardt", "cma_es"):
        observed = throws(6, 0, noise=0.003, state_noise=0.002)
        learned = learn(observed, event_driven, options(600, method=method)).learned
        posterior = learned.posterior
        np.testing.assert_allclose(
            posterior.mean, posterior.space.to_unit(learned.parameters), atol=1e-9
        )
        values = posterior.space.to_values(posterior.draw(4000, np.random.default_rng(0)))
        sharp = learned.identified & (posterior.standard_deviations() < 0.03)
        sharp &= np.isnan(learned.intervals[:, 0])
        assert sharp.any()
        # Cut off at the bounds and at μ_d ≤ μ_s, and with the part that the bounds add.
        np.testing.assert_allclose(
            values[:, sharp].std(axis=0), learned.standard_deviations[sharp], rtol=0.15
        )
        # Of what has no influence nothing is known.
        names = parameter_names(learned.materials)
        for name in ("density[floor]", "restitution[ball, ball]"):
            assert not posterior.factor[:, names.index(name)].any()


def test_posterior_keeps_information_of_earlier_observations(glide, glides):
    before = known(StaticParameters.uniform(["stone", "floor", "ball"]))
    bounds = {"restitution": Bounds(0.0, 0.8), "density": Bounds(100.0, 1000.0, "logarithmic")}
    after = learn(
        [glides(np.random.default_rng(0), 0.5)], glide, options(200, bounds=bounds), previous=before
    ).learned
    names = parameter_names(after.materials)
    values = after.posterior.space.to_values(after.posterior.draw(4000, np.random.default_rng(0)))
    kept = [names.index(name) for name in ("density[stone]", "restitution[stone, floor]")]
    spread = values[:, kept].std(axis=0)
    np.testing.assert_allclose(spread, before.standard_deviations[kept], rtol=0.1)
    assert values[:, names.index("restitution[floor, ball]")].std() < 0.02


def test_new_materials_are_added(glide, glides):
    before = known(StaticParameters.uniform(["floor", "ball"]))
    observed = [glides(np.random.default_rng(0), 0.5, materials=("cork",))]
    after = learn(observed, glide, options(100), previous=before).learned
    assert after.materials == ("floor", "ball", "cork")
    names = parameter_names(after.materials)
    assert after.identified[names.index("restitution[floor, cork]")]
    assert not after.identified[names.index("restitution[ball, cork]")]
    assert after.identified[names.index("restitution[floor, ball]")]


def test_frictions_that_are_put_back_stay_ordered(event_driven, throws):
    # Balls that only slide: dynamic friction is told, static friction is not.
    before = known(
        StaticParameters.uniform(["ball", "floor"], static_friction=0.05, dynamic_friction=0.0)
    )
    learned = learn(throws(4, 0, times=12), event_driven, options(300), previous=before).learned
    pair = learned.parameters.pair("ball", "floor")
    assert pair["dynamic_friction"] <= pair["static_friction"]


def test_bounds_are_kept(glide, glides):
    observed = [glides(np.random.default_rng(0), 0.9)]
    bounds = {"restitution": Bounds(0.1, 0.6)}
    learned = learn(observed, glide, options(200, bounds=bounds)).learned
    assert learned.parameters.pair("ball", "floor")["restitution"] == pytest.approx(0.6, abs=1e-4)


def test_same_seed_same_result(event_driven, throws):
    observed = throws(3, 0, noise=0.01)
    first, again, other = (
        learn(observed, event_driven, options(100, seed=seed, method="cma_es")).search.history
        for seed in (1, 1, 2)
    )
    assert (first == again).all()
    assert (first != other).any()


def test_clear_errors(glide, glides):
    with pytest.raises(NoObservationsError):
        learn([], glide, options())
    with pytest.raises(UnknownMethodError, match="'magic'"):
        learn([glides(np.random.default_rng(0), 0.4)], glide, options(method="magic"))


def test_stop_reason_is_reported(glide, glides):
    observed = [glides(np.random.default_rng(0), 0.4)]
    result = learn(
        observed, glide, LearningOptions(criteria=ConvergenceCriteria(10_000, cost_threshold=0.01))
    )
    assert result.search.stop_reason is StopReason.COST_THRESHOLD


@pytest.mark.parametrize("method", ["levenberg_marquardt", "cma_es", "hybrid_random"])
def test_resumes_as_if_it_had_not_stopped(event_driven, throws, method, monkeypatch):
    monkeypatch.setattr(parameter_search, "CHECKPOINT_PERIOD", 0.0)
    observed = throws(3, 0, noise=0.01)
    states = []
    whole = learn(observed, event_driven, options(700, method=method), on_checkpoint=states.append)
    assert len(states) > 5
    state = json.loads(json.dumps(states[len(states) // 2], allow_nan=False))
    again = learn(observed, event_driven, options(700, method=method), resume=state)
    assert (again.search.history == whole.search.history).all()
    assert again.learned.to_dict() == whole.learned.to_dict()


def test_states_of_other_searches_are_refused(event_driven, throws):
    observed, states = throws(3, 0, noise=0.01), []
    learn(observed, event_driven, options(60, method="random"), on_checkpoint=states.append)
    for others, message in (
        ({"method": "cma_es"}, "method"),
        ({"distance": "max"}, "distance"),
        ({"seed": 1}, "seed"),
        ({"bounds": {"restitution": Bounds(0.1, 0.6)}}, "bounds"),
    ):
        how = options(60, **{"method": "random", **others})
        with pytest.raises(InvalidInputError, match=f"other {message}"):
            learn(observed, event_driven, how, resume=states[-1])
    with pytest.raises(InvalidInputError, match="other observations"):
        learn(observed[:2], event_driven, options(60, method="random"), resume=states[-1])


@pytest.mark.parametrize("method", ["levenberg_marquardt", "cma_es"])
def test_stops_when_the_flag_of_its_simulator_is_set(event_driven, throws, method):
    flag, reports = StopFlag(), []

    def stop(progress):
        reports.append(progress)
        flag.set()

    with pytest.raises(SimulationStoppedError):
        learn(
            throws(8, 0),
            event_driven.stopped_by(flag),
            options(60, method=method),
            on_progress=stop,
        )
    assert len(reports) == 1


def test_another_cost_can_take_the_place_of_this_process(event_driven, throws):
    class Halves(TrajectoryCost):
        def trial_distances(self, trials):
            parts = np.array_split(np.arange(trials.size), 2)
            halves = [super(Halves, self).trial_distances(trials.taken(part)) for part in parts]
            return np.concatenate(halves)

    observed = throws(3, 0, noise=0.01)
    learned = learn(observed, event_driven, options(60))
    two = learn(observed, event_driven, options(60), make_cost=Halves)
    assert (learned.search.history == two.search.history).all()
