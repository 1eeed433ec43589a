"""Accuracy of estimated states and spins, and of predictions, of table-tennis balls.

Flights of even number are learned from (`fit_prior`), the others are not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.recorded_sets.flight_estimation import (
    STATE_SIZE,
    BallEstimate,
    BallModel,
    BallPrior,
    estimate_ball,
    flight_axes,
)
from intuitive_physics_experiments.recorded_sets.spin_flights import SpinFlight

# s beyond the bounce, or beyond the last row seen, at which predictions are compared.
WINDOW = (0.08, 0.2)

SEEN_BEYOND = 0.1  # s beyond the bounce that are seen before the second prediction
FREE_SPAN = 0.25  # s of a flight without a bounce that are learned from
FEWEST_BEFORE, FEWEST_AFTER = 8, 8  # Rows before and after a bounce of flights that are scored
ROUNDS = 5  # Rounds in which the prior is learned
MISFIT = 1.3  # Median residual over the noise above which a flight is not learned from

# Standard deviation of each coefficient from flight to flight, at least.
LEAST_SPREAD = np.array([0.02, 0.015, 0.02, 0.015, 0.015, 0.001, 0.0005])

ROBUST_DEVIATION = 1.4826  # Standard deviation of a Gaussian over its median absolute deviation
LABEL_PRECISION = (8.0, 0.06)  # rad/s, and share of its size, by which a measured spin may be wrong
FREE_LABEL = 100.0  # rad/s, of the measured spin along the flight, which is not used
LIKELY_LABEL = 0.6  # Probability that a measured spin is of this flight
FEWEST_AHEAD = 5  # Rows in the window of a prediction that is compared
NO_SPIN = 0.1  # rad/s, standard deviation of a spin that is known to be none

# rad/s, means of the Gaussians that describe how balls spin about the level axis.
LEVEL_SPINS = np.arange(-450.0, 451.0, 75.0)

LEVEL_SPREAD = 40.0  # rad/s, standard deviation of each
RAREST = 0.005  # Weight of each Gaussian at least: spins that were not thrown yet

# The prior before anything is learned
START = BallPrior(
    np.array([0.52, 0.25, 0.28, 0.98, 0.23, -0.0043, 0.0086]),
    np.diag([0.04, 0.03, 0.05, 0.03, 0.02, 0.0015, 0.001]) ** 2,
    np.outer(LEVEL_SPINS, [1.0, 0.0, 0.0]),
    np.diag([LEVEL_SPREAD, 130.0, 100.0]) ** 2,
    np.full(len(LEVEL_SPINS), 1.0 / len(LEVEL_SPINS)),
)

SMOOTHED, SPINLESS = "estimated spin", "no spin"  # Ways to predict

# Positions (k, 3) m at times (k,) s, of rows that were seen: times (n,) s, positions (n, 3) m.
Predictor = Callable[
    [NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]
]


@dataclass(frozen=True, eq=False)
class FlightScore:
    """Errors of one flight with a bounce."""

    name: str  # of the flight
    # (2,) rad/s, the measured spin across the flight at the bounce: level, and upward
    measured: NDArray[np.float64]
    # before, after: (2,) rad/s, estimated from the rows before the bounce, and through it
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    deviation: NDArray[np.float64]  # (2,) rad/s, standard deviation of `after`
    # log odds by the rows before the bounce that the measured spin is of this flight
    label_odds: float
    # by the way to predict, m, median error from what was seen before the bounce
    beyond_bounce: dict[str, float]
    # by the way to predict, m, median error from what was seen until shortly after it
    beyond_seen: dict[str, float]

    @property
    def relative_error(self) -> float:
        """Relative error of the spin across the flight, estimated through the bounce."""
        return float(np.linalg.norm(self.after - self.measured) / np.linalg.norm(self.measured))


@dataclass(frozen=True, eq=False)
class FlightEvaluation:
    """Errors of a set of flights."""

    prior: BallPrior  # learned from the flights of even number
    # training, test: scores of the flights of even and of odd number that `bounces_well`
    training: list[FlightScore]
    test: list[FlightScore]
    counts: tuple[int, int]  # flights of even and of odd number, with a bounce or without


def evaluate_flights(
    flights: Sequence[SpinFlight], progress: Callable[[int, int], None]
) -> FlightEvaluation:
    """Learn from half of the flights, estimate and predict both halves; progress is of steps."""
    model, halves = BallModel(), (training_half(flights), test_half(flights))
    scored = [[flight for flight in half if bounces_well(flight)] for half in halves]
    total = ROUNDS * len(learned_from(halves[0])) + sum(map(len, scored))
    done = iter(range(1, total + 1))
    prior = fit_prior(model, halves[0], progress=lambda: progress(next(done), total))
    predictors = {
        SMOOTHED: smoothing_predictor(model, prior),
        SPINLESS: smoothing_predictor(model, without_spin(prior)),
    }
    scores: list[list[FlightScore]] = [[], []]
    for half, half_scores in zip(scored, scores, strict=True):
        for flight in half:
            half_scores.append(score_flight(model, prior, predictors, flight))
            progress(next(done), total)
    return FlightEvaluation(prior, scores[0], scores[1], (len(halves[0]), len(halves[1])))


def training_half(flights: Sequence[SpinFlight]) -> list[SpinFlight]:
    """Flights of even number."""
    return [flight for flight in flights if int(flight.name[-3:]) % 2 == 0]


def test_half(flights: Sequence[SpinFlight]) -> list[SpinFlight]:
    """Flights of odd number."""
    return [flight for flight in flights if int(flight.name[-3:]) % 2 == 1]


def bounces_well(flight: SpinFlight) -> bool:
    """Whether enough of it was seen before and after the bounce to be scored."""
    if flight.bounce is None or flight.bounce < FEWEST_BEFORE:
        return False
    return len(flight.times) - flight.bounce > FEWEST_AFTER


def learned_from(flights: Sequence[SpinFlight]) -> list[SpinFlight]:
    """Flights that `fit_prior` uses: all but those whose bounce was not seen well."""
    return [flight for flight in flights if flight.bounce is None or bounces_well(flight)]


def fit_prior(
    model: BallModel,
    flights: Sequence[SpinFlight],
    progress: Callable[[], None] = lambda: None,
) -> BallPrior:
    """Learn how coefficients and spins vary from flight to flight.

    Expectation maximisation: estimate each flight, then take medians of the estimates. A measured
    spin is used where it explains the flight better than a spin that was not measured.
    """
    used = learned_from(flights)
    bounced = np.array([flight.bounce is not None for flight in used])
    if bounced.sum() < 4:
        raise InvalidInputError(
            f"{bounced.sum()} flights to learn from have a bounce; expected at least four"
        )
    prior = START
    for _ in range(ROUNDS):
        estimates = []
        for flight in used:
            estimates.append(_best_estimate(model, prior, flight))
            progress()
        good = np.array([misfit < MISFIT for _, misfit in estimates])
        best = [(estimate, estimate.likeliest) for estimate, _ in estimates]
        means = np.array([estimate.unknowns[k, STATE_SIZE:] for estimate, k in best])
        spreads = np.array([np.diag(estimate.covariances[k])[STATE_SIZE:] for estimate, k in best])
        chosen = good & bounced
        mean = np.median(means[chosen], axis=0)
        scatter = ROBUST_DEVIATION * np.median(np.abs(means[chosen] - mean), axis=0)
        variance = np.maximum(np.median(spreads[chosen], axis=0) + scatter**2, LEAST_SPREAD**2)
        all_estimates = [estimate for estimate, _ in estimates]
        prior = replace(
            prior,
            coefficients=mean,
            coefficient_covariance=np.diag(variance),
            spin_weights=_spin_weights(prior, all_estimates),
            spin_covariance=_spin_covariance(list(compress(all_estimates, chosen))),
        )
    return prior


def _spin_covariance(estimates: Sequence[BallEstimate]) -> NDArray[np.float64]:
    """Covariance (3, 3) (rad/s)² about the flight's axes of a Gaussian of the prior.

    How the upward spin and the one along the flight go together follows from where they were
    estimated through a bounce: a ball that is shot with a tilted axis has both.
    """
    moments = []
    for estimate in estimates:
        best = estimate.likeliest
        across = flight_axes(estimate.unknowns[best, 3:6])[1:]
        spin = across @ estimate.unknowns[best, 6:9]
        covariance = across @ estimate.covariances[best, 6:9, 6:9] @ across.T
        moments.append(np.outer(spin, spin) + covariance)
    covariance_about_axes = np.diag([LEVEL_SPREAD**2, 0.0, 0.0])
    covariance_about_axes[1:, 1:] = np.mean(moments, axis=0)
    return covariance_about_axes


def _spin_weights(prior: BallPrior, estimates: Sequence[BallEstimate]) -> NDArray[np.float64]:
    """Share of estimated spins that comes from each Gaussian of the prior."""
    counts = np.full(len(prior.spin_means), RAREST * len(estimates))
    for estimate in estimates:
        velocity = estimate.unknowns[estimate.likeliest, 3:6]
        levels = estimate.unknowns[:, 6:9] @ flight_axes(velocity)[0]
        apart = (levels[:, None] - prior.spin_means[:, 0]) / LEVEL_SPREAD
        shares = np.exp(-0.5 * (apart**2 - (apart**2).min(axis=1, keepdims=True)))
        counts += estimate.weights @ (shares / shares.sum(axis=1, keepdims=True))
    return counts / counts.sum()


def _spin_in_flight(flight: SpinFlight) -> NDArray[np.float64]:
    rows = slice(0, FEWEST_BEFORE)
    slope = np.polyfit(flight.times[rows], flight.positions[rows], 1)[0]
    return flight_axes(slope) @ flight.spin


def _best_estimate(
    model: BallModel, prior: BallPrior, flight: SpinFlight
) -> tuple[BallEstimate, float]:
    """Estimate with the measured spin, or without it if that is likelier, and the misfit."""
    end = FREE_SPAN if flight.bounce is None else flight.times[flight.bounce] + WINDOW[1]
    times, positions = _rows_until(flight, float(end))
    with_label = estimate_ball(model, _labelled(prior, flight), times, positions)
    without = estimate_ball(model, prior, times, positions)
    odds = np.log(LIKELY_LABEL / (1.0 - LIKELY_LABEL))
    best = with_label if with_label.log_evidence + odds > without.log_evidence else without
    residuals = np.abs(best.predict(model, times) - positions) / prior.noise
    return best, float(np.median(residuals))


def _labelled(prior: BallPrior, flight: SpinFlight) -> BallPrior:
    """The prior of a flight whose spin across it is the measured one."""
    label = _spin_in_flight(flight)
    deviation = np.full(3, LABEL_PRECISION[0] + LABEL_PRECISION[1] * np.linalg.norm(label))
    label[2], deviation[2] = 0.0, FREE_LABEL
    return replace(
        prior,
        spin_means=label[None],
        spin_covariance=np.diag(deviation**2),
        spin_weights=np.ones(1),
    )


def _rows_until(
    flight: SpinFlight, end: float, *, before: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and positions of the rows until then, or before it."""
    rows = int(np.searchsorted(flight.times, end, side="left" if before else "right"))
    return flight.times[:rows], flight.positions[:rows]


def smoothing_predictor(model: BallModel, prior: BallPrior) -> Predictor:
    """Predict by `estimate_ball`."""

    def predict(
        times: NDArray[np.float64], positions: NDArray[np.float64], asked: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return estimate_ball(model, prior, times, positions).predict(model, asked)

    return predict


def without_spin(prior: BallPrior) -> BallPrior:
    """Return the prior of balls that are known not to spin."""
    return replace(
        prior,
        spin_means=np.zeros((1, 3)),
        spin_covariance=np.eye(3) * NO_SPIN**2,
        spin_weights=np.ones(1),
    )


def score_flight(
    model: BallModel, prior: BallPrior, predictors: Mapping[str, Predictor], flight: SpinFlight
) -> FlightScore:
    """Estimate the spin of a flight that `bounces_well`, and predict it in every way."""
    assert flight.bounce is not None
    bounce = float(flight.times[flight.bounce])
    last = slice(max(0, flight.bounce - FEWEST_BEFORE), flight.bounce)
    across = flight_axes(np.polyfit(flight.times[last], flight.positions[last], 1)[0])[:2]
    free = _rows_until(flight, bounce, before=True)
    before = estimate_ball(model, prior, *free)
    labelled = estimate_ball(model, _labelled(prior, flight), *free)
    after = estimate_ball(model, prior, *_rows_until(flight, bounce + WINDOW[1]))
    return FlightScore(
        flight.name,
        across @ flight.spin,
        across @ before.spin,
        across @ after.spin,
        np.sqrt(np.diag(across @ after.spin_covariance @ across.T)),
        labelled.log_evidence - before.log_evidence,
        *predicted_errors(predictors, flight),
    )


def predicted_errors(
    predictors: Mapping[str, Predictor], flight: SpinFlight
) -> tuple[dict[str, float], dict[str, float]]:
    """Errors beyond the bounce and beyond what was seen shortly after it, as in `FlightScore`."""
    assert flight.bounce is not None
    bounce = float(flight.times[flight.bounce])
    before = _rows_until(flight, bounce, before=True)
    shortly_after = _rows_until(flight, bounce + SEEN_BEYOND)
    return (
        _errors(predictors, flight, before, bounce),
        _errors(predictors, flight, shortly_after, bounce + SEEN_BEYOND),
    )


def _errors(
    predictors: Mapping[str, Predictor],
    flight: SpinFlight,
    rows_seen: tuple[NDArray[np.float64], NDArray[np.float64]],
    since: float,
) -> dict[str, float]:
    """Median over the window's rows, of which some may be no ball; NaN where there are too few."""
    ahead = flight.times - since
    rows = (ahead >= WINDOW[0]) & (ahead <= WINDOW[1])
    if rows.sum() < FEWEST_AHEAD:
        return dict.fromkeys(predictors, np.nan)
    return {
        name: float(
            np.median(
                np.linalg.norm(
                    predict(*rows_seen, flight.times[rows]) - flight.positions[rows], axis=1
                )
            )
        )
        for name, predict in predictors.items()
    }
