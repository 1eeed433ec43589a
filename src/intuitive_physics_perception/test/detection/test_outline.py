"""Balls are objects of their own; round parts of something larger are not."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.sphere_inspection import look_round_outline
from intuitive_physics_perception.environment.known_space import BEHIND, KNOWN, NEW, UNKNOWN
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings

from ..conftest import BallShape, BoxShape, crossings

WIDTH, HEIGHT, FOCAL = 240, 180, 240.0
WALL = 2.0
NOISE = 0.001

Shape = Callable[[NDArray[np.float64]], NDArray[np.float64]]

_V, _U = np.mgrid[:HEIGHT, :WIDTH]
RAYS = np.stack(
    [(_U - WIDTH / 2) / FOCAL, (_V - HEIGHT / 2) / FOCAL, np.ones((HEIGHT, WIDTH))], axis=-1
)


def ellipsoid(center: Sequence[float], axes: Sequence[float]) -> Shape:
    """Depth of its near side, inf where a ray misses."""

    unit = BallShape(np.asarray(center) / axes, 1.0)
    return lambda rays: unit.hit(np.zeros(3), rays / np.asarray(axes))[0]


def ball(center: Sequence[float], radius: float) -> Shape:
    return ellipsoid(center, [radius] * 3)


def box(center: Sequence[float], edges: Sequence[float], turn: float = 0.0) -> Shape:
    """Turned by `turn` radians about the image's x axis, then about its y axis."""
    shape = BoxShape(center, edges, Rotation.from_euler("xy", [turn, turn]).as_matrix())
    return lambda rays: shape.hit(np.zeros(3), rays)[0]


def cylinder(center: Sequence[float], radius: float, length: float) -> Shape:
    """Upright in the image."""

    def depth(rays: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b, square, root = crossings(rays[..., [0, 2]], np.asarray(center)[[0, 2]], radius)
        at = np.where(square > 0.0, (b - root) / a, np.inf)
        with np.errstate(invalid="ignore"):
            off = np.abs(at * rays[..., 1] - center[1])
        return np.where(off <= 0.5 * length, at, np.inf)

    return depth


STAIRS = [box([0.0, 0.15 - 0.1 * k, 1.0 + 0.12 * k], [0.6, 0.1, 0.12]) for k in range(4)]

NO_BALLS = {
    "box corner": [box([0.0, 0.05, 1.1], [0.2, 0.2, 0.2], 0.7)],
    "mug": [cylinder([0.05, 0.0, 1.0], 0.04, 0.1)],
    "stairs": STAIRS,
    "shoulder": [ellipsoid([0.0, 0.3, 1.0], [0.22, 0.3, 0.12])],
    "knob": [box([0.0, 0.0, 1.1], [0.3, 0.2, 0.1]), ball([0.0, 0.0, 1.05], 0.03)],
}


def frame(shapes: Sequence[Shape], rng: np.random.Generator) -> NDArray[np.float32]:
    """Points of a wall and of shapes before it, with noise along the rays and lost edges."""
    depth = np.min([np.full((HEIGHT, WIDTH), WALL), *(shape(RAYS) for shape in shapes)], axis=0)
    lost = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis, append=np.take(depth, [-1], axis=axis))) > 0.03
        lost |= step & (rng.random(depth.shape) < 0.5)
    noisy = depth * (1.0 + NOISE * rng.standard_normal(depth.shape))
    noisy[lost] = np.nan
    return (RAYS * noisy[..., None]).astype(np.float32)


def spheres(
    first: Sequence[Shape], then: Sequence[Shape], frames: int = 4
) -> list[list[DetectedSphere]]:
    """Spheres by frame of a scene that was modelled with the shapes `first`, in the sensor's
    frame."""
    rng = np.random.default_rng(3)
    pipeline = PerceptionPipeline(
        PerceptionSettings(environment_frames=4, find_solids=False, static_boxes=False),
        np.random.default_rng(4),
    )
    for k in range(4):
        model = pipeline.process(frame(first, rng), 0.03 * k).model
    assert model is not None
    to_sensor = model.rotation.T, -model.translation @ model.rotation
    by_frame = []
    for k in range(frames):
        result = pipeline.process(frame(then, rng), 0.2 + 0.03 * k)
        spheres_now = [s for s in result.detections if isinstance(s, DetectedSphere)]
        by_frame.append([s.moved(*to_sensor) for s in spheres_now])
    return by_frame


def all_are_found(by_frame, balls) -> bool:
    """Whether each frame but the first two shows exactly these balls (centre, radius)."""
    return all(
        len(group) == len(balls)
        and all(
            any(np.linalg.norm(s.center - np.array(c)) < 0.3 * r for s in group) for c, r in balls
        )
        for group in by_frame[2:]
    )


@pytest.mark.parametrize("name", NO_BALLS)
def test_what_was_there_and_is_no_ball_is_none(name) -> None:
    assert spheres(NO_BALLS[name], NO_BALLS[name]) == [[]] * 4


def test_a_whole_ball_that_was_there_is_found() -> None:
    center, radius = (0.1, 0.05, 1.0), 0.05
    shapes = [ball(center, radius)]
    assert all_are_found(spheres(shapes, shapes), [(center, radius)])


def test_what_stays_and_was_no_ball_is_none_before_it_was_one_for_a_while() -> None:
    """What looks like one in some frames by chance does so where it stands."""
    center, radius = (0.0, 0.0, 1.0), 0.05
    arms = [box(center, edges) for edges in ([0.3, 0.03, 0.03], [0.03, 0.3, 0.03])]
    by_frame = spheres([*arms, ball(center, radius)], [ball(center, radius)], frames=20)
    assert by_frame[:6] == [[]] * 6
    assert all_are_found(by_frame[6:], [(center, radius)])


@settings(max_examples=8, deadline=None)
@given(
    radius=st.floats(0.04, 0.07),
    gap=st.floats(0.0, 10.0),
    x=st.floats(-0.3, 0.3),
    y=st.floats(-0.2, 0.2),
)
def test_a_ball_before_a_wall_is_found_wherever_it_is(radius, gap, x, y) -> None:
    """From touching the wall to ten radii before it."""
    center = (x, y, WALL - (1.0 + gap) * radius)
    assert all_are_found(spheres([], [ball(center, radius)]), [(center, radius)])


@settings(max_examples=6, deadline=None)
@given(
    radius=st.floats(0.035, 0.07),
    angle=st.floats(0.0, 2.0 * np.pi),
    depth=st.floats(0.8, 1.4),
)
def test_of_two_balls_that_touch_both_are_found(radius, angle, depth) -> None:
    away = radius * np.array([np.cos(angle), np.sin(angle), 0.0])
    balls = [(tuple(np.array([0.0, 0.0, depth]) + side * away), radius) for side in (-1, 1)]
    assert all_are_found(spheres([], [ball(*sphere) for sphere in balls]), balls)


def test_a_ball_that_touches_a_box_is_found() -> None:
    boxes = [box([0.0, 0.15, 1.0], [0.4, 0.1, 0.2])]
    center, radius = (0.05, 0.05, 1.0), 0.05
    by_frame = spheres(boxes, [*boxes, ball(center, radius)])
    assert all_are_found(by_frame, [(center, radius)])


def outline_view(mark: int, shapes: Sequence[Shape], sphere: Sequence[float]):
    points = frame(shapes, np.random.default_rng(0)).reshape(-1, 3)
    inside = points[:, 2] < WALL - 0.05
    noise = np.square([NOISE, 0.0, 1.0, 1e-4])
    marks = np.where(inside, mark, 0).astype(np.uint8)
    return look_round_outline(points, inside, marks, np.array(sphere), 1.0 / FOCAL, noise)


def test_the_ring_tells_a_ball_from_a_bulge() -> None:
    sphere = [0.0, 0.0, 1.0, 0.08]
    view = outline_view(NEW, [ball(sphere[:3], 0.08)], sphere)
    assert (np.mean(view.going_on > 0.5), view.level, view.ends) == (0.0, 0.0, 1.0)
    # Half of a ball on a plate through its centre: the plate goes on all round.
    plate = box([0.0, 0.0, 1.05], [0.5, 0.5, 0.1])
    view = outline_view(NEW, [ball(sphere[:3], 0.08), plate], sphere)
    assert (np.mean(view.going_on > 0.5), view.level, view.ends) == (1.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("mark", "part"), [(NEW, 1.0), (KNOWN, 0.0), (UNKNOWN, 0.0), (BEHIND, 0.0)]
)
def test_only_what_lies_where_nothing_was_is_new(mark, part) -> None:
    sphere = [0.0, 0.0, 1.0, 0.08]
    assert outline_view(mark, [ball(sphere[:3], 0.08)], sphere).new == part


def test_patches_of_a_ball_have_the_errors_of_the_noise_and_those_of_an_ellipsoid_more() -> None:
    sphere = [0.0, 0.0, 1.0, 0.08]
    for stretch, least, most in ((1.0, 0.5, 2.0), (1.1, 5.0, np.inf)):
        shape = ellipsoid(sphere[:3], [0.08 * stretch, 0.08, 0.08])
        patches = outline_view(NEW, [shape], sphere).patches
        readings, errors, variances = patches[patches[:, 0] > 0].T
        assert least < np.mean(errors**2 * readings / variances) < most
