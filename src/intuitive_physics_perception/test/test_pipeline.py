"""Frames in; environment, states and observations out."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.kernels.warm_up import main
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

from .conftest import bouncing_ball

STEP = 1.0 / 30.0
RADIUS = 0.05
SETTINGS = PerceptionSettings(environment_frames=4)


@pytest.fixture(scope="module")
def recording(make_room):
    """Eight empty frames, a throw of 0.7 s, ten empty frames; true places in the world."""
    room = make_room(tilt=25.0, seed=11)
    times = np.arange(21) * STEP
    p0, v0 = np.array([1.4, -0.3, 0.45]), np.array([0.5, 0.6, 0.4])
    # Up and down until the floor at 0.33 s, then a bounce with e = 0.7 without friction.
    places = bouncing_ball(times, p0, v0, RADIUS, 0.7)
    frames = [room.points() for _ in range(8)]
    frames += [room.points([(place, RADIUS)]) for place in places]
    frames += [room.points() for _ in range(10)]
    return room, frames, places, v0


def play(frames, start=0.0, pipeline=None):
    pipeline = pipeline or PerceptionPipeline(SETTINGS, np.random.default_rng(0))
    return [pipeline.process(frame, start + k * STEP) for k, frame in enumerate(frames)]


def test_a_throw_from_frames_to_observation(recording) -> None:
    room, frames, places, v0 = recording
    perceived = play(frames, start=100.0)
    assert [p.is_new_model for p in perceived].count(True) == 1
    assert perceived[3].is_new_model
    model = perceived[3].model
    truth = model.to_environment(room.to_camera(places))
    # States follow the ball from its third frame on.
    for k in range(3, len(places)):
        (item,) = perceived[8 + k].objects
        assert item.object.id == "sphere_1"
        assert np.linalg.norm(item.state.position - truth[k]) < 0.01
    (observation,) = [found for p in perceived for found in p.observations]
    (ball,) = observation.objects
    assert observation.start_time == pytest.approx(100.0 + 8 * STEP, abs=1.5 * STEP)
    assert ball.object.shape.bounding_radius == pytest.approx(RADIUS, abs=0.001)
    first = round((observation.start_time - 100.0) / STEP) - 8
    errors = ball.trajectory.positions - truth[first : first + len(ball.trajectory)]
    assert np.sqrt(np.square(errors).sum(axis=1).mean()) < 0.004
    velocity = model.rotation @ room.rotation.T @ (v0 - [0, 0, 9.81 * first * STEP])
    assert np.linalg.norm(ball.initial_state.linear_velocity - velocity) < 0.03
    assert perceived[-1].objects == ()


def test_equal_seeds_perceive_equally(recording) -> None:
    _, frames, _, _ = recording
    first, second = play(frames[:20]), play(frames[:20])
    for a, b in zip(first, second, strict=True):
        assert [o.state.to_dict() for o in a.objects] == [o.state.to_dict() for o in b.objects]


def test_time_that_jumps_back_restarts_the_tracker(recording, pipeline) -> None:
    _, frames, _, _ = recording
    play(frames[:28], 50.0, pipeline)
    again = play(frames[8:16], 10.0, pipeline)
    assert again[0].restarted
    assert not any(p.restarted for p in again[1:])
    # What was under way is kept, the environment stays, and ids are never used twice.
    assert len(again[0].observations) == 1
    assert again[0].model is not None
    assert [o.object.id for o in again[-1].objects] == ["sphere_2"]


def test_frames_of_a_recording_that_is_played_again_and_again_are_not_kept(
    recording, pipeline
) -> None:
    _, frames, _, _ = recording
    passed = []
    for _ in range(3):
        for k, frame in enumerate(frames[:12]):
            copy = frame.copy()
            pipeline.process(copy, k * STEP)
            passed.append(weakref.ref(copy))
    gc.collect()
    # Those that the environment was modelled from stay, and those of the time that hindsight needs.
    later = [k for k, reference in enumerate(passed) if reference() is not None and k >= 12]
    assert all(k >= 24 for k in later)
    assert later[-1] == 35


def test_rebuilding_models_from_the_next_frames_and_never_uses_an_id_twice(
    recording, pipeline
) -> None:
    _, frames, _, _ = recording
    play(frames[:28], 0.0, pipeline)
    assert len(pipeline.rebuild_environment()) == 1
    later = play([*frames[:4], *frames[8:16]], 10.0, pipeline)
    assert [p.model is not None for p in later[:5]] == [False] * 3 + [True] * 2
    assert [o.object.id for o in later[-1].objects] == ["sphere_2"]


def test_what_moves_at_the_end_is_an_observation(recording, pipeline) -> None:
    _, frames, _, _ = recording
    play(frames[:28], 0.0, pipeline)
    assert len(pipeline.finish()) == 1
    assert pipeline.finish() == ()


def test_bad_frames_are_named_and_do_no_harm(recording, pipeline) -> None:
    _, frames, _, _ = recording
    nothing = np.full_like(frames[0], np.nan)
    for k, bad in enumerate([nothing, np.zeros((1, 0, 3), np.float32), nothing[:1]]):
        assert "no reading" in pipeline.process(bad, float(k)).diagnostics.problem
    play(frames[:16], 10.0, pipeline)
    assert "same time" in pipeline.process(frames[16], 10.0 + 15 * STEP).diagnostics.problem
    assert "no reading" in pipeline.process(nothing, 10.0 + 16 * STEP).diagnostics.problem
    result = pipeline.process(frames[17], 10.0 + 17 * STEP)
    assert [o.object.id for o in result.objects] == ["sphere_1"]
    with pytest.raises(InvalidInputError, match="finite"):
        pipeline.process(frames[0], float("nan"))


def test_a_scene_without_planes_says_so_and_tries_again(recording) -> None:
    _, frames, _, _ = recording
    rng = np.random.default_rng(0)
    pipeline = PerceptionPipeline(replace(SETTINGS, plane_min_fraction=0.3), rng)
    clutter = rng.normal(size=(1, 5000, 3)).astype(np.float32)
    problems = [pipeline.process(clutter, 0.1 * k).diagnostics.problem for k in range(8)]
    assert [bool(problem) for problem in problems] == [False, False, False, True] * 2
    assert "no plane" in problems[3]
    assert play(frames[:4], 5.0, pipeline)[-1].model is not None


def test_kernels_can_be_compiled_beforehand(capsys) -> None:
    main(["intuitive_physics_perception.compile"])
    assert "kernels ready" in capsys.readouterr().out


def solid_states(room, shape_at, times):
    """Perceived frames of eight empty frames and then a solid at each of some times."""
    frames = [room.points() for _ in range(8)]
    frames += [room.points(extra=[shape_at(t)]) for t in times]
    frames += [room.points() for _ in range(10)]
    return play(frames)


@pytest.mark.parametrize("kind", ["box", "capsule"])
def test_a_thrown_box_or_capsule_goes_through_the_same_door(make_room, shapes, kind) -> None:
    room = make_room(tilt=25.0, seed=12)
    times = np.arange(12) * STEP
    start, v0 = np.array([1.4, -0.3, 0.6]), np.array([0.3, 0.8, 0.9])
    spin, first = np.array([0.6, 0.0, 2.5]), Rotation.from_euler("zyx", [0.6, 0.4, 0.2])

    def place(t):
        return start + v0 * t - [0, 0, 0.5 * 9.81 * t**2]

    def turned(t):
        return (Rotation.from_rotvec(spin * t) * first).as_matrix()

    def shape_at(t):
        if kind == "box":
            return shapes["box"](place(t), (0.14, 0.2, 0.1), turned(t))
        return shapes["capsule"](place(t), 0.1 * turned(t)[:, 2], 0.05)

    perceived = solid_states(room, shape_at, times)
    model = perceived[3].model
    into = model.rotation @ room.rotation.T
    (item,) = perceived[8 + len(times) - 1].objects
    assert item.object.shape.kind == kind
    truth = model.to_environment(room.to_camera(place(times[-1])))
    assert np.linalg.norm(item.state.position - truth) < 0.02
    velocity = into @ (v0 - [0, 0, 9.81 * times[-1]])
    assert np.linalg.norm(item.state.linear_velocity - velocity) < 0.25
    axes_seen, true = rotation_matrix(item.state.orientation), into @ turned(times[-1])
    if kind == "box":
        assert np.sort(item.object.shape.edge_lengths) == pytest.approx([0.1, 0.14, 0.2], abs=0.02)
        assert np.abs(axes_seen.T @ true).max(axis=1) == pytest.approx(np.ones(3), abs=0.01)
        error = item.state.angular_velocity - into @ spin
    else:
        assert item.object.shape.radius == pytest.approx(0.05, abs=0.004)
        assert abs(axes_seen[:, 2] @ true[:, 2]) > 0.99
        # How it turns about its own axis cannot be seen.
        across = np.eye(3) - np.outer(true[:, 2], true[:, 2])
        error = across @ (item.state.angular_velocity - into @ spin)
    spread = np.sqrt(np.trace(item.state.covariance[9:, 9:]))
    assert np.linalg.norm(error) < min(3.0 * spread, 2.0)
    (observation,) = [found for p in perceived for found in p.observations]
    (observed,) = observation.objects
    assert observed.object.shape.kind == kind
    begun = observation.start_time - 8 * STEP
    there = model.to_environment(room.to_camera(place(begun)))
    assert np.linalg.norm(observed.initial_state.position - there) < 0.02
    axes = rotation_matrix(observed.initial_state.orientation).T @ into @ turned(begun)
    assert np.abs(axes).max() > 0.98
    seen_at = observed.detections.times - 8 * STEP
    true_places = model.to_environment(room.to_camera(np.stack([place(t) for t in seen_at])))
    off = (observed.detections.positions - true_places)[:, :, None]
    spread = observed.detections.covariances + observed.detections.bias
    squares = (off * np.linalg.solve(spread, off)).sum(axis=(1, 2))
    # The median of χ² with 3 degrees of freedom is 2.4. That of a box is less, as its readings tell
    # where it ends better than their spacing, by which its covariance goes.
    assert 0.1 < np.median(squares) < 5.0
