"""Calibration: true predictions are found true, false ones false, and the experiment shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Detections
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_cli.evaluation.evaluation import free_flight
from intuitive_physics_experiments.calibration.calibrate import (
    FITTED,
    OURS,
    Calibration,
    Scores,
    fixed_noise,
    free_flights,
    ideal_energy_scores,
    ratios_of_means,
    score,
)
from intuitive_physics_experiments.calibration.observed_calibration import (
    calibrate_on_observations,
    fitted_scales,
    free_flight_noise,
    observed_outcomes,
    splits_of,
)
from intuitive_physics_experiments.calibration.options import CalibrationOptions
from intuitive_physics_experiments.calibration.paper_calibration import (
    calibrate_on_paper_set,
    paper_outcomes,
)
from intuitive_physics_experiments.calibration.report import (
    reliability_rows,
    score_rows,
    write_calibration,
)
from intuitive_physics_experiments.paper.paper_dataset import POSITION_NOISE, make_paper_dataset
from intuitive_physics_predictor.noise_scales import NoiseScales
from intuitive_physics_predictor.scores.outcomes import Outcome, noisy_prediction

ENGINE = make_simulator("auto")
TIMES = np.array([0.1, 0.2])
FLOOR = Environment([Plane("floor", "floor", (0, 0, 1), 0.0)])
BALL = SceneObject("ball", "ball", Sphere(0.05))


def scene(**state) -> Scene:
    return Scene(FLOOR, (BALL,), (ObjectState((0, 0, 1), **state),))


def normal_prediction(spread: float, samples: int = 60):
    """Samples about the origin, whatever the scene."""

    def sample(outcome, rng):
        return spread * rng.standard_normal((samples, *outcome.positions.shape))

    return sample


def normal_outcomes(count: int) -> list[Outcome]:
    rng = np.random.default_rng(0)
    return [Outcome(scene(), TIMES, rng.standard_normal((1, 2, 3))) for _ in range(count)]


@pytest.mark.long
@pytest.mark.parametrize(("spread", "low", "high"), [(1.0, 0.86, 0.94), (0.5, 0.2, 0.5)])
def test_coverage_of_true_and_of_overconfident_predictions(spread, low, high):
    # Of 400 outcomes a true 90 % is off by sqrt(0.9 · 0.1 / 400) = 1.5 %. Half the spread makes
    # the 90 % ball, 2.5 σ of the samples, one of 1.25 σ of the outcomes: χ²₃ gives 33 %.
    scores = score(normal_outcomes(400), normal_prediction(spread), seed=1)
    assert ((scores.coverage(0.9) > low) & (scores.coverage(0.9) < high)).all()


def test_seeing_with_noise_is_part_of_the_prediction():
    # What happened has σ = 1, what was seen √2; the prediction knows the noise of seeing.
    rng = np.random.default_rng(3)
    outcomes = [
        Outcome(
            scene(),
            TIMES,
            np.sqrt(2.0) * rng.standard_normal((1, 2, 3)),
            np.broadcast_to(np.eye(3), (1, 2, 3, 3)),
        )
        for _ in range(300)
    ]
    assert np.abs(score(outcomes, normal_prediction(1.0), seed=1).coverage(0.9) - 0.9).max() < 0.06


def test_one_sample_has_a_score_and_no_regions():
    outcomes = normal_outcomes(5)
    scores = score(outcomes, normal_prediction(0.0, samples=1), seed=1)
    assert np.isnan(scores.coverage(0.9)).all()
    distances = [np.linalg.norm(outcome.positions[0], axis=1) for outcome in outcomes]
    np.testing.assert_allclose(scores.energy, distances)
    np.testing.assert_allclose(scores.error, distances)


def test_what_is_not_known_does_not_count():
    outcomes = normal_outcomes(3)
    outcomes[0].positions[0, 1] = np.nan
    scores = score(outcomes, normal_prediction(1.0), seed=1)
    np.testing.assert_array_equal(np.isnan(scores.energy).sum(axis=0), [0, 1])
    assert np.isfinite(scores.coverage(0.5)).all()


def test_free_flights_stop_where_one_does():
    outcome = Outcome(scene(linear_velocity=(1, 0, 0)), np.array([0.1, 3.0]), np.zeros((1, 2, 3)))
    samples = free_flights(3)(outcome, np.random.default_rng(0))
    truth = free_flight(FLOOR, 0.05, outcome.scene.states[0], outcome.times)
    np.testing.assert_allclose(samples, np.broadcast_to(truth, (3, 1, 2, 3)), atol=1e-12)


def test_fixed_noise_is_fixed():
    # Whatever was perceived: after t of flight N(0, σ) on position and velocity is σ √(1 + t²).
    outcome = Outcome(scene(covariance=np.eye(12)), TIMES, np.zeros((1, 2, 3)))
    way = fixed_noise(LearnedParameters.defaults(("ball", "floor")), 0.01, 4000, ENGINE)
    spread = way(outcome, np.random.default_rng(0)).std(axis=0)[0]
    np.testing.assert_allclose(
        spread, 0.01 * np.sqrt(1 + TIMES**2)[:, None] * np.ones(3), rtol=0.06
    )


@pytest.mark.parametrize("sigma", [0.001, 0.02])
def test_noise_of_a_bouncing_track_is_seen(sigma):
    rng = np.random.default_rng(2)
    times = np.arange(150) / 30
    positions = ENGINE.rollout(
        [scene(linear_velocity=(1, 0, 0))],
        StaticParameters.uniform(("ball", "floor"), restitution=0.8),
        times,
        orientations=False,
    ).positions[0, 0]
    track = Trajectory(times, positions + rng.normal(0.0, sigma, positions.shape))
    # Sevens overlap, so some forty independent ones hold no bounce: 1/√(2 · 12 · 40) = 3 %. Bounces
    # below the noise, near the end, count as noise.
    assert sigma * 0.85 < free_flight_noise(track) < sigma * 1.2


@pytest.fixture(scope="module")
def sphere_set():
    return make_paper_dataset(
        1, 40, np.random.default_rng(4), initial_states="flight", kinds=("sphere",)
    )


def test_stated_noise_of_a_track_that_bounces_often_gets_its_factor():
    # A bounce every ten points or so leaves a third of the groups of seven free; errors are 1.5
    # times what is stated, three times as large along the line of sight.
    rng = np.random.default_rng(6)
    factors = []
    for speed in np.linspace(0.5, 1.5, 12):
        times = np.arange(60) / 30
        positions = ENGINE.rollout(
            [scene(linear_velocity=(speed, 0, 0))],
            StaticParameters.uniform(("ball", "floor"), restitution=0.7),
            times,
            orientations=False,
        ).positions[0, 0]
        roots = np.diag([0.001, 0.001, 0.003])
        noisy = positions + 1.5 * rng.standard_normal(positions.shape) @ roots
        stated = np.broadcast_to(roots @ roots, (len(times), 3, 3))
        factors.append(free_flight_noise(Trajectory(times, noisy), stated))
    # Each track shows its factor to about 10 %, twelve of them to 3 %; bounces below the noise
    # count as noise.
    assert np.mean(factors) == pytest.approx(1.5, rel=0.12)


def test_paper_outcomes_are_what_truly_happened(sphere_set):
    runs = sphere_set.test
    outcomes = paper_outcomes(runs, sphere_set.parameters, ENGINE, 6, (0.5, 2.0))
    for run, outcome in zip(runs, outcomes, strict=True):
        # Points come at 30 Hz: 0.5 s and 2 s are 15 and 60 of them after the sixth.
        np.testing.assert_allclose(outcome.positions, run.positions[:, [20, 65]], atol=1e-9)
        np.testing.assert_allclose(outcome.times, [5 / 30 + 0.5, 5 / 30 + 2.0])
    noisy = paper_outcomes(
        runs, sphere_set.parameters, ENGINE, 6, (0.5, 2.0), np.random.default_rng(0)
    )
    for outcome in noisy:
        expected = np.broadcast_to(POSITION_NOISE**2 * np.eye(3), (1, 2, 3, 3))
        np.testing.assert_array_equal(outcome.covariances, expected)


def test_observed_outcomes_see_first_points_only(sphere_set):
    runs = sphere_set.test
    outcomes = observed_outcomes([run.observation for run in runs], 6, (0.5, 30.0))
    for run, outcome in zip(runs, outcomes, strict=True):
        track = run.observation.objects[0].trajectory
        np.testing.assert_array_equal(outcome.positions[0, 0], track.positions[20])
        assert np.isnan(outcome.positions[0, 1]).all()
        # The median of some 144 windows; their noise is known to a few percent.
        deviation = np.sqrt(outcome.covariances[0, 0, 0, 0])
        assert deviation == pytest.approx(POSITION_NOISE, rel=0.3)
    with pytest.raises(InvalidInputError, match="expected at least 500"):
        observed_outcomes([runs[0].observation], 500, (0.5,))


def test_detections_count_where_there_are_some(sphere_set):
    # A trajectory that was smoothed says nothing of its errors; the detections say what they are.
    run = sphere_set.test[0]
    observed = run.observation.objects[0]
    times = observed.trajectory.times
    rng = np.random.default_rng(5)
    truth = ENGINE.rollout([run.scene], sphere_set.parameters, times, orientations=False)
    roots = np.diag([0.001, 0.002, 0.004])
    detections = Detections(
        times,
        truth.positions[0, 0] + rng.standard_normal((len(times), 3)) @ roots,
        np.broadcast_to(roots @ roots, (len(times), 3, 3)),
        0.003**2 * np.eye(3),
    )
    observation = replace(run.observation, objects=(replace(observed, detections=detections),))
    (outcome,) = observed_outcomes([observation], 6, (0.5,))
    np.testing.assert_array_equal(outcome.positions[0, 0], detections.positions[20])
    # The track's own factor is the median of some 140 differences: known to 10 %.
    covariance = outcome.covariances[0, 0] - detections.bias
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.diag(roots), rtol=0.3)
    (known,) = outcome.scene.states
    exact = run.scene.states[0].linear_velocity
    variances = np.diag(known.covariance)[6:9]
    assert variances[0] < variances[1] < variances[2]
    assert (np.abs(known.linear_velocity - exact) < 4.0 * np.sqrt(variances)).all()


def test_more_points_are_judged_at_the_same_instants(sphere_set):
    runs, truth = sphere_set.test, sphere_set.parameters
    few, many = (
        paper_outcomes(runs, truth, ENGINE, points, (0.5, 2.0), ahead_of=10) for points in (3, 10)
    )
    for run, early, late in zip(runs, few, many, strict=True):
        np.testing.assert_array_equal(early.times, late.times)
        np.testing.assert_array_equal(early.positions, late.positions)
        np.testing.assert_allclose(early.positions, run.positions[:, [24, 69]], atol=1e-9)
        # Least squares: what more points leave open is never more.
        for less, more in zip(early.scene.states, late.scene.states, strict=True):
            assert np.linalg.eigvalsh(less.covariance - more.covariance).min() > -1e-12
    with pytest.raises(InvalidInputError, match="point 5 and 6 points are seen"):
        paper_outcomes(runs, truth, ENGINE, 6, ahead_of=5)


def test_the_truth_with_states_of_first_points_covers_what_it_says(sphere_set):
    # θ_s is known here, so only the states are uncertain. Of n trajectories a true 90 % is seen as
    # 90 % ± 30 / √n %; 3.5 σ are exceeded once in 2000, at one of four places once in 500.
    runs, truth = (*sphere_set.training, *sphere_set.test), sphere_set.parameters
    exact = LearnedParameters(
        truth, np.zeros(14), np.ones(14, dtype=bool), 1, 0.0, len(runs), "known"
    )
    for points in (3, 10):
        outcomes = paper_outcomes(runs, truth, ENGINE, points, (0.5, 2.0))
        scores = score(outcomes, noisy_prediction(exact, NoiseScales(), 60, ENGINE), seed=1)
        assert np.abs(scores.coverage(0.9) - 0.9).max() < 3.5 * 0.3 / np.sqrt(len(runs))


def test_calibration_on_spheres():
    options = CalibrationOptions(
        objects=1,
        throws=30,
        held_out=50,
        kinds=("sphere",),
        point_counts=(3, 10),
        horizons=(0.5, 1.0),
        samples=40,
        iterations=500,
        seed=2,
    )
    result = calibrate_on_paper_set(options)
    energy = {k: v.energy.mean() for k, v in result.calibration.scores.items()}
    assert energy[OURS] < min(energy["single rollout"], energy["free flight"])
    # Of 50 held-out throws 90 % is 90 ± 4 %; the noise fit adds some percent.
    summary = result.summary()
    assert all(0.7 < share <= 1.0 for share in summary["coverage_90"].values())
    assert summary["energy_score_vs_best_baseline"] == pytest.approx(
        result.calibration.energy_score_vs_best_baseline.max(), abs=1e-4
    )
    fitted = energy[FITTED]
    assert result.calibration.energy_score_vs_fitted_noise.min() <= energy[OURS] / fitted
    assert result.calibration.energy_score_vs_fitted_noise.max() >= energy[OURS] / fitted
    errors = {points: scores.error.mean() for points, scores in result.by_points.items()}
    assert errors[10] < errors[3]
    assert len(score_rows(result.calibration)) == 2 * len(energy)
    assert {row["prediction"] for row in reliability_rows(result.calibration)} == set(energy) - {
        "single rollout"
    }
    with pytest.raises(InvalidInputError, match="ask for more"):
        calibrate_on_paper_set(replace(options, throws=1))


@pytest.fixture(scope="module")
def detected_set(sphere_set):
    """Observations whose trajectories are what was detected, and say how noisy it is."""
    observations = []
    for run in (*sphere_set.training, *sphere_set.test):
        (observed,) = run.observation.objects
        track = observed.trajectory
        alike = np.broadcast_to(POSITION_NOISE**2 * np.eye(3), (len(track), 3, 3))
        detections = Detections(track.times, track.positions, alike, np.zeros((3, 3)))
        stated = replace(observed, detections=detections)
        observations.append(replace(run.observation, objects=(stated,)))
    return observations


@given(count=st.integers(2, 20), more=st.integers(0, 30), seed=st.integers(0, 2**32))
def test_each_observation_is_held_out_once(count, more, seed):
    everything = list(range(count + more))
    parts = splits_of(everything, count, seed)
    assert len(parts) == count
    assert sorted(each for _, held_out in parts for each in held_out) == everything
    for past, held_out in parts:
        assert sorted(past + held_out) == everything
        assert (past, held_out) == (sorted(past), sorted(held_out))
    sizes = [len(held_out) for _, held_out in parts]
    assert max(sizes) - min(sizes) <= 1


def test_one_split_holds_out_a_half_and_too_many_are_refused():
    ((past, held_out),) = splits_of(list(range(10)), 1, 3)
    assert (len(past), len(held_out)) == (5, 5)
    for count in (0, -1, 11):
        with pytest.raises(InvalidInputError, match="splits of 10 observations"):
            splits_of(list(range(10)), count, 0)


def test_states_of_detections_need_no_scale(detected_set):
    assert fitted_scales(detected_set) == ("spin", "static_parameters", "unidentified")
    silent = replace(detected_set[0].objects[0], detections=None)
    mixed = [*detected_set, replace(detected_set[0], objects=(silent,))]
    assert fitted_scales(mixed) == ("spin", "state", "static_parameters", "unidentified")


def test_pooled_scores_are_those_of_all_trajectories():
    outcomes = normal_outcomes(7)
    whole = score(outcomes, normal_prediction(1.0), seed=1)
    parts = Scores.pooled([Scores(*(v[at] for v in vars(whole).values())) for at in CUTS])
    for name, values in vars(whole).items():
        np.testing.assert_array_equal(getattr(parts, name), values)


CUTS = (slice(0, 2), slice(2, 7))


def test_the_error_of_a_ratio_is_that_of_repetitions():
    rng = np.random.default_rng(0)
    ratios, errors = [], []
    for _ in range(400):
        sizes = rng.gamma(2.0, 1.0, (100, 1))
        ratio, error = ratios_of_means(
            sizes * rng.uniform(0.5, 1.1, (100, 1)), sizes * rng.uniform(0.8, 1.2, (100, 1))
        )
        ratios.append(ratio[0])
        errors.append(error[0])
    # A standard deviation of 400 ratios is off by 1/√800 = 3.5 %; the mean is biased by 1/n.
    assert np.mean(ratios) == pytest.approx(0.8, rel=0.005)
    assert np.mean(errors) == pytest.approx(np.std(ratios), rel=0.12)


def test_nothing_scores_better_than_the_truth_in_its_own_world():
    # The energy score of N(0, s² I) on outcomes of N(0, I) in three dimensions is, with the mean
    # length 2 √(2/π) of a standard normal vector, m (√(1 + s²) - s / √2).
    outcomes = normal_outcomes(60)
    truth, length = normal_prediction(1.0), 2.0 * np.sqrt(2.0 / np.pi)
    for spread in (0.5, 1.0, 2.0):
        scores = ideal_energy_scores(outcomes, truth, normal_prediction(spread), seed=3)
        expected = length * (np.sqrt(1.0 + spread**2) - spread / np.sqrt(2.0))
        # 60 · 2 · 10 outcomes, each with a score that spreads by about 0.6: 2 %.
        assert scores.mean() == pytest.approx(expected, rel=0.06)
    outcomes[0].positions[0, 1] = np.nan
    scores = ideal_energy_scores(outcomes, truth, truth, seed=3)
    np.testing.assert_array_equal(np.isnan(scores).sum(axis=0), [0, 1])


@pytest.mark.long
def test_calibration_in_several_splits(detected_set, tmp_path):
    observations = detected_set[:12]
    options = CalibrationOptions(
        points=6, horizons=(0.3, 0.6), splits=3, samples=10, iterations=50, cores=2
    )
    calibrated = calibrate_on_observations(observations, options)
    result = calibrated.calibration
    assert isinstance(result, Calibration)
    assert calibrated.learned.observation_count == len(observations)
    assert len(result.fits) == len(result.fixed_deviations) == 3
    assert all(len(scores.energy) == len(observations) for scores in result.scores.values())
    spins = sorted(fit.scales.spin for fit in result.fits)
    assert result.scales.spin == spins[1]
    assert (result.ideal_energy_score_vs_fitted_noise > 0.0).all()
    write_calibration(tmp_path, "Calibration", result, calibrated.learned)
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "medians of 3 splits" in page
    assert page.count(f"| {len(observations)} |") == 2 * len(result.scores)
