"""`Shape` and `Region` messages and the library's shapes and regions."""

from __future__ import annotations

from intuitive_physics_msgs.msg import Region as RegionMessage
from intuitive_physics_msgs.msg import Shape as ShapeMessage

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.regions import BallRegion, BoxRegion, HalfSpaceRegion, Region
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics_ros.conversions.fields import flat_array, float64_field, in_field

DIMENSION_COUNTS = {ShapeMessage.SPHERE: 1, ShapeMessage.BOX: 3, ShapeMessage.CAPSULE: 2}
"""Numbers in the field `dimensions`, by kind of shape."""


def shape_to_message(shape: Shape) -> ShapeMessage:
    """Return a shape as a message."""
    dimensions: tuple[float, ...]
    match shape:
        case Sphere():
            kind, dimensions = ShapeMessage.SPHERE, (shape.radius,)
        case Box():
            kind, dimensions = ShapeMessage.BOX, shape.edge_lengths
        case Capsule():
            kind, dimensions = ShapeMessage.CAPSULE, (shape.radius, shape.length)
        case _:
            raise InvalidInputError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")
    return ShapeMessage(kind=kind, dimensions=float64_field(dimensions))


def shape_from_message(message: ShapeMessage) -> Shape:
    """Return the shape that a message describes.

    Raises
    ------
    InvalidInputError
        When the kind is unknown, or dimensions are missing, superfluous or not above zero.
    """
    with in_field("kind"):
        count = DIMENSION_COUNTS.get(message.kind)
        if count is None:
            raise InvalidInputError(
                f"is {message.kind}; expected {ShapeMessage.SPHERE} (sphere), "
                f"{ShapeMessage.BOX} (box) or {ShapeMessage.CAPSULE} (capsule)"
            )
    with in_field("dimensions"):
        dimensions = flat_array(message.dimensions, (count,)).tolist()
        match message.kind:
            case ShapeMessage.SPHERE:
                return Sphere(*dimensions)
            case ShapeMessage.BOX:
                return Box(tuple(dimensions))
            case _:
                return Capsule(*dimensions)


def region_from_message(message: RegionMessage) -> Region:
    """Return the region a message describes.

    Raises
    ------
    InvalidInputError
        When its kind is none of SPHERE, BOX, HALF_SPACE, a number is not finite or a size not
        above zero.
    """
    at, turned = message.pose.position, message.pose.orientation
    center = (at.x, at.y, at.z)
    if message.kind == RegionMessage.SPHERE:
        return BallRegion(center, message.radius)
    if message.kind == RegionMessage.BOX:
        edges = message.edge_lengths
        orientation = (turned.x, turned.y, turned.z, turned.w)
        return BoxRegion(center, orientation, (edges.x, edges.y, edges.z))
    if message.kind == RegionMessage.HALF_SPACE:
        normal = message.normal
        return HalfSpaceRegion((normal.x, normal.y, normal.z), message.offset)
    raise InvalidInputError(
        f"region kind is {message.kind}; expected {RegionMessage.SPHERE} (SPHERE), "
        f"{RegionMessage.BOX} (BOX) or {RegionMessage.HALF_SPACE} (HALF_SPACE)"
    )
