"""Tuned numbers of modelling the environment, each with its unit and meaning.

Where a field does not say where its value comes from, it was set by hand when its stage was
written: there is no derivation, and the rendered rooms of the tests and of `make bench-perception`
are what it was run on with that value.
"""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number


@dataclass(frozen=True)
class PlaneDetectionSettings:
    """How planes are searched for by RANSAC, merged, and distinguished from what is no plane.

    `scaled distance` is a distance in units of what noise and unevenness allow (`RangeCloud`).
    """

    scored_points: int = number(1500, 10, 1000000, "points that each hypothesis is scored on")
    batches: int = number(24, 1, 10000, "batches of hypotheses for each plane")
    batch_size: int = number(64, 1, 10000, "hypotheses in a batch")
    refinements: int = number(6, 1, 100, "rounds of least squares over the inliers")
    merge_angle: float = number(
        4.0, 0.0, 90.0, "planes that differ by more are not merged", unit="degrees"
    )
    merge_distance: float = number(
        2.0, 0.0, 100.0, "median scaled distance to another plane up to which both are one"
    )
    bulge_explained: float = number(
        0.2,
        0.0,
        1.0,
        "part of the variance of the heights that a paraboloid must explain for a plane to be the "
        "cap of something round",
    )
    bulge_radii: float = number(
        5.0, 1.0, 1000.0, "radius of curvature of such a cap at most, in largest sphere radii"
    )
    small_part: float = number(
        0.02, 0.0, 1.0, "part of all points below which a plane must be wide to be one"
    )
    small_width: float = number(
        3.0, 0.0, 100.0, "width of such a plane at least, in largest sphere radii"
    )
    behind: float = number(
        2.0, 1.0, 100.0, "scaled distance behind a plane that is neither noise nor unevenness"
    )
    readings_through: int = number(
        10, 1, 100000, "readings behind a plane at least that separate two surfaces in it"
    )
    fraction_through: float = number(
        0.3, 0.0, 1.0, "part of the readings between two surfaces that must be behind the plane"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class PlaneEdgeSettings:
    """When the end of a plane counts as seen.

    A spacing is the distance between neighbouring readings on the plane.
    """

    reach: float = number(
        50.0, 1.0, 10000.0, "how far a plane goes on where no edge of it was seen", unit="m"
    )
    corner_tolerance: float = number(
        1.0, 0.0, 100.0, "height of a corner that simplifying an outline may remove, in spacings"
    )
    shortest_edge: float = number(
        4.0, 0.0, 1000.0, "length of a side of an outline that may be an edge, in spacings"
    )
    slot_width: float = number(
        2.0,
        0.1,
        1000.0,
        "width of the slots across an outline in which ends are looked for, in spacings",
    )
    max_slots: int = number(40, 3, 10000, "slots along one side of an outline at most")
    seen_fraction: float = number(
        0.6, 0.0, 1.0, "part of the slots of a side in which the end must be seen"
    )
    gap: float = number(
        0.03,
        0.0,
        10.0,
        "distance from the last reading on a plane to the first behind it",
        unit="m",
    )
    gap_spacings: float = number(3.0, 0.0, 100.0, "what is added to that distance, in spacings")
    outliers: float = number(
        0.01, 0.0, 0.5, "part of the outermost readings on a plane that may be outliers"
    )
    readings_behind: int = number(
        2, 2, 1000, "readings clearly behind the plane that a slot with an end needs"
    )
    fit_rounds: int = number(4, 1, 100, "rounds of the robust fit of a line to the ends")
    fraction_inside: float = number(
        0.98, 0.0, 1.0, "part of a surface that an edge must leave: else it was fitted to a corner"
    )
    surface_readings: int = number(30, 3, 100000, "readings on a plane whose edges are looked for")
    surface_sigmas: float = number(
        3.0, 0.1, 100.0, "standard deviations of its scatter within which a reading is on a plane"
    )
    smallest_scatter: float = number(
        0.2, 0.0, 1.0, "scaled distance that always counts as on the plane"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class StaticBoxSettings:
    """What becomes a static box, and when a cluster of a later frame is nothing but one."""

    min_size: float = number(
        0.04,
        0.0,
        10.0,
        "longest edge of a box at least: what is smaller is what noise left of an edge",
        unit="m",
    )
    min_thickness: float = number(
        0.02,
        0.0,
        10.0,
        "thickness of a box at least: what is seen of a thinner one is its face. Two edges below "
        "that are an edge of something or noise, and no box",
        unit="m",
    )
    rays_through: int = number(
        30, 1, 1000000, "rays under something by which one sees that it does not stand there"
    )
    outside_fraction: float = number(
        0.01, 0.0, 0.5, "part of the points that may lie outside at each face, as flying pixels do"
    )
    standing_gap: float = number(
        0.1,
        0.0,
        10.0,
        "distance between a floor and the lowest reading of what is taken to stand on it",
        unit="m",
    )
    level_angle: float = number(
        10.0, 0.0, 90.0, "tilt of a plane at most on which boxes stand", unit="degrees"
    )
    filled_diagonal: float = number(
        0.4,
        0.0,
        1.0,
        "part of a box's diagonal that a cluster must extend over to be the box: what is smaller "
        "may be an object before or within a rough box",
    )
    stray_fraction: float = number(
        0.005, 0.0, 1.0, "part of the readings on a box that noise puts outside of it"
    )
    checked_points: int = number(1500, 1, 1000000, "readings of a cluster that are checked at most")
    same_part: float = number(
        0.2,
        0.0,
        1.0,
        "part of its diagonal by which a box that is seen again may differ in place and edges",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class SupportSettings:
    """Which plane can be the support of a camera that is held about upright, and what flights tell
    of gravity."""

    most_roll: float = number(
        30.0,
        0.0,
        180.0,
        "turn about the optical axis between the image's upward direction and the normal of a "
        "support at most: people and robots hold cameras with the horizon about level",
        unit="degrees",
    )
    steepest: float = number(
        65.0,
        0.0,
        90.0,
        "tilt of the camera at most: one that looks down more steeply sees a floor as one that "
        "looks ahead sees a wall",
        unit="degrees",
    )
    least_width: float = number(
        1.2,
        0.0,
        100.0,
        "width at least of a support that is not the largest plane: the side of a box is narrower",
        unit="m",
    )
    from_level: float = number(
        10.0,
        0.0,
        90.0,
        "angle by which it may be off a right angle to the largest plane, which is a wall then",
        unit="degrees",
    )
    flight_time: float = number(
        0.25,
        0.05,
        10.0,
        "duration of a part of a flight that tells gravity: with 2 mm of noise at 30 Hz the "
        "acceleration is then known to 0.5 m/s², 3 degrees",
        unit="s",
    )
    flight_misfit: float = number(
        2.0,
        1.0,
        100.0,
        "mean square of what a constant acceleration leaves of it, in variances, at most: 18 "
        "coordinates less 9 unknowns exceed it once in 30 times",
    )
    gravity_error: float = number(
        0.03, 0.0, 1.0, "part by which drag and spin may change the acceleration of a flight"
    )
    flights: int = number(2, 1, 100, "parts of flights that must agree before they count")
    turned: float = number(
        3.0,
        0.1,
        90.0,
        "angle between gravity as flights tell it and as it was taken from which on the "
        "environment is modelled again, where it is known to a third of that: drag of 3 % turns an "
        "acceleration by up to 1.7 degrees",
        unit="degrees",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class RevisionSettings:
    """When what is modelled of the environment is revised, and when the sensor was moved."""

    gone_time: float = number(
        0.5,
        0.0,
        60.0,
        "time for which one sees farther than before until what was there is gone: a reading that "
        "errs is over by then",
        unit="s",
    )
    come_time: float = number(
        3.0,
        0.0,
        600.0,
        "time for which something nearer stays, and is no object, until it is a part of the "
        "environment: people and hands seldom hold still that long",
        unit="s",
    )
    changed_pixels: float = number(
        12.0,
        1.0,
        1000.0,
        "side of a square of pixels that a change must fill: the face of a box of 4 cm, the "
        "smallest that is modelled, at 1.7 m from a camera of 525 pixels focal length",
    )
    object_margin: int = number(4, 0, 100, "pixels beside an object that are not taken for it")
    hiding_depth: float = number(
        0.1,
        0.0,
        10.0,
        "distance before a plane from which on a reading hides it: what is nearer to the plane "
        "contradicts it",
        unit="m",
    )
    least_visible: float = number(
        0.1,
        0.0,
        1.0,
        "part of the readings, of what it was at first, that nothing hides at least: with less "
        "nothing can be told of the planes",
    )
    covered_time: float = number(
        2.0,
        0.0,
        600.0,
        "time for which nearly all is hidden until the sensor counts as moved",
        unit="s",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class RestSettings:
    """When an accelerometer counts as at rest, so that it measures gravity."""

    rest_time: float = number(0.5, 0.0, 60.0, "time that the sensor must have rested", unit="s")
    averaged_samples: int = number(1000, 1, 1000000, "samples that are averaged at most")
    min_samples: int = number(10, 1, 100000, "samples that the average needs at least")
    max_angular_velocity: float = number(
        0.05,
        0.0,
        10.0,
        "angular velocity of a sensor at rest at most: the bias of a cheap gyroscope is below 0.02",
        unit="rad/s",
    )
    max_change: float = number(
        0.5,
        0.0,
        10.0,
        "difference of an acceleration at rest from the mean at most: the noise of a cheap "
        "accelerometer is 0.1",
        unit="m/s²",
    )
    max_strength_error: float = number(
        0.1,
        0.0,
        1.0,
        "part by which the acceleration at rest may differ from gravity: biases are below 3 %",
    )

    def __post_init__(self) -> None:
        check_settings(self)
