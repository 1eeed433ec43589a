"""What stands there from the start becomes boxes; objects and what moves do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics_perception.detection.foreground import ForegroundFinder
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.static_boxes import (
    MIN_THICKNESS,
    StaticBoxFilter,
    with_static_boxes,
)
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

FRAMES = 4
SETTINGS = PerceptionSettings(environment_frames=FRAMES)
CRATE = (1.5, 0.2, 0.1)
"""m, centre of a box of 16 x 22 x 20 cm, which is no plane of a room."""

CRATE_EDGES = (0.16, 0.22, 0.2)


@pytest.fixture(scope="module")
def room(make_room):
    return make_room(tilt=30.0, seed=9)


def frames_of(room, *, balls=((),) * FRAMES, extra=()):
    return [room.points(frame_balls, extra) for frame_balls in balls]


def boxes_in(frames, settings=SETTINGS):
    rng = np.random.default_rng(0)
    model = model_environment(frames, settings, rng)
    return with_static_boxes(model, frames, settings, rng).environment.boxes


def test_an_empty_room_has_no_boxes(room) -> None:
    assert boxes_in(frames_of(room)) == ()


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_a_crate_is_a_box_that_stands_on_the_floor(room, shapes, turn) -> None:
    """Its front and top are seen; the sides by the pixel, 4 mm here, and by its noise."""
    (box,) = boxes_in(frames_of(room, extra=[shapes["box"](CRATE, CRATE_EDGES, turn)]))
    assert box.center == pytest.approx(CRATE, abs=0.015)
    assert sorted(box.edge_lengths) == pytest.approx(sorted(CRATE_EDGES), abs=0.02)
    assert box.center[2] - 0.5 * box.edge_lengths[2] == pytest.approx(0.0, abs=0.003)
    assert box.material == SETTINGS.plane_material
    quarter = 2 * np.arctan2(box.orientation[2], box.orientation[3]) - turn
    assert abs((quarter + np.pi / 4) % (np.pi / 2) - np.pi / 4) < np.radians(4.0)


def test_a_board_that_one_sees_under_hangs_in_the_air(room, shapes) -> None:
    (box,) = boxes_in(
        frames_of(room, extra=[shapes["box"]((1.5, 0.2, 0.4), (0.25, 0.3, 0.01), 0.0)])
    )
    assert box.center[2] == pytest.approx(0.4, abs=0.02)
    assert MIN_THICKNESS <= box.edge_lengths.min() < 0.04


def test_a_top_whose_sides_give_no_reading_stands_on_the_floor(room, shapes) -> None:
    """As of something black: rays that would pass below the top give no reading either."""
    frames = frames_of(room, extra=[shapes["box"](CRATE, CRATE_EDGES, 0.0)])
    for frame in frames:
        places = frame @ room.rotation.T + room.origin
        away = np.abs(places[..., :2] - CRATE[:2]) < 0.5 * np.array(CRATE_EDGES[:2]) + 0.02
        frame[away.all(axis=-1) & (places[..., 2] > 0.01) & (places[..., 2] < 0.185)] = np.nan
    (box,) = boxes_in(frames)
    assert box.center[2] - 0.5 * box.edge_lengths[2] == pytest.approx(0.0, abs=0.003)
    assert box.center[2] + 0.5 * box.edge_lengths[2] == pytest.approx(0.2, abs=0.02)


def test_a_ball_at_rest_is_an_object_and_no_box(room) -> None:
    ball = ((1.5, 0.0, 0.07), 0.07)
    assert boxes_in(frames_of(room, balls=[[ball]] * FRAMES)) == ()


@pytest.mark.parametrize("height", [0.3, 0.6])
def test_a_small_ball_far_away_is_no_box_either(room, height) -> None:
    """Of its 150 pixels a quarter is left in the frame that boxes are made of."""
    ball = ((2.3, 0.3, height), 0.03)
    assert boxes_in(frames_of(room, balls=[[ball]] * FRAMES)) == ()


def test_only_what_was_there_before_is_a_box(room, shapes) -> None:
    frames = frames_of(room, extra=[shapes["box"](CRATE, CRATE_EDGES, 0.0)])
    rng = np.random.default_rng(0)
    model = with_static_boxes(model_environment(frames, SETTINGS, rng), frames, SETTINGS, rng)
    found, boxes = (
        ForegroundFinder(model, SETTINGS).find(frames[0]),
        StaticBoxFilter(model, SETTINGS),
    )
    crate, new = found.indices[:1], [True]
    assert not boxes.without(frames[0], replace(found, indices=crate, new=[False])).indices
    assert boxes.without(frames[0], replace(found, indices=crate, new=new)).new == new


def test_what_moves_is_no_box(room) -> None:
    balls = [[((1.4, -0.5 + 0.3 * k, 0.3), 0.07)] for k in range(FRAMES)]
    assert boxes_in(frames_of(room, balls=balls)) == ()


def test_what_is_too_large_for_one_box_is_left_out(room, shapes) -> None:
    frames = frames_of(room, extra=[shapes["cylinder"](1.5, 0.0, 0.1, 0.3)])
    (box,) = boxes_in(frames)
    assert box.edge_lengths[2] == pytest.approx(0.3, abs=0.02)
    assert boxes_in(frames, replace(SETTINGS, static_box_max_size=0.25)) == ()


def test_boxes_are_part_of_the_environment_unless_they_are_left_out(room, shapes) -> None:
    frames = frames_of(room, extra=[shapes["box"](CRATE, CRATE_EDGES, 0.0)])
    for wanted in (True, False):
        settings = replace(SETTINGS, static_boxes=wanted)
        pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
        result = [pipeline.process(frame, 0.1 * k) for k, frame in enumerate(frames)][-1]
        assert len(result.model.environment.boxes) == int(wanted)
        assert len(result.model.seen_environment().boxes) == int(wanted)


def test_a_box_that_lies_there_from_the_start_is_an_object_where_solids_are_objects(
    make_small_room, shapes
) -> None:
    """Pushed later, it slides 1 m/s along y without friction, 33 cm in 10 frames."""
    small = make_small_room(tilt=30.0, seed=9, focal=262.5)
    step, resting, pushed = 1.0 / 30.0, FRAMES + 18, 10
    slid = step * np.concatenate([np.zeros(resting), np.arange(1, pushed + 1)])

    def frame(y):
        place = (CRATE[0], CRATE[1] - y, CRATE[2])
        return frames_of(small, balls=((),), extra=[shapes["box"](place, CRATE_EDGES, 0.5)])[0]

    settings = replace(SETTINGS, solids_are_objects=True)
    pipeline = PerceptionPipeline(settings, np.random.default_rng(0))
    results = [pipeline.process(frame(y), step * k) for k, y in enumerate(slid)]
    assert results[-1].model.environment.boxes == ()
    (lying,), (sliding,) = results[resting - 1].objects, results[-1].objects
    assert sliding.object.id == lying.object.id
    assert sorted(lying.object.shape.edge_lengths) == pytest.approx(sorted(CRATE_EDGES), abs=0.02)
    assert lying.state.position == pytest.approx(CRATE, abs=0.02)
    assert np.linalg.norm(lying.state.linear_velocity) < SETTINGS.rest_speed
    assert sliding.state.position == pytest.approx([1.5, 0.2 - slid[-1], 0.1], abs=0.02)
    assert sliding.state.linear_velocity == pytest.approx([0.0, -1.0, 0.0], abs=0.15)
    (observation,) = pipeline.finish()
    (item,) = observation.objects
    assert observation.start_time == pytest.approx(step * (resting - 1), abs=2.5 * step)
    assert item.initial_state.linear_velocity == pytest.approx([0.0, -1.0, 0.0], abs=0.15)
