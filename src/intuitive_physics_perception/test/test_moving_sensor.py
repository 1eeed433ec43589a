"""A sensor that moves, whose pose is known: everything stays where it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.known_space import NEW
from intuitive_physics_perception.environment.standing import (
    MOVED_TIME,
    STANDING_TIME,
    is_same_view,
)
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.scene import ModelledScene
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.followed_objects import FollowedObjects

from .conftest import (
    WORLD_IN_FIXED,
    BallShape,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    Head,
)

STEP = 1.0 / 30.0
RADIUS = 0.05
FIRST = 6
"""Frames that stand still at the start, from which the environment is modelled."""

SETTINGS = PerceptionSettings(environment_frames=FIRST)
START, VELOCITY = np.array([1.3, -0.5, 0.5]), np.array([0.3, 0.9, 1.4])


@pytest.fixture
def head(make_small_room) -> Head:
    return Head(make_small_room(tilt=25.0, seed=12, focal=262.5))


@pytest.fixture
def pipeline() -> PerceptionPipeline:
    return PerceptionPipeline(SETTINGS, np.random.default_rng(0))


FURNITURE = (
    CylinderShape(1.8, 0.5, 0.12, 0.4),
    BoxShape((2.4, -0.9, 0.15), (0.4, 0.3, 0.3), 0.5),
)
"""What stands about."""

HANGING = (1.6, -0.4, 0.3)
"""Centre of a ball that hangs there, m."""

CLUTTER = (
    *FURNITURE,
    BallShape(HANGING, 0.15),
    CapsuleShape((2.0, 0.1, 0.5), (0.1, 0.3, 0.2), 0.06),
)
"""What stands about, or hangs, before the first frame."""


def place_at(time: float) -> np.ndarray:
    """Position (m) of the ball in the world until it comes to the floor: p0 + v t - g t²/2."""
    return START + VELOCITY * time - [0.0, 0.0, 0.5 * 9.81 * time**2]


FALL = 12
"""Frames until the ball comes near the floor."""


def nods(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Shift and turn of a head that follows what flies: 0.5 m/s and 25 °/s."""
    time = max(0.0, (k - FIRST) * STEP)
    return np.array([0.1, 0.5, 0.05]) * time, np.array([-6.0, -25.0, 3.0]) * time


def throw(head: Head, pipeline: PerceptionPipeline, way, poses: bool = True, frames: int = 40):
    results = []
    for k in range(frames):
        pose = head.go(*way(k))
        flown = (k - FIRST - 2) * STEP
        flies = 0 <= k - FIRST - 2 <= FALL
        balls = [(place_at(flown), RADIUS)] if flies else []
        results.append(
            (pose, pipeline.process(head.look(balls), k * STEP, None, pose if poses else None))
        )
    return results


def test_a_throw_that_a_moving_head_follows(head, pipeline) -> None:
    results = throw(head, pipeline, nods)
    models = [result for _, result in results if result.is_new_model]
    assert len(models[0].model.detected) >= 2
    # From the environment's frame to the fixed one: found once, where the sensor stood.
    first_pose = results[0][0]
    to_fixed = first_pose.after(models[0].model.sensor_pose.inverse)
    states = 0
    for k, (pose, result) in enumerate(results[FIRST : FIRST + 2 + FALL], FIRST):
        same = pose.after(result.model.sensor_pose.inverse)
        assert to_fixed.difference(same) == pytest.approx((0.0, 0.0), abs=1e-6)
        for item in result.objects:
            truth = WORLD_IN_FIXED.points(place_at((k - FIRST - 2) * STEP))
            assert to_fixed.points(item.state.position) == pytest.approx(truth, abs=0.02)
            states += 1
    assert states >= FALL - 3
    (observation,) = [found for _, result in results for found in result.observations]
    (ball,) = observation.objects
    times = ball.trajectory.times - (FIRST + 2) * STEP
    truth = np.array([WORLD_IN_FIXED.points(place_at(time)) for time in times])
    assert to_fixed.points(ball.trajectory.positions) == pytest.approx(truth, abs=0.01)
    begun = ball.trajectory.times[0] - (FIRST + 2) * STEP
    velocity = WORLD_IN_FIXED.directions(VELOCITY - [0.0, 0.0, 9.81 * begun])
    assert to_fixed.directions(ball.initial_state.linear_velocity) == pytest.approx(
        velocity, abs=0.1
    )


def test_without_poses_the_same_frames_are_a_moved_sensor(head, pipeline) -> None:
    results = throw(head, pipeline, nods, poses=False)
    assert any(result.moved for _, result in results)


@pytest.mark.parametrize("clutter", [(), CLUTTER], ids=["empty", "cluttered"])
def test_only_a_ball_is_followed_where_nothing_moves_but_the_head(head, pipeline, clutter) -> None:
    for k in range(45):
        time = max(0.0, (k - FIRST) * STEP)
        swing = np.sin(2.0 * time)
        pose = head.go([0.2 * swing, 0.4 * swing, 0.1 * swing], [5.0 * swing, -15.0 * swing, 0.0])
        result = pipeline.process(head.look(extra=clutter), k * STEP, None, pose)
        # It leaves the view, and would fall.
        assert len(result.objects) <= bool(clutter)
        for detection in result.detections:
            to_fixed = pose.after(result.model.sensor_pose.inverse)
            hanging = WORLD_IN_FIXED.points(HANGING)
            assert to_fixed.points(detection.center) == pytest.approx(hanging, abs=0.02), k
        assert not result.moved


def test_the_environment_is_modelled_anew_where_the_head_comes_to_rest(head, pipeline) -> None:
    models = []
    for k in range(70):
        gone = min(max(0.0, (k - FIRST) / 12.0), 1.0)
        pose = head.go([0.0, 0.3 * gone, 0.2 * gone], [0.0, -20.0 * gone, 0.0])
        result = pipeline.process(head.look(), k * STEP, None, pose)
        if result.is_new_model:
            models.append((k, pose, result.model))
    (first, at_first, before), (second, at_second, after) = models
    assert first == FIRST - 1
    # It has come to rest in frame FIRST + 12.
    assert second == pytest.approx(FIRST + 12 + STANDING_TIME / STEP, abs=2)
    # What is up and how high the floor is are those of the world, from both places.
    for pose, model in ((at_first, before), (at_second, after)):
        to_fixed = pose.after(model.sensor_pose.inverse)
        assert to_fixed.directions([0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=0.01)
        assert to_fixed.points([0.0, 0.0, 0.0])[2] == pytest.approx(0.4, abs=0.01)
    # And the frame is the same.
    was = at_first.after(before.sensor_pose.inverse)
    now = at_second.after(after.sensor_pose.inverse)
    assert was.difference(now) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_what_is_followed_goes_on_where_the_environment_is_modelled_anew(head, pipeline) -> None:
    place, models, ids, errors = np.array([1.6, 0.1, 0.08]), [], set(), []
    for k in range(FIRST + 80):
        gone = min(max(0.0, (k - FIRST) / 12.0), 1.0)
        pose = head.go([0.0, 0.2 * gone, 0.1 * gone], [0.0, -8.0 * gone, 0.0])
        balls = [(place, 0.08)] if k > FIRST else []
        result = pipeline.process(head.look(balls), k * STEP, None, pose)
        if result.is_new_model:
            models.append(k)
        if result.model is not None:
            to_fixed = pose.after(result.model.sensor_pose.inverse)
        for item in result.objects:
            ids.add(item.object.id)
            errors.append(to_fixed.points(item.state.position) - WORLD_IN_FIXED.points(place))
    assert len(models) == 2
    assert len(ids) == 1
    assert len(errors) >= 75
    assert np.abs(errors).max() < 0.01


def test_an_environment_modelled_on_the_way(head, pipeline) -> None:
    """A sensor that moves from the first frame on models from the newest frame alone."""
    for k in range(FIRST):
        pose = head.go(np.array([0.0, 0.03, 0.02]) * k, np.array([0.0, -2.0, 0.0]) * k)
        result = pipeline.process(head.look(), k * STEP, None, pose)
    assert result.is_new_model
    to_fixed = pose.after(result.model.sensor_pose.inverse)
    assert to_fixed.directions([0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, 1.0], abs=0.01)
    assert to_fixed.points([0.0, 0.0, 0.0])[2] == pytest.approx(0.4, abs=0.015)


@pytest.mark.parametrize("way", [0.0, 0.25], ids=["lies", "rolls"])
def test_a_ball_comes_to_a_table_that_the_head_has_turned_to(head, pipeline, way) -> None:
    """The table is no plane of the environment, which was modelled before; it goes on round the
    ball, but was there before it."""
    table, turned, shown = BoxShape((0.65, -1.13, 0.2), (0.8, 0.8, 0.4), 0.3), 20, 12
    found = 0
    for k in range(FIRST + turned + 4 + shown):
        part = min(max(0.0, (k - FIRST) / turned), 1.0)
        pose = head.go([0.0, 0.0, 0.1 * part], [0.0, 60.0 * part, 0.0])
        since = k - (FIRST + turned + 4)
        ball = np.array([0.6 + way * since * STEP, -1.1, 0.4 + RADIUS])
        balls = [(ball, RADIUS)] if since >= 0 else []
        result = pipeline.process(head.look(balls, [table]), k * STEP, None, pose)
        if not balls:
            continue
        to_fixed = pose.after(result.model.sensor_pose.inverse)
        errors = [to_fixed.points(seen.center) for seen in result.detections]
        errors = [np.linalg.norm(place - WORLD_IN_FIXED.points(ball)) for place in errors]
        found += any(error < 0.3 * RADIUS for error in errors)
    assert found >= shown - 1


def test_what_has_come_stays_new_where_the_head_looks_about(head) -> None:
    """Nobody has found out what it is, and the map takes in what stands beside it."""
    pose, frame = head.go(np.zeros(3), np.zeros(3)), head.look()
    model = model_environment([frame], SETTINGS, np.random.default_rng(0))
    scene = ModelledScene(model, [frame], SETTINGS, np.random.default_rng(0), pose=pose)
    followed = FollowedObjects(scene.model.environment, SETTINGS, 1)
    ball, beside = ((1.5, -0.3, 0.5), 0.1), BoxShape((1.2, -1.3, 0.3), (0.4, 0.4, 0.6), 0.3)
    new, unknown = [], []
    for angle in (15.0, 30.0, 16.0):
        scene.look_from(head.go([0.0, -0.01 * angle, 0.0], [0.0, angle, 0.0]))
        points = head.look([ball], [beside])
        clusters = scene.stages.clusters(points)
        scene.look_about(points, clusters, followed)
        new.append(np.count_nonzero(clusters.marks == NEW))
        unknown.append(clusters.unknown)
    assert unknown[0] > 10 * unknown[-1]
    assert min(new) > 0.9 * max(new) > 500


coordinates = st.floats(-2.0, 2.0)
angles = st.floats(-3.0, 3.0)


@settings(deadline=None, max_examples=30)
@given(shift=st.tuples(*[coordinates] * 3), turn=st.tuples(*[angles] * 3))
def test_an_environment_seen_from_elsewhere_is_the_same(corner_model, shift, turn) -> None:
    """n · p = d of each plane holds for the same points from both places, and back again."""
    model = corner_model[1]
    way = RigidTransform(shift, Rotation.from_rotvec(turn).as_quat())
    moved = model.seen_from(way)
    assert moved.environment is model.environment
    for was, now in zip(model.detected, moved.detected, strict=True):
        points = way.inverse.points(was.hull)
        beside = was.hull @ was.normal - was.offset
        assert points @ now.normal - now.offset == pytest.approx(beside, abs=1e-9)
        assert points == pytest.approx(now.hull, abs=1e-9)
        assert moved.to_environment(now.hull) == pytest.approx(
            model.to_environment(was.hull), abs=1e-9
        )
    back = moved.seen_from(way.inverse)
    assert model.sensor_pose.difference(back.sensor_pose) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert is_same_view(RigidTransform(), model.noise)


@pytest.mark.parametrize("speed", [0.05, 0.15, 0.5])
@pytest.mark.parametrize("is_given", [True, False], ids=["pose given", "no pose"])
def test_a_slow_drive_keeps_what_is_followed(head, pipeline, speed, is_given) -> None:
    """No new model, one ball, which stays where it is. Without poses what stands about shows the
    way along the floor and the wall."""
    extra = () if is_given else FURNITURE
    place, found, ids, errors = np.array([1.6, 0.1, 0.08]), 0, set(), []
    for k in range(FIRST + 60):
        time = max(0.0, (k - FIRST) * STEP)
        pose = head.go([0.0, speed * time, 0.0], [0.0, 0.0, 0.0])
        balls = [(place, 0.08)] if k > FIRST else []
        points = head.look(balls, extra)
        result = pipeline.process(points, k * STEP, pose=pose if is_given else None)
        assert result.is_new_model == (k == FIRST - 1), f"frame {k}"
        assert not result.diagnostics.problem
        if result.is_new_model:
            # Where the environment was modelled, and not where the camera is now.
            to_fixed = pose.after(result.model.sensor_pose.inverse)
        for item in result.objects:
            ids.add(item.object.id)
            errors.append(to_fixed.points(item.state.position) - WORLD_IN_FIXED.points(place))
        found += len(result.objects) == 1
    assert found >= 56
    assert len(ids) == 1
    assert np.abs(errors).max() < 0.015


def test_where_a_camera_without_a_pose_comes_to_rest_the_environment_keeps_its_frame(
    head, pipeline
) -> None:
    place, models, ids = np.array([1.6, 0.1, 0.08]), [], set()
    for k in range(FIRST + 60):
        gone = min(max(0, k - FIRST), 15)
        pose = head.go([0.0, 0.01 * gone, 0.0], [0.0, -0.4 * gone, 0.0])
        balls = [(place, 0.08)] if k > FIRST else []
        result = pipeline.process(head.look(balls, FURNITURE), k * STEP)
        if result.is_new_model:
            models.append((k, pose.after(result.model.sensor_pose.inverse)))
        ids.update(item.object.id for item in result.objects)
    (first, was), (second, now) = models
    assert first == FIRST - 1
    assert second == pytest.approx(FIRST + 15 + STANDING_TIME / STEP, abs=3)
    shift, angle = was.difference(now)
    assert shift < 0.01
    assert angle < 0.005
    assert len(ids) == 1


def test_a_camera_that_is_not_found_says_why_and_models_again(head, pipeline) -> None:
    results = []
    for k in range(40):
        gone = max(0, k - FIRST)
        shift = [0.0, 0.01 * gone, 0.0] if gone < 10 else [0.0, 0.1, 0.4]
        head.go(shift, [0.0, 0.0, 0.0])
        results.append(pipeline.process(head.look(extra=FURNITURE), k * STEP))
    moved = [k for k, result in enumerate(results) if result.moved]
    lost = [k for k, result in enumerate(results) if result.diagnostics.problem]
    assert lost == [*range(FIRST + 10, moved[0] + 1)]
    assert moved == pytest.approx([lost[0] + MOVED_TIME / STEP], abs=1.1)
    for k in lost:
        assert "it is not known how the sensor has moved: " in results[k].diagnostics.problem
    assert [k for k, result in enumerate(results) if result.is_new_model][1:] == [moved[0] + FIRST]
