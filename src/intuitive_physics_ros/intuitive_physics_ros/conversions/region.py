"""`Region` messages and the library's regions."""

from __future__ import annotations

from intuitive_physics_msgs.msg import Region as RegionMessage

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.regions import BallRegion, BoxRegion, HalfSpaceRegion, Region


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
