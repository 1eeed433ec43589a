"""Sec. VI, Figs. 7 to 9: thrown balls of 3, 5 and 7 cm, seen by a depth camera, learned, predicted.

The paper's own recordings are not public: throws are rendered, with the faults of a real depth
camera, and go through the whole perception pipeline. Each ball is learned alone, from all its
throws as in the paper, and once more from 80 % of them to predict the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import make_simulator
from intuitive_physics_cli.evaluation.evaluation import split
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase, predict_cases
from intuitive_physics_cli.evaluation.recording_perception import perceive_recording
from intuitive_physics_cli.report.figure_style import DEFAULT, OBSERVED, PREDICTED, TRUE
from intuitive_physics_experiments.demo.demo_result import example_frame
from intuitive_physics_experiments.demo.figures import draw_frame
from intuitive_physics_experiments.paper.prediction import draw_predictions
from intuitive_physics_experiments.paper.settings import RgbdSettings
from intuitive_physics_experiments.rendering.corner_room import (
    BALL_RADII,
    ROOM_MATERIAL,
    true_parameters,
)
from intuitive_physics_experiments.rendering.ground_truth import GroundTruth
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, reuse_or_render_bag
from intuitive_physics_experiments.results import CellStore, Figure, Results, Row, markdown_table
from intuitive_physics_learner.cost.cost_function import TrajectoryCost
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_learner.search.parameter_search import ConvergenceCriteria
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings
from intuitive_physics_recordings.observation_files import load_observations, save_observations


def _draw_errors_by_size(figure: Any, rows: Sequence[Row]) -> None:
    """Draw mean ± σ of each error for each ball, the smallest first."""
    axes = figure.add_subplot()
    ordered = sorted(rows, key=lambda row: row["radius"])
    places = np.arange(len(ordered))
    kinds = (
        ("learned", "learned", PREDICTED),
        ("test", "throws not learned from", OBSERVED),
        ("true_parameters", "true parameters", TRUE),
        ("default", "default parameters", DEFAULT),
    )
    for k, (name, label, color) in enumerate(kinds):
        axes.bar(
            places + 0.2 * (k - 1.5),
            [1e3 * row[name] for row in ordered],
            0.18,
            yerr=[1e3 * row[f"{name}_deviation"] for row in ordered],
            color=color,
            alpha=0.8,
            error_kw={"lw": 1.0, "ecolor": "#374151"},
            label=label,
        )
    axes.set_xticks(places, [f"{100.0 * row['radius']:.0f} cm, {row['ball']}" for row in ordered])
    axes.set(xlabel="radius", ylabel="mean distance (mm)")
    axes.set_ylim(bottom=0.0)
    axes.grid(axis="y")
    axes.set_axisbelow(True)
    axes.legend()


TRAIN_FRACTION = 0.8  # Share of a ball's throws that is learned from
BAG_NAME = "throws"  # Folder of the rendered bag


def run(settings: RgbdSettings, store: CellStore) -> Results:
    """Render, perceive, learn each ball and predict some of its throws."""
    observations, perceived = _observations(settings, store)
    by_ball = {
        material: [
            observation
            for observation in observations
            if observation.objects[0].object.material == material
        ]
        for material in BALL_RADII
    }
    engine = make_simulator("auto", store.cores)

    def learned(observations: Sequence[Observation]) -> StaticParameters:
        options = LearningOptions(
            criteria=ConvergenceCriteria(max_iterations=settings.iterations), seed=settings.seed
        )
        return learn(observations, engine, options).learned.parameters

    def ball(material: str) -> dict[str, Any]:
        throws = by_ball[material]
        training, test = split(throws, TRAIN_FRACTION, settings.seed)
        from_all, from_part = learned(throws), learned(training)
        default = StaticParameters.uniform(from_all.materials)
        judged = [from_all, true_parameters().extended(from_all.materials), default]
        whole = TrajectoryCost(throws, engine, from_all.materials).observation_costs(judged)
        unseen = TrajectoryCost(test, engine, from_part.materials).observation_costs([from_part])
        return {
            "learned": whole[0].tolist(),
            "true_parameters": whole[1].tolist(),
            "default": whole[2].tolist(),
            "test": unseen[0].tolist(),
            "parameters": from_part.to_dict(),
        }

    cells = store.run({f"ball_{material}": partial(ball, material) for material in by_ball}, 1)
    rows = [_row(material, cells[f"ball_{material}"]) for material in by_ball]
    cases: list[PredictionCase] = []
    for material, throws in by_ball.items():
        _, test = split(throws, TRAIN_FRACTION, settings.seed)
        theta = StaticParameters.from_dict(cells[f"ball_{material}"]["parameters"])
        rng = np.random.default_rng([settings.seed, 1 + len(cases)])
        cases += predict_cases(test[:1], theta, engine, rng, sample_count=20)
    example = example_frame(
        store.folder / BAG_NAME,
        observations[0],
        GroundTruth.load(store.folder / BAG_NAME).camera,
        np.array(perceived["rotation"]),
        np.array(perceived["translation"]),
    )
    return Results(
        "Thrown balls by a depth camera (Figs. 7 to 9)",
        _body(rows),
        {"errors_by_size.csv": rows, "throws.csv": _throw_rows(cells, by_ball)},
        {
            "errors_by_size.png": Figure((7.0, 4.0), partial(_draw_errors_by_size, rows=rows)),
            "predictions.png": Figure((12.0, 4.0), partial(draw_predictions, cases=cases)),
            "seen.png": Figure((9.0, 7.0), lambda fig: draw_frame(fig.add_subplot(), example)),
        },
    )


def _observations(
    settings: RgbdSettings, store: CellStore
) -> tuple[list[Observation], dict[str, Any]]:
    """Observations of the rendered throws, kept in `observations`, and the pose of the camera."""
    bag, kept = store.folder / BAG_NAME, store.folder / "observations"

    def render() -> dict[str, Any]:
        render_settings = RenderSettings(
            throws=settings.throws * len(BALL_RADII),
            seed=settings.seed,
            throw_duration=settings.duration,
        )
        truth = reuse_or_render_bag(
            bag, render_settings, lambda done, total: store.on_progress(done, total, "rendering")
        )
        return {"throws": len(truth.throws)}

    def perceive() -> dict[str, Any]:
        balls = tuple(KnownObject(name, radius, name) for name, radius in BALL_RADII.items())
        recording = perceive_recording(
            bag,
            PerceptionSettings(known_objects=balls, plane_material=ROOM_MATERIAL),
            np.random.default_rng(settings.seed),
            on_progress=lambda done, total: store.on_progress(done, total, "perceiving"),
        )
        save_observations(recording.observations, kept)
        if recording.model is None:
            raise InvalidInputError(f"no environment was found in {bag}; expected that of a corner")
        return {
            "rotation": recording.model.rotation.tolist(),
            "translation": recording.model.translation.tolist(),
        }

    cells = store.run({"render": render, "perceive": perceive}, 1)
    return load_observations(kept), cells["perceive"]


def _row(material: str, cell: dict[str, Any]) -> Row:
    row: Row = {
        "ball": material,
        "radius": BALL_RADII[material],
        "observations": len(cell["learned"]),
    }
    for name in ("learned", "test", "true_parameters", "default"):
        row[name] = float(np.mean(cell[name]))
        row[f"{name}_deviation"] = float(np.std(cell[name]))
    return row


def _throw_rows(cells: dict[str, Any], by_ball: dict[str, list[Observation]]) -> list[Row]:
    return [
        {
            "ball": material,
            "observation": observation.id,
            "duration": observation.objects[0].trajectory.duration,
            **{
                name: cells[f"ball_{material}"][name][k]
                for name in ("learned", "true_parameters", "default")
            },
        }
        for material, observations in by_ball.items()
        for k, observation in enumerate(observations)
    ]


def _body(rows: Sequence[Row]) -> str:
    names = ("learned", "test", "true_parameters", "default")
    lines = [
        [
            row["ball"],
            f"{100.0 * row['radius']:.0f}",
            str(row["observations"]),
            *(f"{1e3 * row[name]:.1f} ± {1e3 * row[f'{name}_deviation']:.1f}" for name in names),
        ]
        for row in rows
    ]
    header = ["ball", "radius (cm)", "throws", *(f"{n.replace('_', ' ')} (mm)" for n in names)]
    return (
        "Mean ± σ over throws of the mean distance between simulated and seen trajectories. "
        "Learned: from all throws of that ball, as in the paper. Test: a fifth of the throws, "
        "predicted with what the others taught. True parameters: those the balls obeyed. "
        f"Default: nothing learned.\n\n{markdown_table(header, lines)}\n\n"
        "![A frame, and what was found in it](seen.png)\n\n"
        "![Errors by size](errors_by_size.png)\n\n![Predictions of throws that were not learned "
        "from](predictions.png)"
    )
