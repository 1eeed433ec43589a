"""A known motion of a camera is found as exactly as is said, and what cannot be found is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.environment_model import model_environment
from intuitive_physics_perception.environment.fusion import fused_frame
from intuitive_physics_perception.environment.standing import VIEW_DISTANCE
from intuitive_physics_perception.sensor_motion.lens import fitted_lens
from intuitive_physics_perception.sensor_motion.sensor_motion import sensor_motion_in
from intuitive_physics_perception.settings import PerceptionSettings

from ..conftest import BallShape, BoxShape, CylinderShape, Head

SETTINGS = PerceptionSettings(environment_frames=6)
FURNITURE = (
    CylinderShape(1.8, 0.5, 0.12, 0.4),
    BoxShape((2.4, -0.9, 0.15), (0.4, 0.3, 0.3), 0.5),
)


class View:
    """A room as a camera models it, which is then moved.

    Parameters
    ----------
    room : as the fixture makes it
    """

    def __init__(self, room, extra=()) -> None:
        self.head, self.extra = Head(room), extra
        self.head.go(np.zeros(3), np.zeros(3))
        frames = [self.head.look(extra=extra) for _ in range(SETTINGS.environment_frames)]
        self.model = model_environment(frames, SETTINGS, np.random.default_rng(0))
        self.motion = self.motion_by(frames)

    def motion_by(self, frames):
        fused = fused_frame(frames, frames[0].size).astype(np.float32)
        return sensor_motion_in(fused, frames, self.model, SETTINGS)

    def go(self, shift, angles) -> RigidTransform:
        """Move the camera; return the true way, from its frame to that of the view."""
        here = self.head.go(np.zeros(3), np.zeros(3))
        return here.inverse.after(self.head.go(np.asarray(shift), np.asarray(angles)))

    def look(self, balls=(), extra=()):
        return self.head.look(balls, (*self.extra, *extra))


def is_near(view: View, way: RigidTransform) -> bool:
    """Whether a way is that of the sensor within twice the noise of a reading at 2 m, of which once
    that counts as no motion at rest."""
    shift, angle = way.difference(view.motion.way)
    return shift + VIEW_DISTANCE * angle < 2.0 * view.model.noise.deviation(VIEW_DISTANCE)


def error_of(way: RigidTransform, true: RigidTransform) -> np.ndarray:
    """Error (6,) m of a way: of the sensor's place, and of its turn 2 m away."""
    turn = Rotation.from_quat(way.orientation) * Rotation.from_quat(true.orientation).inv()
    return np.append(way.translation - true.translation, VIEW_DISTANCE * turn.as_rotvec())


@pytest.fixture
def furnished(make_small_room) -> View:
    return View(make_small_room(tilt=25.0, seed=21), FURNITURE)


@pytest.fixture
def floor(make_small_room) -> View:
    return View(make_small_room(tilt=50.0, seed=22, walls=()))


def test_the_lens_is_that_of_the_camera(furnished) -> None:
    """Of a pinhole camera: the focal length, and the middle of the image."""
    lens = fitted_lens(furnished.look())
    assert lens[0] == pytest.approx([119.5, 159.5], abs=0.01)
    assert lens[1:3] == pytest.approx(262.0 * np.array([[0, 1], [1, 0]]), abs=0.1)
    assert lens[3:] == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize(
    ("shift", "angles"),
    [
        ((0.0, 0.01, 0.0), (0.0, 0.0, 0.0)),
        ((0.02, 0.02, -0.01), (0.2, -0.3, 0.4)),
        ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ],
)
def test_errors_of_motions_are_as_large_as_their_covariances(furnished, shift, angles) -> None:
    """eᵀ P⁻¹ e is χ² with six degrees of freedom over views and frames with noise of their own."""
    squares = []
    for _ in range(12):
        furnished.go((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        motion = furnished.motion_by([furnished.look() for _ in range(4)])
        true = furnished.go(shift, angles)
        fit, doubt = motion.fit(furnished.look())
        assert not doubt
        error = error_of(fit.way, true)
        squares.append(error @ fit.determined() @ error)
    # The mean of 12 has the standard deviation 1; robust weights make covariances a fifth larger.
    assert 2.0 < np.mean(squares) < 9.0


def test_a_camera_at_rest_stays_where_it_is(furnished) -> None:
    furnished.go((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(40):
        furnished.motion.follow(furnished.look(), 0.1 * k)
        assert not furnished.motion.doubt
        assert furnished.motion.way.difference(RigidTransform()) == (0.0, 0.0)
    assert furnished.motion.unseen == ""


def test_who_walks_or_rolls_before_a_camera_at_rest_does_not_move_it(furnished) -> None:
    furnished.go((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(30):
        person = CylinderShape(1.4, -0.8 + 0.06 * k, 0.2, 1.8)
        ball = BallShape((1.6, 0.3 - 0.02 * k, 0.1), 0.1)
        furnished.motion.follow(furnished.look(extra=(person, ball)), 0.1 * k)
        assert not furnished.motion.doubt
        assert furnished.motion.way.difference(RigidTransform()) == (0.0, 0.0)


def test_a_thing_that_is_pushed_does_not_move_the_camera(make_small_room) -> None:
    """Only the box shows motions along the floor: that it moves is no motion of the camera."""
    box = ((1.0, 0.1, 0.15), (0.3, 0.3, 0.3))
    view = View(make_small_room(tilt=40.0, seed=23, walls=()), (BoxShape(*box, 0.4),))
    for k in range(20):
        pushed = BoxShape((1.0, 0.1 + 0.002 * k, 0.15), box[1], 0.4)
        view.motion.follow(view.head.look(extra=(pushed,)), 0.1 * k)
        assert view.motion.way.difference(RigidTransform()) == (0.0, 0.0)


def test_a_moving_camera_is_followed_past_who_walks(furnished) -> None:
    for k in range(20):
        person = CylinderShape(1.4, -0.6 + 0.05 * k, 0.1, 1.8)
        true = furnished.go(np.array([0.0, 0.01, 0.0]) * k, np.array([0.0, -0.3, 0.0]) * k)
        furnished.motion.follow(furnished.look(extra=(person,)), 0.1 * k)
        assert not furnished.motion.doubt
        assert is_near(furnished, true), k


def test_of_one_plane_a_motion_along_it_is_not_determined(floor) -> None:
    """The floor shows height, roll and pitch; two shifts and a turn about its normal are open."""
    assert floor.motion.unseen.count("a shift along") == 2
    assert floor.motion.unseen.count("a turn about (0.00, 0.00, 1.00)") == 1
    for k in range(10):
        floor.go((0.01 * k, -0.01 * k, 0.0), (0.0, 0.0, 0.0))
        floor.motion.follow(floor.look(), 0.1 * k)
        assert floor.motion.way.difference(RigidTransform()) == (0.0, 0.0)
    floor.go((0.0, 0.0, 0.03), (1.0, 0.0, 0.0))
    floor.motion.follow(floor.look(), 2.0)
    assert "does not determine" in floor.motion.doubt
    fit, _ = floor.motion.fit(floor.look())
    # What is open is not moved.
    moved = floor.model.rotation @ fit.way.translation
    assert moved[:2] == pytest.approx([0.0, 0.0], abs=0.001)
    assert moved[2] == pytest.approx(0.03, abs=0.002)


def test_edges_of_what_stands_about_show_a_motion_that_no_surface_does(make_small_room) -> None:
    """Along a wall and the floor only the sides of two boxes go, and these are hardly seen."""
    boxes = (
        BoxShape((1.6, -0.4, 0.15), (0.3, 0.3, 0.3), 0.0),
        BoxShape((2.0, 0.5, 0.2), (0.2, 0.4, 0.4), 0.0),
    )
    walls = [((-1.0, 0.0, 0.0), -3.2)]
    view = View(make_small_room(tilt=25.0, seed=24, walls=walls), boxes)
    assert view.motion.unseen == ""
    for k in range(15):
        true = view.go(np.array([0.0, 0.01, 0.0]) * k, (0.0, 0.0, 0.0))
        view.motion.follow(view.look(), 0.1 * k)
        assert not view.motion.doubt
        assert is_near(view, true), k


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.3), (-0.4, 0.0, 0.1)])
def test_a_camera_that_was_put_elsewhere_is_not_found(furnished, shift) -> None:
    furnished.go(shift, (0.0, 10.0, 0.0))
    for k in range(3):
        furnished.motion.follow(furnished.look(), 100.0 + 0.1 * k)
        assert furnished.motion.doubt
        assert furnished.motion.way.difference(RigidTransform()) == (0.0, 0.0)
    assert furnished.motion.lost_for(100.2) == pytest.approx(0.2)


def test_a_camera_that_comes_back_is_found_there(furnished) -> None:
    for k, way in enumerate(
        [(0.0, 0.03, 0.0), (0.0, 0.06, 0.0), (0.0, 0.06, 0.5), (0.0, 0.0, 0.0)]
    ):
        furnished.go(way, (0.0, 0.0, 0.0))
        furnished.motion.follow(furnished.look(), 0.1 * k)
        assert bool(furnished.motion.doubt) == (k == 2)
    assert furnished.motion.way.difference(RigidTransform()) == (0.0, 0.0)
    assert furnished.motion.lost_for(0.5) == 0.0
