"""A body that meets nothing else takes a shorter way through a step, to the same place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation.stepped.parts import PRECISION

from .laws_scenes import STEPPED, Body, G, coefficients, make_scene, random_quaternion

R = 0.05
RAILS = [((0, side * (R + 0.0505), 0.2), (40.0, 0.1, 0.6)) for side in (-1, 1)]
"""Boxes half a millimetre beside the track of a ball along x: near, so that the ball is not alone,
and never touched."""

TIMES = np.linspace(0.1, 2.0, 20)


def paths(body, theta, planes):
    alone, beside = make_scene(body, planes=planes), make_scene(body, planes=planes, boxes=RAILS)
    return STEPPED.poses(alone, theta, TIMES), STEPPED.poses(beside, theta, TIMES)


@given(
    speed=st.floats(-3.0, 3.0),
    spin=st.floats(-40.0, 40.0),
    mu_s=st.floats(0.0, 1.0),
    share=st.floats(0.0, 1.0),
    mu_r=st.floats(0.0, 0.1),
    slope=st.floats(-0.15, 0.15),
)
def test_ball_on_a_plane_moves_alike_alone_and_beside_others(speed, spin, mu_s, share, mu_r, slope):
    # Sweeps end where one changes no speed by more than PRECISION g h. The next step goes on from
    # what they found, so what is left does not add up: a way of PRECISION g h t.
    planes = [(np.sin(slope), 0.0, np.cos(slope), 0.0)]
    normal = np.array(planes[0][:3])
    along = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    body = Body(Sphere(R), R * normal, velocity=speed * along, spin=(0.0, spin, 0.0))
    alone, beside = paths(body, coefficients(mu_s * share, mu_s, mu_r), planes)
    allowed = PRECISION * G * STEPPED.step * TIMES[-1]
    assert np.abs(alone[0] - beside[0]).max() < allowed


@pytest.mark.parametrize("shape", [Sphere(R), Box((0.05, 0.08, 0.04)), Capsule(0.02, 0.05)])
def test_flight_is_the_same_alone_and_beside_others(shape):
    # Both ways carry a flying body by the same plan: equal to the bit but for the order of sums.
    rng = np.random.default_rng(5)
    body = Body(
        shape,
        (0.0, 0.0, 0.3),
        random_quaternion(rng),
        (1.0, 0.0, 2.0),
        (3.0, 1.0, 2.0),
    )
    alone, beside = (
        STEPPED.poses(make_scene(body, boxes=boxes), coefficients(), TIMES[:4])
        for boxes in ((), [((0, 0.25, 0.5), (9.0, 0.1, 1.0))])
    )
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
