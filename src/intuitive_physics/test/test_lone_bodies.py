"""A body that meets nothing else takes a shorter way through a step, to the same place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.simulation.stepped.contacts import STICK_SPEED
from intuitive_physics.simulation.stepped.parts import PRECISION

from .laws_scenes import STEPPED, Body, G, coefficients, make_scene, random_quaternion

R, HALF = 0.05, 0.03
RAILS = [((0, side * (R + 0.0505), 0.2), (40.0, 0.1, 0.6)) for side in (-1, 1)]
"""Boxes half a millimetre beside the track of a ball along x: near, so that the ball is not alone,
and never touched."""

FAR_RAILS = [((0, side * 6.0, 0.2), (40.0, 0.1, 0.6)) for side in (-1, 1)]
"""The same where no body comes that slides sideways: so long that they are near all the same."""

TIMES = np.linspace(0.1, 2.0, 20)

SLOPES = st.just(0.0) | st.floats(-0.15, 0.15)
"""On a level plane a lone body takes many steps at once, on a slope one after the other."""


def paths(body, theta, planes, rails=RAILS):
    alone, beside = make_scene(body, planes=planes), make_scene(body, planes=planes, boxes=rails)
    return STEPPED.poses(alone, theta, TIMES), STEPPED.poses(beside, theta, TIMES)


@given(
    speed=st.floats(-3.0, 3.0),
    spin=st.floats(-40.0, 40.0),
    mu_s=st.floats(0.0, 1.0),
    share=st.floats(0.0, 1.0),
    mu_r=st.floats(0.0, 0.1),
    slope=SLOPES,
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


@given(
    speed=st.floats(-3.0, 3.0),
    share=st.floats(0.0, 1.5),
    mu_s=st.floats(0.0, 1.0),
    mu_r=st.floats(0.0, 0.05),
    slope=SLOPES,
    sideways=SLOPES,
)
def test_capsule_that_lies_moves_alike_alone_and_beside_others(
    speed, share, mu_s, mu_r, slope, sideways
):
    # Its axis is b, its way along x; share 1 rolls. On a plane that falls to its side too, static
    # friction holds it along b, or it slides where that is too weak. Tolerance as for the ball, for
    # each of two contacts; and where it ceases to slip, which is STICK_SPEED early, the slip of its
    # ends in a step or two turns its heading, so that it goes astray along its way.
    normal = np.array([slope, sideways, 1.0]) / np.linalg.norm([slope, sideways, 1.0])
    along = np.cross([0.0, 1.0, 0.0], normal)
    along /= np.linalg.norm(along)
    axis = np.cross(normal, along)
    turn = Rotation.from_matrix(np.transpose([normal, along, axis]))
    spin = share * speed / R * axis
    body = Body(Capsule(R, 2.0 * HALF), R * normal, tuple(turn.as_quat()), speed * along, spin)
    theta = coefficients(0.8 * mu_s, mu_s, mu_r)
    alone, beside = paths(body, theta, [(*normal, 0.0)], FAR_RAILS)
    astray = 2.0 * STICK_SPEED * STEPPED.step / HALF * np.linalg.norm(np.ptp(beside[0][0], axis=0))
    allowed = 2.0 * PRECISION * G * STEPPED.step * TIMES[-1] + astray
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
