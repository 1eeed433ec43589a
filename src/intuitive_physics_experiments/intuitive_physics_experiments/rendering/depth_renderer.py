"""Ideal depth images of balls in front of a static background.

The background is ray-cast once by Open3D's RaycastingScene; of every frame only the rectangle
around the balls is cast again, against the exact spheres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.geometry.polygons import clip_polygon, plane_square
from intuitive_physics.geometry.rotations import rotation_matrix
from intuitive_physics.scene import Environment
from intuitive_physics.validation import finite_array
from intuitive_physics_experiments.rendering.camera import Camera

# Instants of an exposure at which a moving ball is cast: one of 12 cm sweep goes 4 mm between two
INSTANTS = 31

# Share of the exposure for which a pixel has to see a ball to read it; else it reads what is behind
LEAST_SHARE = 0.5

# m that a plane without boundary reaches to each side of the point nearest the origin.
PLANE_EXTENT = 4.0


@dataclass(frozen=True, eq=False)
class DepthImage:
    """Image of an ideal camera."""

    # (height, width) m along the optical axis; 0 where there is no surface
    depth: NDArray[np.float32]
    # (height, width), between ray and surface normal; 1 where there is none
    incidence_cosine: NDArray[np.float32]


@dataclass(frozen=True)
class ImageRegion:
    """Rows and columns of an image that balls may cover."""

    rows: slice
    columns: slice

    @property
    def empty(self) -> bool:
        """Whether it holds no pixel."""
        return self.rows.start >= self.rows.stop or self.columns.start >= self.columns.stop


@dataclass(frozen=True, eq=False)
class RenderedBalls:
    """The part of an image that balls may cover."""

    image: DepthImage  # what is seen there
    region: ImageRegion  # where that is
    # (height, width) of the region; number of the ball a pixel sees, -1 for none
    owner: NDArray[np.int16]


class DepthRenderer:
    """Renders balls among the planes and boxes of an environment.

    A plane reaches `PLANE_EXTENT` and ends where another cuts it off.
    """

    def __init__(self, camera: Camera, environment: Environment) -> None:
        self.camera = camera
        self._rays = camera.rays().astype(np.float32)
        self.background = cast_static(camera, environment, self._rays)

    def render_balls(
        self,
        centers: Sequence[ArrayLike],
        radii: Sequence[float],
        sweeps: Sequence[ArrayLike] | None = None,
    ) -> RenderedBalls:
        """Return the rectangle of the image that covers balls of `centers` (3,) m and radii in m.

        `sweeps` (3,) m: ways of the centres during the exposure, in the middle of which they are at
        `centers`; None: at rest. A ball that reaches behind the camera's image plane is an error.
        """
        optical = [self.camera.to_optical(finite_array(c, "ball center", (3,))) for c in centers]
        ways = [np.zeros(3)] * len(optical)
        if sweeps is not None:
            ways = [finite_array(way, "sweep", (3,)) @ self.camera.rotation for way in sweeps]
        regions = [
            _union(self._swept_regions(c, way, radius))
            for c, way, radius in zip(optical, ways, radii, strict=True)
        ]
        region = _union([part for part in regions if not part.empty])
        crop = (region.rows, region.columns)
        depth = self.background.depth[crop].copy()
        cosine = self.background.incidence_cosine[crop].copy()
        owner = np.full(depth.shape, -1, dtype=np.int16)
        balls = zip(optical, radii, ways, regions, strict=True)
        for k, (center, radius, way, part) in enumerate(balls):
            if part.empty:
                continue
            inside = _relative(part, region)
            ball_depth, ball_cosine = cast_swept_sphere(
                self._rays[part.rows, part.columns], center, radius, way
            )
            nearer = (ball_depth > 0.0) & ((depth[inside] == 0.0) | (ball_depth < depth[inside]))
            depth[inside][nearer] = ball_depth[nearer]
            cosine[inside][nearer] = ball_cosine[nearer]
            owner[inside][nearer] = k
        return RenderedBalls(DepthImage(depth, cosine), region, owner)

    def _swept_regions(
        self, center: NDArray[np.float64], way: NDArray[np.float64], radius: float
    ) -> list[ImageRegion]:
        """Regions at the beginning, in the middle and at the end of the exposure that hold
        pixels."""
        regions = [self._ball_region(center + side * way, radius) for side in (-0.5, 0.0, 0.5)]
        return [part for part in regions if not part.empty]

    def _ball_region(self, optical: NDArray[np.float64], radius: float) -> ImageRegion:
        x, y, z = optical
        if z <= radius:
            raise InvalidInputError(
                f"ball of radius {radius:g} m is at depth {z:g} m; expected it before the camera"
            )
        camera = self.camera
        columns = _tangent_bounds(x, z, radius, camera.principal_point[0], camera)
        rows = _tangent_bounds(y, z, radius, camera.principal_point[1], camera)
        return ImageRegion(
            slice(*np.clip(rows, 0, camera.height)), slice(*np.clip(columns, 0, camera.width))
        )


def _union(regions: Sequence[ImageRegion]) -> ImageRegion:
    """Return the smallest region that holds all others, an empty one for none."""
    if not regions:
        return ImageRegion(slice(0, 0), slice(0, 0))
    rows, columns = [part.rows for part in regions], [part.columns for part in regions]
    return ImageRegion(
        *(
            slice(min(part.start for part in parts), max(part.stop for part in parts))
            for parts in (rows, columns)
        )
    )


def _relative(part: ImageRegion, whole: ImageRegion) -> tuple[slice, slice]:
    """Return where a region lies in another that holds it."""
    top, left = whole.rows.start, whole.columns.start
    return (
        slice(part.rows.start - top, part.rows.stop - top),
        slice(part.columns.start - left, part.columns.stop - left),
    )


def _tangent_bounds(
    lateral: float, z: float, radius: float, center: float, camera: Camera
) -> tuple[int, int]:
    # Tangents from the origin to a circle of that radius at (lateral, z).
    root = radius * np.sqrt(lateral**2 + z**2 - radius**2)
    slopes = (lateral * z + np.array([-root, root])) / (z**2 - radius**2)
    low, high = center + camera.focal_length * slopes
    return int(np.floor(low)), int(np.ceil(high)) + 1


def cast_sphere(
    rays: NDArray[np.floating], center: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return depth (...,) m, 0 where missed, and cosine of incidence (...,) of rays on a sphere.

    The `rays` (..., 3) are directions with z = 1; the `center` (3,) m, or one for each ray, is in
    the camera's frame.
    """
    directions = rays.astype(np.float64)
    square = np.einsum("...i,...i", directions, directions)
    along = (directions * center).sum(axis=-1)
    discriminant = along**2 - square * ((center * center).sum(axis=-1) - radius**2)
    root = np.sqrt(np.maximum(discriminant, 0.0))
    depth = np.where(discriminant > 0.0, (along - root) / square, 0.0)
    # -n · d / |d| with n = (t d - c) / r, which simplifies to root / (r |d|).
    cosine = root / (radius * np.sqrt(square))
    return depth.astype(np.float32), cosine.astype(np.float32)


def cast_swept_sphere(
    rays: NDArray[np.floating],
    center: NDArray[np.float64],
    radius: float,
    sweep: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return depth (...,) m, 0 where missed, and cosine of incidence (...,) of rays on a ball that
    moves during the exposure: their means over the time in which a pixel sees it.

    `rays` (..., 3) with z = 1; `center` (3,) m in the middle of the exposure and `sweep` (3,) m,
    its way meanwhile, in the camera's frame.
    """
    if not sweep.any():
        return cast_sphere(rays, center, radius)
    times = (np.arange(INSTANTS) + 0.5) / INSTANTS - 0.5
    cast = [cast_sphere(rays, center + time * sweep, radius) for time in times]
    depths, cosines = (np.stack(parts) for parts in zip(*cast, strict=True))
    seen = (depths > 0.0).sum(axis=0)
    kept = seen > LEAST_SHARE * INSTANTS
    count = np.maximum(seen, 1)
    return np.where(kept, depths.sum(axis=0) / count, 0.0).astype(np.float32), np.where(
        kept, cosines.sum(axis=0) / count, 0.0
    ).astype(np.float32)


def cast_static(camera: Camera, environment: Environment, rays: NDArray[np.float32]) -> DepthImage:
    """Return what `rays` (..., 3) with z = 1 in the camera's frame meet of planes and boxes."""
    open3d = _open3d()
    scene = open3d.t.geometry.RaycastingScene()
    for vertices, triangles in (*_plane_meshes(environment), *_box_meshes(environment)):
        scene.add_triangles(
            open3d.core.Tensor(vertices.astype(np.float32)),
            open3d.core.Tensor(triangles.astype(np.uint32)),
        )
    directions = rays @ camera.rotation.T.astype(np.float32)
    origins = np.broadcast_to(camera.position.astype(np.float32), directions.shape)
    hits = scene.cast_rays(open3d.core.Tensor(np.concatenate([origins, directions], axis=-1)))
    depth = hits["t_hit"].numpy()
    lengths = np.linalg.norm(directions, axis=-1)
    cosine = np.abs((hits["primitive_normals"].numpy() * directions).sum(axis=-1)) / lengths
    hit = np.isfinite(depth)
    return DepthImage(
        np.where(hit, depth, 0.0).astype(np.float32), np.where(hit, cosine, 1.0).astype(np.float32)
    )


def _plane_meshes(environment: Environment) -> list[tuple[NDArray, NDArray]]:
    meshes = []
    for plane in environment.planes:
        corners = plane.boundary
        if corners is None:
            corners = plane_square(plane.normal, plane.offset, np.zeros(3), PLANE_EXTENT)
        for other in environment.planes:
            if other is not plane:
                corners = clip_polygon(corners, other.normal, other.offset)
        if len(corners) >= 3:
            fan = [(0, i, i + 1) for i in range(1, len(corners) - 1)]
            meshes.append((np.asarray(corners), np.array(fan)))
    return meshes


def _box_meshes(environment: Environment) -> list[tuple[NDArray, NDArray]]:
    # Corner k has the sign of bit b of k along axis b; each face is two triangles.
    signs = np.array([[1.0 if k >> b & 1 else -1.0 for b in range(3)] for k in range(8)])
    faces = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    return [
        (
            box.center + 0.5 * signs * box.edge_lengths @ rotation_matrix(box.orientation).T,
            triangles,
        )
        for box in environment.boxes
    ]


def _open3d() -> ModuleType:
    try:
        import open3d
    except ImportError as error:
        raise IntuitivePhysicsError(
            f"Open3D cannot be loaded ({error}); rendering needs the Python package open3d-cpu and "
            "the system packages libusb-1.0-0, libgl1, libegl1, libx11-6 and libudev1"
        ) from None
    return open3d
