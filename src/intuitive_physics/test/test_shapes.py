"""Volumes and inertias against integrals over the solids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.shapes import Box, Capsule, Sphere, shape_from_dict

LENGTH = st.floats(0.01, 3.0)


def inside(shape, points):
    x, y, z = points.T
    if isinstance(shape, Box):
        return (np.abs(points) <= 0.5 * np.array(shape.edge_lengths)).all(axis=1)
    if isinstance(shape, Sphere):
        return x**2 + y**2 + z**2 <= shape.radius**2
    along = np.clip(z, -0.5 * shape.length, 0.5 * shape.length)
    return x**2 + y**2 + (z - along) ** 2 <= shape.radius**2


def half_extents(shape):
    if isinstance(shape, Box):
        return 0.5 * np.array(shape.edge_lengths)
    if isinstance(shape, Sphere):
        return np.full(3, shape.radius)
    return np.array([shape.radius, shape.radius, shape.radius + 0.5 * shape.length])


@pytest.mark.parametrize("shape", [Sphere(0.3), Box((0.2, 0.5, 0.9)), Capsule(0.2, 0.7)])
def test_volume_and_inertia_are_the_integrals(shape):
    # V = ∫ dV, I_xx = ∫ (y² + z²) dV, by the midpoint rule on n³ cells: error O(1 / n) at the
    # curved surfaces.
    n = 160
    half = half_extents(shape)
    axis = (np.arange(n) + 0.5) / n * 2 - 1
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) * half
    cell = np.prod(2 * half / n)
    points = points[inside(shape, points)]
    squares = (points**2).sum(axis=0)
    assert shape.volume == pytest.approx(len(points) * cell, rel=0.02)
    np.testing.assert_allclose(
        shape.unit_density_inertia(), (squares.sum() - squares) * cell, rtol=0.02
    )


def test_long_thin_capsule_is_a_rod():
    # I = M L² / 12 as r / L → 0
    rod = Capsule(1e-4, 1.0)
    transverse = rod.inertia(1000.0)[0]
    assert transverse == pytest.approx(rod.mass(1000.0) / 12, rel=1e-3)


@given(
    st.one_of(
        st.builds(Sphere, LENGTH),
        st.builds(Box, st.tuples(*[LENGTH] * 3)),
        st.builds(Capsule, LENGTH, LENGTH),
    ),
    st.floats(1.0, 1e4),
)
def test_laws_of_any_shape(shape, density):
    # Mass is linear in density; principal moments obey the triangle inequality; nothing reaches
    # beyond the bounding radius; the description reads back.
    assert shape.mass(2 * density) == pytest.approx(2 * shape.mass(density))
    moments = shape.inertia(density)
    assert (moments.sum() - 2 * moments >= -1e-9 * moments.sum()).all()
    assert (moments <= shape.mass(density) * shape.bounding_radius**2 * (1 + 1e-9)).all()
    assert shape_from_dict(shape.to_dict()) == shape


@pytest.mark.parametrize(
    "make",
    [
        lambda: Sphere(0.0),
        lambda: Sphere(float("nan")),
        lambda: Sphere("big"),
        lambda: Box((1.0, -1.0, 1.0)),
        lambda: Box((1.0, 1.0)),
        lambda: Capsule(1.0, float("inf")),
        lambda: Capsule(1.0, -1.0),
        lambda: Sphere(-1.0),
        lambda: Sphere(1.0).mass(-5.0),
        lambda: shape_from_dict({"kind": "cone"}),
        lambda: shape_from_dict({"kind": "sphere", "length": 1.0}),
        lambda: shape_from_dict({}),
    ],
)
def test_bad_shapes_are_refused(make):
    with pytest.raises(IntuitivePhysicsError, match="expected"):
        make()
