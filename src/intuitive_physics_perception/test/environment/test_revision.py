"""What comes and stays becomes a part of the environment, what goes leaves nothing behind."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.settled_view import (
    COME_TIME,
    GONE_TIME,
    ROWS_APART,
    SettledView,
)
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

STEP = 1.0 / 15.0
SETTINGS = PerceptionSettings(environment_frames=4)


class Film:
    """Frames of a room, perceived one after another."""

    def __init__(self, make_small_room, background=None) -> None:
        self.room = make_small_room(tilt=25.0, height=0.8)
        self.pipeline = PerceptionPipeline(
            SETTINGS, np.random.default_rng(0), background=background
        )
        self.time = 0.0

    def play(self, seconds, extra=(), balls=()):
        """Results of the frames of some seconds; `extra` and `balls` may depend on the time."""
        results = []
        for k in range(round(seconds / STEP)):
            now = extra(k * STEP) if callable(extra) else extra
            moving = balls(k * STEP) if callable(balls) else balls
            points = self.room.points(moving, now)
            results.append(self.pipeline.process(points, self.time))
            self.time += STEP
        return results


@pytest.fixture
def film(make_small_room) -> Film:
    return Film(make_small_room)


@pytest.fixture
def board(shapes):
    return shapes["box"]((1.9, 0.1, 0.5), (0.02, 0.9, 1.0), 0.3)


def no_move(results) -> bool:
    return not any(result.moved for result in results)


def test_a_board_that_leaves_hides_nothing_any_more(film, board) -> None:
    """A ball that flies where the board stood, and behind it, is followed."""
    first = film.play(0.5, [board])[-1].model
    after = film.play(1.5)
    assert no_move(after)
    assert [result.revised for result in after if result.revised]
    model = after[-1].model
    faces = [plane.normal for plane in first.environment.planes]
    assert len(model.environment.planes) == len(faces) - 1
    assert {plane.id for plane in model.environment.planes} < {
        plane.id for plane in first.environment.planes
    }
    flight = lambda t: [((2.3, 0.6 - 1.2 * t, 0.5), 0.06)]  # noqa: E731
    results = film.play(0.8, balls=flight)
    assert sum(len(result.objects) == 1 for result in results) >= 0.7 * len(results)


def test_the_frame_and_what_is_still_there_stay(film, board) -> None:
    before = film.play(0.5, [board])[-1].model
    after = film.play(1.5)[-1].model
    assert after is not before
    assert np.array_equal(after.rotation, before.rotation)
    assert np.array_equal(after.translation, before.translation)
    kept = {plane.id: plane for plane in before.environment.planes}
    for plane in after.environment.planes:
        assert np.allclose(plane.normal, kept[plane.id].normal, atol=1e-12)
        assert plane.offset == pytest.approx(kept[plane.id].offset, abs=1e-12)


def test_a_box_that_is_put_down_and_stays_is_an_obstacle(film, shapes) -> None:
    """A stool of no shape that is followed; once `come_time` is over it is a static box."""
    film.play(0.5)
    stool = shapes["cylinder"](1.5, 0.1, 0.15, 0.35)
    results = film.play(5.0, [stool])
    assert no_move(results)
    since = [k * STEP for k, result in enumerate(results) if result.revised]
    assert since
    assert since[0] > COME_TIME
    (crate,) = results[-1].model.environment.boxes
    assert np.abs(crate.center[:2] - [1.5, 0.1]).max() < 0.15
    assert crate.center[2] + 0.5 * crate.edge_lengths[2] == pytest.approx(0.35, abs=0.03)
    after = film.play(2.0)
    assert no_move(after)
    assert not after[-1].model.environment.boxes


def test_someone_who_walks_through_leaves_nothing_behind(film, shapes) -> None:
    """At 0.5 m/s; a moment in which the whole view is covered changes nothing, either."""
    first = film.play(0.5)[-1].model

    def person(t):
        return [shapes["cylinder"](1.3, -0.9 + 0.5 * t, 0.18, 1.8)]

    results = film.play(3.6, person)
    hand = shapes["box"]((0.4, 0.0, 0.6), (0.05, 1.0, 1.0), 0.0)
    results += film.play(1.0, [hand])
    results += film.play(1.0)
    assert no_move(results)
    assert not any(result.revised for result in results)
    assert results[-1].model is first


def test_a_ball_that_rests_stays_an_object(film) -> None:
    film.play(0.5)
    results = film.play(5.0, balls=[((1.4, 0.1, 0.05), 0.05)])
    assert not results[-1].model.environment.boxes
    assert all(len(result.objects) == 1 for result in results[10:])


def test_tracks_go_on_while_the_environment_is_revised(film, shapes) -> None:
    ball = [((1.3, -0.3, 0.05), 0.05)]
    board = shapes["box"]((1.9, 0.3, 0.4), (0.02, 0.6, 0.8), 0.3)
    film.play(0.5, [board])
    before = film.play(0.5, [board], ball)[-1]
    after = film.play(1.5, balls=ball)
    assert any(result.revised for result in after)
    assert {item.object.id for item in after[-1].objects} == {
        item.object.id for item in before.objects
    }


def test_a_revision_in_the_background_gives_the_same_environment(make_small_room, board) -> None:
    at_once = Film(make_small_room)
    at_once.play(0.5, [board])
    expected = at_once.play(4.0)[-1].model.environment
    with ThreadPoolExecutor(1) as background:
        film = Film(make_small_room, background)
        film.play(0.5, [board])
        for _ in range(4):
            environment = film.play(1.0)[-1].model.environment
            # Frames are played faster than they are taken: what runs beside them has its time.
            background.submit(int).result()
    assert [plane.id for plane in environment.planes] == [plane.id for plane in expected.planes]


NOISE = RangeNoise(0.002, 0.0015, 0.05, 0.0008)


@given(
    st.floats(0.5, 3.0),
    st.floats(0.5, 3.0),
    st.booleans(),
    st.integers(0, 1000),
)
def test_only_what_stays_elsewhere_has_changed(range_before, range_now, moves, seed) -> None:
    """A frontal surface at some range goes to another one, and stays there or sways."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:40, :40]
    rays = np.dstack([(u - 20) / 40, (v - 20) / 40, np.ones_like(u)])
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    view = SettledView((range_before * rays).astype(np.float32), NOISE)
    changes = []
    for k in range(80):
        sway = 0.3 * ((k // ROWS_APART) % 2) if moves else 0.0
        ranges = range_now + sway + NOISE.deviation(range_now) * rng.normal(size=(40, 40))
        view.take((ranges[:, :, None] * rays).astype(np.float32), 0.1 * k, ())
        changes.append(view.has_changed(0.1 * k))
    apart, noise = range_now - range_before, NOISE.deviation(max(range_now, range_before))
    if moves or abs(apart) < 3.0 * noise:
        assert not any(changes)
    elif abs(apart) > 8.0 * noise:
        since = 0.1 * changes.index(True)
        expected = GONE_TIME if apart > 0.0 else COME_TIME
        assert expected <= since + 1e-9
        assert since <= expected + 0.1 * (2 * ROWS_APART + 2)
