"""Colour images of balls that turn, registered with the depth images of the same camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.rendering.ball_surface import BallSurface
from intuitive_physics_experiments.rendering.camera import Camera
from intuitive_physics_experiments.rendering.depth_noise import DepthNoise, NoisyDepthCamera
from intuitive_physics_experiments.rendering.depth_renderer import DepthRenderer, cast_sphere
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.depth import points_from_depth

SUBPIXELS = 3  # Rays in each direction of the image, over which the colour of a pixel is averaged
ROOM_REFLECTANCE = 0.6  # Reflectance of everything but the balls, grey


@dataclass(frozen=True)
class RoomLight:
    """Light that stands still in the room."""

    # (3,) towards the light, in the world, of any length
    direction: tuple[float, float, float] = (-0.4, 0.3, 1.0)
    # ambient, diffuse: part of the light from all sides and from that direction
    ambient: float = 0.35
    diffuse: float = 0.65
    gloss: float = 0.0  # height of a highlight, 0 for a dull ball
    gloss_exponent: float = 40.0  # the larger the smaller is the highlight

    def shading(
        self, normals: NDArray[np.float64], to_camera: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the factor (...,) of the reflectance and the white highlight (...,) added to it.

        The `normals` (..., 3) and `to_camera` (..., 3) are unit vectors in the world.
        """
        light = np.asarray(self.direction) / np.linalg.norm(self.direction)
        cosine = normals @ light
        half = to_camera + light
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        mirrored = np.maximum(np.einsum("...i,...i", normals, half), 0.0)
        factor = self.ambient + self.diffuse * np.maximum(cosine, 0.0)
        return factor, self.gloss * mirrored**self.gloss_exponent


@dataclass(frozen=True)
class ColorNoise:
    """Faults of the colour image."""

    deviation: float = 3.0  # standard deviation of each channel in levels of 255
    # pixels, standard deviation of what lens and demosaicing make of a point; the noise is blurred
    # by half of it
    blur: float = 0.5

    def __post_init__(self) -> None:
        if min(self.deviation, self.blur) < 0.0:
            raise InvalidInputError(
                f"colour noise is {self.deviation:g} levels and blur {self.blur:g} pixels; "
                "expected none below 0"
            )


@dataclass(frozen=True, eq=False)
class ColoredBall:
    """A ball at an instant, in the world."""

    center: NDArray[np.float64]  # (3,) m
    radius: float  # m
    surface: BallSurface  # what is painted on it
    # (3, 3), the ball's axes to the world
    orientation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    # velocity, angular_velocity: (3,) m/s and rad/s
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def after(self, duration: float) -> ColoredBall:
        """Return it some time later, s, without any force."""
        turn = Rotation.from_rotvec(duration * self.angular_velocity).as_matrix()
        return ColoredBall(
            self.center + duration * self.velocity,
            self.radius,
            self.surface,
            turn @ self.orientation,
            self.velocity,
            self.angular_velocity,
        )


class ColorCamera:
    """Renders colour images of a room in the view of a depth renderer."""

    def __init__(
        self,
        renderer: DepthRenderer,
        light: RoomLight,
        noise: ColorNoise,
        rng: np.random.Generator,
    ) -> None:
        self._renderer = renderer
        self._camera: Camera = renderer.camera
        self._light, self._noise, self._rng = light, noise, rng
        shade = 0.5 + 0.5 * renderer.background.incidence_cosine
        self._background = np.repeat(255.0 * ROOM_REFLECTANCE * shade[..., None], 3, axis=2)
        self._rays = self._camera.rays()

    def read(self, balls: Sequence[ColoredBall] = ()) -> NDArray[np.uint8]:
        """Return red, green and blue (height, width, 3) of the room with some balls."""
        from scipy.ndimage import gaussian_filter

        image = self._background.copy()
        if balls:
            region = self._renderer.render_balls(
                [ball.center for ball in balls], [ball.radius for ball in balls]
            ).region
            margin = 6
            rows = slice(max(region.rows.start - margin, 0), region.rows.stop + margin)
            columns = slice(max(region.columns.start - margin, 0), region.columns.stop + margin)
            part = self._averaged(balls, rows, columns)
            blur = self._noise.blur
            image[rows, columns] = gaussian_filter(part, (blur, blur, 0.0)) if blur else part
        return self._with_noise(image)

    def _averaged(
        self, balls: Sequence[ColoredBall], rows: slice, columns: slice
    ) -> NDArray[np.float64]:
        """A part of the image, averaged over the area of each pixel."""
        steps = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
        offsets = [(dy, dx) for dy in steps for dx in steps]
        total = np.zeros((*self._rays[rows, columns].shape[:2], 3))
        for dy, dx in offsets:
            rays = self._rays[rows, columns].copy()
            rays[..., :2] += np.array([dx, dy]) / self._camera.focal_length
            total += self._sampled(balls, rays, self._background[rows, columns])
        return total / len(offsets)

    def _sampled(
        self,
        balls: Sequence[ColoredBall],
        rays: NDArray[np.float64],
        background: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Colours (..., 3), 0 to 255, of rays (..., 3): of the nearest ball, or the background."""
        colors, nearest = background.copy(), np.full(rays.shape[:-1], np.inf)
        for ball in balls:
            center = self._camera.to_optical(ball.center)
            depth, _ = cast_sphere(rays, center, ball.radius)
            nearer = (depth > 0.0) & (depth < nearest)
            nearest[nearer] = depth[nearer]
            directions = rays[nearer]
            normals = (depth[nearer][:, None] * directions - center) / ball.radius
            back = -directions / np.linalg.norm(directions, axis=1, keepdims=True)
            to_world = self._camera.rotation.T
            normals, back = normals @ to_world, back @ to_world
            factor, highlight = self._light.shading(normals, back)
            reflectance = ball.surface.reflectance(normals @ ball.orientation)
            colors[nearer] = 255.0 * (reflectance * factor[:, None] + highlight[:, None])
        return colors

    def _with_noise(self, image: NDArray[np.float64]) -> NDArray[np.uint8]:
        noise = self._noise
        if noise.deviation > 0.0:
            from scipy.ndimage import gaussian_filter

            white = self._rng.standard_normal(image.shape, dtype=np.float32)
            if noise.blur > 0.0:
                half = 0.5 * noise.blur
                white = gaussian_filter(white, (half, half, 0.0))
                white /= white.std()
            image = image + noise.deviation * white
        return np.clip(np.rint(image), 0.0, 255.0).astype(np.uint8)


class DepthColorCamera:
    """Registered depth and colour images, each with its noise."""

    def __init__(
        self, renderer: DepthRenderer, rng: np.random.Generator, light: RoomLight | None = None
    ) -> None:
        camera, self._renderer = renderer.camera, renderer
        self._depth = NoisyDepthCamera(renderer.background, camera.focal_length, DepthNoise(), rng)
        self._color = ColorCamera(renderer, light or RoomLight(), ColorNoise(), rng)
        self._rays = Intrinsics(camera.width, camera.height, camera.matrix()).rays()

    def points(self, balls: Sequence[ColoredBall] = ()) -> NDArray[np.float32]:
        """Return the points (height, width, 3) m of an image, NaN where nothing was measured."""
        rendered = self._renderer.render_balls(
            [ball.center for ball in balls], [ball.radius for ball in balls]
        )
        depth = self._depth.read(rendered.image, rendered.region)
        return points_from_depth(depth, self._rays)

    def colors(self, balls: Sequence[ColoredBall] = ()) -> NDArray[np.uint8]:
        """Return red, green and blue (height, width, 3) of an image."""
        return self._color.read(balls)
