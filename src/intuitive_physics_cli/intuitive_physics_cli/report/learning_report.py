"""A report on observations of one's own: learn from a part, predict the rest, show both."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.simulation import make_simulator
from intuitive_physics_cli.evaluation.evaluation import Evaluation, evaluate
from intuitive_physics_cli.evaluation.prediction_case import (
    LEVELS,
    PredictionCase,
    binomial_error,
    horizon_coverage,
    region_coverage,
)
from intuitive_physics_cli.evaluation.prequential import (
    AFTER_BOUNCE,
    FIRST_PART,
    LONGEST_WAIT,
    Predicted,
    predict_seen_parts,
)
from intuitive_physics_cli.report.report_page import (
    footer,
    heading,
    page,
    parameter_section,
    section,
    side_by_side,
    table,
)
from intuitive_physics_cli.report.report_plots import (
    SMALL_PLOT,
    cost_plot,
    coverage_plot,
    library_script,
    prediction_plot,
)
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search.parameter_search import SearchProgress

MOST_SHOWN = 6
"""Cases with a plot of their own."""

SUMMARY_LEVELS = (0.5, 0.9)
"""Regions whose coverage the text states."""


STATE_KNOWN = (
    f"The state of each ball is the predictor's estimate from its first {FIRST_PART:g} s, frame by "
    "frame; of other objects it is what perception knew then."
)
"""The beginning of predictions after the first part, plain text."""


def prediction_sections(predicted: Predicted, title: str, knowledge: str) -> list[str]:
    """Return sections of the worst cases, of all cases, and of calibration; none without cases.

    `title` and `known`, what the predictions knew, are plain text.
    """
    if not predicted.cases:
        return []
    worst = sorted(predicted.cases, key=lambda case: -case.error)
    shown = [
        f"<h3>{html.escape(case.name)}: {100.0 * case.error:.1f} cm</h3>"
        + prediction_plot(f"case-{number}", case, SMALL_PLOT)
        for number, case in enumerate(worst[:MOST_SHOWN])
    ]
    return [
        section(
            f"{title}: the worst first",
            side_by_side(shown),
            _all_cases(worst),
            introduction=f"The {len(shown)} worst of {len(worst)}; the number is the mean distance "
            "between the mean of the prediction and what was seen. Drag to turn, scroll to zoom.",
        ),
        _calibration(predicted, knowledge + _left_out(predicted.left_out)),
    ]


def _all_cases(worst: Sequence[PredictionCase]) -> str:
    rows = [
        (
            case.name,
            f"{case.times[-1]:.2f}",
            f"{case.error:.3f}",
            f"{case.distances[-1]:.3f}",
            f"{case.spread.mean():.3f}",
        )
        for case in worst
    ]
    header = ("", "seen for (s)", "mean error (m)", "last error (m)", "mean spread (m)")
    return table(header, rows)


def _left_out(count: int) -> str:
    if count == 0:
        return ""
    return (
        f" Left out: {count}, of which the state was not known within {LONGEST_WAIT:g} s after "
        "that or nothing was seen later."
    )


def _calibration(predicted: Predicted, knowledge: str) -> str:
    moments = [(f"After the first {FIRST_PART:g} s", "coverage", predicted.cases)]
    if predicted.bounced:
        title = f"After {AFTER_BOUNCE} detections since the first bounce"
        moments.append((title, "coverage-after-bounce", predicted.bounced))
    return section(
        "Is the spread honest?",
        *(_calibration_at(*moment) for moment in moments),
        introduction=f"{html.escape(knowledge)} Balls are predicted again from what was seen until "
        f"{AFTER_BOUNCE} detections after their first bounce. Shares are of the points seen after "
        "that which lie in the regions of the predictions. ± is the binomial standard error of as "
        "many motions, as the points of one go together; the band in the plot is as wide. Below "
        "the band predictions are too confident, above it too cautious.",
    )


def _calibration_at(title: str, name: str, cases: Sequence[PredictionCase]) -> str:
    """Coverage of predictions from one moment, under a title, as plots of a name."""
    count = len(cases)
    shares = region_coverage(cases, np.random.default_rng(0))
    claims = ", ".join(
        f"those that claim {100.0 * level:.0f} % hold "
        + _share(shares[int(np.abs(LEVELS - level).argmin())], level, count)
        for level in SUMMARY_LEVELS
    )
    plots = side_by_side([coverage_plot(name, shares, count), _horizon_table(cases)])
    return f"<h3>{title}</h3><p>Of the regions of {count} motions, {claims}.</p>{plots}"


def _horizon_table(cases: Sequence[PredictionCase]) -> str:
    """One point of each motion at each time ahead, so that all are independent."""
    rows = [
        (
            f"{coverage.horizon:g}",
            f"{coverage.count}",
            *(
                _share(share, level, coverage.count)
                for share, level in zip(coverage.shares, SUMMARY_LEVELS, strict=True)
            ),
        )
        for coverage in horizon_coverage(cases, SUMMARY_LEVELS, np.random.default_rng(0))
    ]
    regions = (f"in the {100.0 * level:.0f} % region" for level in SUMMARY_LEVELS)
    return table(("s ahead", "motions seen then", *regions), rows)


def _share(share: float, claimed: float, count: int) -> str:
    """A share of `count` motions, with its standard error if the claim is true."""
    return f"{100.0 * share:.0f} ± {100.0 * binomial_error(claimed, count):.0f} %"


SAMPLE_COUNT = 100
"""Simulations of each prediction in a report."""


@dataclass(frozen=True, eq=False)
class LearningReport:
    """The contents of a report.

    Parameters
    ----------
    title : of the observations, plain text
    evaluation : what was learned, and errors
    predicted : predictions of the observations that were not learned from
    about : how it was made
    """

    title: str
    evaluation: Evaluation
    predicted: Predicted
    about: Mapping[str, str]


def make_learning_report(
    title: str,
    observations: Sequence[Observation],
    options: LearningOptions,
    train_fraction: float,
    engine: str,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> LearningReport:
    """Learn from a part of the observations and predict the others from what was seen first."""
    evaluation = evaluate(observations, options, train_fraction, engine, on_progress)
    learned = evaluation.result.learned.extended(observation_materials(observations))
    predicted = predict_seen_parts(
        evaluation.test,
        learned,
        make_simulator(engine),
        np.random.default_rng(options.seed),
        SAMPLE_COUNT,
    )
    about = {
        "observations": str(len(observations)),
        "learned from": str(len(evaluation.training)),
        "update rule": options.method,
        "engine": engine,
        "seed": str(options.seed),
    }
    return LearningReport(title, evaluation, predicted, about)


def write_learning_report(report: LearningReport, path: Path) -> None:
    """Write the report as one page of HTML that needs nothing else."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_page(report), encoding="utf-8")
    except OSError as error:
        raise InvalidInputError(f"cannot write the report {path}: {error.strerror}") from None


def _page(report: LearningReport) -> str:
    evaluation = report.evaluation
    default = evaluation.errors["default parameters"][0].mean
    flight = evaluation.errors["free flight"][0].mean
    numbers = {
        "error_in_test_m": evaluation.errors["learned parameters"][1].mean,
        "with_default_parameters_m": evaluation.errors["default parameters"][1].mean,
        "in_free_flight_m": evaluation.errors["free flight"][1].mean,
    }
    introduction = (
        f"From {len(evaluation.training)} observations the material parameters were learned that "
        f"make a simulation do the same; the other {len(evaluation.test)} were predicted from "
        "what was seen of them first."
    )
    sections = [
        section("What was learned", parameter_section(evaluation.result.learned)),
        section(
            "How the cost fell",
            cost_plot(
                "cost",
                evaluation.result.search.history,
                {"default parameters": default, "free flight": flight},
            ),
            _error_table(evaluation),
            introduction="J is the mean distance between simulated and observed trajectories of "
            "the observations learned from.",
        ),
        *prediction_sections(
            report.predicted,
            "Predictions of what was not learned from",
            f"The parameters were learned from the {len(evaluation.training)} other observations. "
            f"{STATE_KNOWN} Where there are no detections, it is the initial state that came with "
            "the observation.",
        ),
    ]
    head = heading(report.title, introduction, numbers)
    title = f"Intuitive physics: {report.title}"
    return page(title, library_script(), head, sections, footer(report.about))


def _error_table(evaluation: Evaluation) -> str:
    rows = [
        (name, *(f"{value:.4f}" for e in errors for value in (e.mean, e.last)))
        for name, errors in evaluation.errors.items()
    ]
    header = ("error (m)", "learned from: mean", "last point", "predicted: mean", "last point")
    return table(header, rows)
