"""All settings of perception in one place: the library's and the node's parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import check_settings, choice, number, other
from intuitive_physics.validation import name_string, positive_float, unit_vector

GRAVITY_SOURCES = ("plane", "up_hint", "imu")
"""Values of the setting `gravity_source`."""


@dataclass(frozen=True)
class KnownObject:
    """An object that is known beforehand by its radius.

    Parameters
    ----------
    name : what ids of its tracks begin with
    radius : m
    material : name
    """

    name: str
    radius: float
    material: str

    def __post_init__(self) -> None:
        name_string(self.name, "name of a known object")
        object.__setattr__(
            self, "radius", positive_float(self.radius, f"radius of known object {self.name}")
        )
        name_string(self.material, f"material of known object {self.name}")


@dataclass(frozen=True)
class PerceptionSettings:
    """Settings of perception. Every field has its meaning, unit and range in its metadata.

    Raises
    ------
    InvalidInputError
        When a value lies outside its range or two values contradict each other.
    """

    min_range: float = number(0.15, 0.01, 100.0, "nearer points are ignored, m")
    max_range: float = number(30.0, 0.1, 1000.0, "farther points are ignored, m")
    range_noise_constant: float = number(
        0.002, 1e-5, 1.0, "standard deviation of a range reading at close range, m"
    )
    range_noise_quadratic: float = number(
        0.0015, 0.0, 1.0, "growth of that standard deviation with range squared, 1/m"
    )
    range_noise_max: float = number(
        0.05, 1e-4, 10.0, "the standard deviation of a range reading never exceeds this, m"
    )
    estimate_noise: bool = other(
        True,
        "measure the range noise on the planes of the environment once they are known, and from "
        "frame to frame how the errors of neighbouring readings go together",
    )
    lateral_noise: float = number(
        0.0008, 0.0, 0.1, "standard deviation of the direction of a reading, rad"
    )
    correlated_readings: float = number(
        2.0,
        1.0,
        100.0,
        "neighbouring readings that share one error, as a matching window makes; with "
        "estimate_noise it is measured on the first frames",
    )

    environment_frames: int = number(8, 1, 300, "frames fused to model the environment")
    plane_min_fraction: float = number(
        0.008, 0.002, 1.0, "smallest part of all points that makes a plane"
    )
    plane_tolerance: float = number(
        0.005, 0.0, 1.0, "unevenness of a plane that is no object on it, m"
    )
    plane_sigmas: float = number(
        4.0, 1.0, 10.0, "standard deviations of the noise within which a point belongs to a plane"
    )
    gravity: float = number(9.81, 0.0, 100.0, "strength of gravity, m/s^2")
    gravity_source: str = choice(
        "plane",
        GRAVITY_SOURCES,
        "source of the direction of gravity: the normal of the support, up_hint taken as exact, or "
        "an IMU",
    )
    up_hint: tuple[float, float, float] | None = other(
        None,
        "roughly upward direction in the sensor's frame; none: the plane with most points is the "
        "support",
    )
    camera_upright: bool = other(
        True,
        "the camera is held about upright, so that a wall is no support even where it has most "
        "points; of depth images and organised clouds, without up_hint",
    )
    gravity_from_flights: bool = other(
        True,
        "measure the direction of gravity on what falls freely: where it differs from that of the "
        "support the environment is modelled again",
    )
    moved_fraction: float = number(
        0.6,
        0.0,
        1.0,
        "the sensor was moved when less than this part of the readings that should lie on planes "
        "does; 0: never",
    )
    revise_environment: bool = other(
        True,
        "add planes and boxes that come and stay, remove those that one sees through; of clouds "
        "with fixed pixels only",
    )
    plane_material: str = other("environment", "material of the planes")
    static_boxes: bool = other(
        True,
        "model what stands there from the start and is no object as boxes; false: leave it out",
    )
    static_box_max_size: float = number(
        2.0, 0.05, 100.0, "what is longer is not modelled as one box, m"
    )
    environment_frame_id: str = other(
        "intuitive_physics/environment",
        "name of the gravity-aligned frame everything is published in; of a node in a namespace "
        "the default is NAMESPACE/intuitive_physics/environment",
    )

    exposure: float = number(
        0.0,
        0.0,
        0.1,
        "time for which the sensor exposes a frame, with the stamp in its middle: what moves fast "
        "is swept along its way meanwhile, s; 0: it freezes all motion",
    )
    min_radius: float = number(0.015, 0.001, 10.0, "smallest radius of a sphere, m")
    max_radius: float = number(0.40, 0.001, 10.0, "largest radius of a sphere, m")
    min_points: int = number(30, 8, 100000, "points a sphere needs at least")
    hypothesis_budget: float = number(
        15.0,
        1.0,
        1000.0,
        "time that a frame of a live camera may take with hypotheses of objects; what is followed "
        "comes first, then what is new, then what has waited longest",
        unit="ms",
    )
    find_solids: bool = other(True, "look for boxes and capsules, too")
    solids_are_objects: bool = other(
        False,
        "boxes and capsules that lie there from the start are objects; false: static boxes",
    )
    max_solid_size: float = number(
        0.8, 0.01, 100.0, "a box or capsule reaches no further from end to end, m"
    )
    object_material: str = other(
        "ball",
        "material of what is no known object: of boxes and capsules, and how the names of the "
        "materials of spheres begin, one for each size",
    )
    material_radius_ratio: float = number(
        1.2,
        1.0,
        10.0,
        "largest over smallest radius of unknown spheres that share a material: with 1.2 those of "
        "46 to 55 mm have ball_46_55mm, and so on up and down; 1: all have `object_material`",
    )
    known_objects: tuple[KnownObject, ...] = other((), "objects known by their radius")
    known_object_tolerance: float = number(
        0.006, 0.0001, 1.0, "a sphere is a known object when its radius differs by no more, m"
    )

    acceleration_noise: float = number(
        1.5,
        0.0,
        1000.0,
        "standard deviation of an unmodelled acceleration, over 1/30 s, m/s^2",
    )
    max_speed: float = number(15.0, 0.1, 1000.0, "fastest object, m/s")
    rest_speed: float = number(0.05, 0.001, 10.0, "a slower object may be at rest, m/s")
    rest_time: float = number(0.5, 0.05, 60.0, "time of no motion after which it is, s")

    min_travel: float = number(
        0.15, 0.01, 1000.0, "an object that moved less is not worth learning from, m"
    )
    max_duration: float = number(
        10.0, 0.1, 3600.0, "duration after which an observation is closed, s"
    )
    angular_velocity_deviation: float = number(
        10.0, 0.0, 10000.0, "standard deviation of an unknown angular velocity, rad/s"
    )
    spin_from_surface: bool = other(
        True,
        "measure the spin of a ball in free flight on what is painted on it, where colours come "
        "with an organised cloud or a depth image",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        for low, high in (("min_range", "max_range"), ("min_radius", "max_radius")):
            if getattr(self, low) >= getattr(self, high):
                raise InvalidInputError(
                    f"{low} is {getattr(self, low):g} and {high} is {getattr(self, high):g}; "
                    f"expected {low} below {high}"
                )
        if self.up_hint is not None:
            x, y, z = map(float, unit_vector(self.up_hint, "up_hint"))
            object.__setattr__(self, "up_hint", (x, y, z))
        elif self.gravity_source == "up_hint":
            raise InvalidInputError(
                "gravity_source is 'up_hint' and there is no up_hint; expected the upward "
                "direction in the sensor's frame"
            )
        if self.solids_are_objects and not self.find_solids:
            raise InvalidInputError(
                "solids_are_objects is true and find_solids is false; expected find_solids true, "
                "as only what is looked for is found"
            )
        object.__setattr__(self, "known_objects", _checked_objects(self.known_objects))


def _checked_objects(objects: Iterable[Any]) -> tuple[KnownObject, ...]:
    checked = tuple(objects)
    for item in checked:
        if not isinstance(item, KnownObject):
            raise InvalidInputError(f"known object is {item!r}; expected a KnownObject")
    names = [item.name for item in checked]
    if len(set(names)) != len(names):
        raise InvalidInputError(f"known objects are named {names}; expected each name once")
    return checked


NO_OBJECT = KnownObject("none", 1.0, "none")
"""Stands in the lists of known objects, which ROS cannot have empty, when there are none."""

NO_DIRECTION = (0.0, 0.0, 0.0)
"""Value of the parameter `up_hint` that stands for none: ROS parameters have a value."""


def settings_from_values(values: Mapping[str, Any]) -> PerceptionSettings:
    """Return the settings that values by name describe.

    `values`: every setting that is a number, word or choice by its own name; `up_hint`, zeros for
    none; `known_object_names`, `known_object_radii` in m and `known_object_materials`. Others are
    left alone.

    Raises
    ------
    InvalidInputError
        When the lists of known objects differ in length or a value is out of range.
    """
    columns = [list(values[f"known_object_{name}"]) for name in ("names", "radii", "materials")]
    if len({len(column) for column in columns}) != 1:
        raise InvalidInputError(
            f"known_object_names, _radii and _materials have {[len(c) for c in columns]} entries; "
            "expected as many of each"
        )
    known = [KnownObject(*row) for row in zip(*columns, strict=True)]
    hint = tuple(values["up_hint"])
    if len(hint) != 3:
        raise InvalidInputError(f"up_hint has {len(hint)} numbers; expected x, y and z")
    plain = {
        setting.name: values[setting.name]
        for setting in fields(PerceptionSettings)
        if isinstance(setting.default, bool | int | float | str)
    }
    return PerceptionSettings(
        up_hint=None if hint == NO_DIRECTION else hint,
        known_objects=() if known == [NO_OBJECT] else tuple(known),
        **plain,
    )
