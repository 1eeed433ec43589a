"""A plane that is split into convex parts acts as it did in one piece."""

import numpy as np
import pytest

from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Sphere

from .laws_scenes import EVENT_DRIVEN, STEPPED, Body, coefficients, engines, make_scene

RADIUS = 0.05
TIMES = np.linspace(0.05, 1.5, 30)
LEFT, RIGHT = (
    Plane(
        f"floor/{x}",
        "ground",
        (0, 0, 1),
        0.0,
        [(x, -9, 0), (x + 9, -9, 0), (x + 9, 9, 0), (x, 9, 0)],
    )
    for x in (-9.0, 0.0)
)


@engines(EVENT_DRIVEN, STEPPED)
@pytest.mark.parametrize(
    ("height", "velocity", "spin"),
    [
        pytest.param(RADIUS, (0.8, 0.1, 0.0), (-2.0, 16.0, 0.0), id="rolling"),
        pytest.param(RADIUS, (0.8, 0.3, 0.0), (0.0, 0.0, 9.0), id="sliding"),
        pytest.param(0.3, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0), id="bouncing"),
        pytest.param(RADIUS, (0.0, 0.7, 0.0), (-14.0, 0.0, 0.0), id="rolling along it"),
    ],
)
def test_a_ball_crosses_a_seam_as_if_there_were_none(engine, height, velocity, spin) -> None:
    start = (0.0 if velocity[0] == 0.0 else -0.3, 0.0, height)
    ball = Body(Sphere(RADIUS), start, velocity=velocity, spin=spin)
    theta = coefficients(mu=0.3, mu_r=0.001, e=0.6)
    whole, split = (
        engine.poses(make_scene(ball, planes=planes), theta, TIMES)[0]
        for planes in ([(0, 0, 1, 0)], [LEFT, RIGHT])
    )
    # The same contacts at the same times, and one more event at the seam: 4 µm were measured.
    np.testing.assert_allclose(split, whole, atol=1e-5)


@engines(EVENT_DRIVEN, STEPPED)
def test_a_box_rests_on_a_seam(engine) -> None:
    box = Body(Box((0.2, 0.1, 0.06)), (0.02, 0.0, 0.03))
    places = engine.poses(make_scene(box, planes=[LEFT, RIGHT]), coefficients(), TIMES)[0]
    np.testing.assert_allclose(places[0], np.tile((0.02, 0.0, 0.03), (len(TIMES), 1)), atol=1e-4)
