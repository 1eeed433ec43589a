"""The scene of Sec. VI: a floor, two walls, three kinds of ball, and a depth camera."""

from __future__ import annotations

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane
from intuitive_physics_experiments.rendering.camera import Camera

ROOM_MATERIAL = "room"  # Material of floor and walls
WALL_DISTANCE = 1.0  # m along x and y from the world's origin, on the floor, to the two walls

# m, by material: the 7, 5 and 3 cm balls of Sec. VI-A.
BALL_RADII = {"foam": 0.07, "rubber": 0.05, "wood": 0.03}

MATERIALS = (*BALL_RADII, ROOM_MATERIAL)  # All materials, in the order of the parameters
_DENSITIES = {"foam": 120.0, "rubber": 1100.0, "wood": 650.0}  # kg/m³, by material

# Friction, rolling friction and restitution against the room, by material.
_COEFFICIENTS = {
    "foam": (0.60, 0.040, 0.60),
    "rubber": (0.45, 0.015, 0.80),
    "wood": (0.30, 0.008, 0.50),
}


def corner_environment() -> Environment:
    """Return Ω_e: floor z = 0 and walls x = 1 m, y = 1 m, unbounded, gravity 9.81 m/s² down."""
    return Environment(
        [
            Plane("floor", ROOM_MATERIAL, (0.0, 0.0, 1.0), 0.0),
            Plane("wall_x", ROOM_MATERIAL, (-1.0, 0.0, 0.0), -WALL_DISTANCE),
            Plane("wall_y", ROOM_MATERIAL, (0.0, -1.0, 0.0), -WALL_DISTANCE),
        ]
    )


def true_parameters() -> StaticParameters:
    """Return the θ_s the thrown balls obey.

    Static and dynamic friction of a pair are equal, since PyBullet has one coefficient. Pairs of
    two balls never touch and stay at their defaults.
    """
    parameters = StaticParameters.uniform(MATERIALS)
    for material, (friction, rolling_friction, restitution) in _COEFFICIENTS.items():
        parameters = parameters.with_density(material, _DENSITIES[material]).with_pair(
            material,
            ROOM_MATERIAL,
            static_friction=friction,
            dynamic_friction=friction,
            rolling_friction=rolling_friction,
            restitution=restitution,
        )
    return parameters


def corner_camera() -> Camera:
    """Return a camera 1.3 m high, 2.4 m from the corner, looking 35° down into it.

    So the floor fills the largest part of the image, as Sec. VI-B assumes.
    """
    return Camera.looking_at((-0.7, -0.7, 1.3), (0.43, 0.43, 0.18))
