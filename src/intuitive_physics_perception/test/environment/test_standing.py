"""A sensor that stays stands; one that was moved is noticed, what moves before it is no move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.standing import EnvironmentCheck, FramesFromOnePlace
from intuitive_physics_perception.settings import PerceptionSettings

STEP = 0.1
SETTINGS = PerceptionSettings(environment_frames=4)


class Camera:
    """Frames of one room from cameras that stand differently."""

    def __init__(self, make_room) -> None:
        self.make_room = make_room

    def frames(self, count, *, tilt=25.0, height=0.8, seed=1, balls=(), extra=()):
        room = self.make_room(tilt=tilt, height=height, seed=seed)
        return [room.points(balls, extra) for _ in range(count)]


@pytest.fixture
def camera(make_small_room) -> Camera:
    return Camera(make_small_room)


def play(pipeline, frames, start):
    return [pipeline.process(frame, start + k * STEP) for k, frame in enumerate(frames)]


@pytest.mark.parametrize(("speed", "kept"), [(0.0, 4), (0.05, 4), (0.5, 1)])
def test_only_a_sensor_that_stays_stands(speed, kept) -> None:
    """The noise is 6 mm at 2 m, by which a slow drive has moved after four frames."""
    newest, nothing = FramesFromOnePlace(SETTINGS), np.zeros((1, 1, 3), np.float32)
    stood = []
    for k in range(64):
        newest.take(nothing, k / 30.0, RigidTransform((0.0, speed * k / 30.0, 0.0)))
        stood.append(newest.stands(k / 30.0))
    assert stood == [speed == 0.0 and k >= 30 for k in range(64)]
    assert newest.are_enough
    assert len(newest.frames) == kept


def test_a_moved_camera_is_named_and_its_new_place_modelled(camera, pipeline) -> None:
    before = play(pipeline, camera.frames(6), 0.0)[-1].model
    after = play(pipeline, camera.frames(14, tilt=31.0, height=0.9, seed=2), 1.0)
    (moved,) = [k for k, perceived in enumerate(after) if perceived.moved]
    # At the first frame that is `MOVED_TIME` after the first one from the new place.
    assert moved == 5
    assert "the sensor was moved" in after[moved].moved
    assert after[moved].diagnostics.problem == after[moved].moved
    assert after[moved].model is None
    assert [p.is_new_model for p in after] == [k == moved + 4 for k in range(len(after))]
    model = after[-1].model
    assert before.translation[2] == pytest.approx(0.8, abs=0.003)
    assert model.translation[2] == pytest.approx(0.9, abs=0.003)
    tilts = [np.degrees(np.arcsin(-(m.rotation @ [0, 0, 1])[2])) for m in (before, model)]
    assert tilts == pytest.approx([25.0, 31.0], abs=0.1)


def test_what_was_followed_before_the_move_is_an_observation(camera, pipeline) -> None:
    play(pipeline, camera.frames(5), 0.0)
    for k in range(8):
        ball = ((1.3 + 0.05 * k, -0.3 + 0.06 * k, 0.05), 0.05)
        play(pipeline, camera.frames(1, balls=[ball]), 1.0 + k * STEP)
    after = play(pipeline, camera.frames(8, tilt=35.0), 2.0)
    assert sum(len(perceived.observations) for perceived in after) == 1


@pytest.mark.parametrize("change", [{"tilt": 25.7}, {"height": 0.815}])
def test_a_small_move_is_noticed(camera, change, pipeline) -> None:
    """0.7° and 15 mm: what noise and unevenness let pass is 4σ and 5 mm, 8 mm at 1.5 m."""
    play(pipeline, camera.frames(4), 0.0)
    assert any(perceived.moved for perceived in play(pipeline, camera.frames(7, **change), 1.0))


def test_someone_before_the_camera_is_no_move(camera, shapes, pipeline) -> None:
    play(pipeline, camera.frames(4), 0.0)
    person = shapes["cylinder"](1.2, 0.1, 0.15, 1.8)
    results = play(pipeline, camera.frames(10, extra=[person]), 1.0)
    assert not any(result.moved for result in results)


def test_a_short_cover_of_the_camera_is_no_move(camera, shapes, pipeline) -> None:
    play(pipeline, camera.frames(4), 0.0)
    hand = shapes["box"]((0.4, 0.0, 0.6), (0.05, 1.0, 1.0), 0.0)
    results = play(pipeline, [*camera.frames(4, extra=[hand]), *camera.frames(4)], 1.0)
    assert not any(result.moved for result in results)


def test_the_check_can_be_switched_off(corner_model, camera) -> None:
    model = corner_model[1]
    check = EnvironmentCheck(model, replace(SETTINGS, moved_fraction=0.0))
    elsewhere = camera.frames(1, tilt=60.0)[0]
    assert [check.moved(elsewhere, time) for time in (0.0, 10.0)] == ["", ""]


def test_time_that_jumps_back_restarts_the_check_and_blind_frames_are_left_out(
    corner_model, camera
):
    check = EnvironmentCheck(corner_model[1], SETTINGS)
    elsewhere = camera.frames(1, tilt=33.0)[0]
    assert not check.moved(elsewhere, 10.0)
    assert not check.moved(elsewhere, 1.0)
    assert not check.moved(elsewhere, 1.4)
    assert not check.moved(np.full_like(elsewhere, np.nan), 1.45)
    assert not check.moved(elsewhere, 1.6)
    assert check.moved(elsewhere, 2.2)


def test_what_hides_all_planes_is_no_move_until_it_stays(corner_model, camera, shapes) -> None:
    check = EnvironmentCheck(corner_model[1], SETTINGS)
    (covered,) = camera.frames(1, extra=[shapes["box"]((0.4, 0.0, 0.6), (0.05, 1.0, 1.0), 0.0)])
    assert [bool(check.moved(covered, time)) for time in (0.0, 1.0, 1.9, 2.1)] == [0, 0, 0, 1]


def test_clouds_are_checked_as_images_are(corner_model, camera) -> None:
    check = EnvironmentCheck(corner_model[1], SETTINGS)
    for tilt, moved in ((25.0, False), (33.0, True)):
        cloud = camera.frames(1, tilt=tilt)[0].reshape(1, -1, 3)[:, ::3]
        assert [bool(check.moved(cloud, time)) for time in (0.0, 1.0)] == [False, moved]
