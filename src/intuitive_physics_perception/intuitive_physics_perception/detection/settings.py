"""Tuned numbers of detection, each with its unit and meaning.

Where a field does not say where its value comes from, it was set by hand when its stage was
written: there is no derivation, and the rendered rooms of the tests and of `make bench-perception`
are what it was run on with that value.
"""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number


@dataclass(frozen=True)
class ClusterSettings:
    """How foreground is split into clusters, and how often a cluster that stays is searched."""

    jump: float = number(
        0.02, 0.0, 10.0, "difference of range that separates neighbouring pixels", unit="m"
    )
    jump_sigmas: float = number(
        6.0, 0.0, 100.0, "standard deviations of the range that are added to that difference"
    )
    cells_per_gap: float = number(
        4.0,
        1.0,
        100.0,
        "cells along a gap in a cloud that is not organised; one reading stands for its cell",
    )
    count_tolerance: float = number(
        0.2, 0.0, 1.0, "part by which the size of a cluster may change while it stays as it is"
    )
    movement: float = number(
        0.2, 0.0, 10.0, "movement of its centre while it stays as it is, in smallest sphere radii"
    )
    movement_sigmas: float = number(
        3.0,
        0.0,
        100.0,
        "standard deviations of the movement that the noise of its readings makes, added to that",
    )
    first_searches: int = number(
        3, 1, 1000, "frames in a row in which a cluster is searched before it counts as known"
    )
    search_period: int = number(
        30, 1, 10000, "frames after which a known cluster is searched again"
    )
    frames_remembered: int = number(
        15,
        0,
        10000,
        "frames for which a cluster that is not there is remembered: noise takes some in and out",
    )
    searches_in_frame: int = number(
        1,
        1,
        1000,
        "clusters that are searched for spheres at random in one frame, which bounds its time",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class SphereDetectionSettings:
    """How spheres are searched for in a cluster, fitted and tested."""

    scored_points: int = number(512, 8, 1000000, "points that hypotheses are scored on")
    fitted_points: int = number(1000, 8, 1000000, "points that a sphere is fitted to")
    refined_hypotheses: int = number(
        8,
        1,
        1000,
        "random hypotheses that are fitted at most: those that several touching spheres make "
        "together have the best scores",
    )
    spheres_in_cluster: int = number(5, 1, 1000, "spheres in one cluster at most")
    inlier_sigmas: float = number(
        3.0, 0.1, 100.0, "standard deviations from the surface within which a reading is on it"
    )
    stray_sigmas: float = number(
        5.0,
        0.0,
        100.0,
        "standard deviations of a ray's direction beyond a sphere's outline within which no other "
        "one is looked for: noise must not make a second sphere of what strays farthest",
    )
    roughly_on: float = number(
        0.6,
        0.0,
        1.0,
        "part of the readings in its outline that must lie on a hypothesis for it to be fitted",
    )
    roughly_seen: float = number(
        0.5,
        0.0,
        1.0,
        "part of the smallest visible fraction that a cluster must have for a sphere to be fitted",
    )
    min_density: float = number(
        0.9,
        0.0,
        1.0,
        "part of the disc between readings on a partly visible sphere that must have readings: two "
        "scan lines of a LiDAR make at most 0.7, a sphere cut off by the image's edge makes 1",
    )
    systematic_error: float = number(
        0.0001,
        0.0,
        1.0,
        "standard deviation of what biases centre and radius in every frame",
        unit="m",
    )
    noise_readings: float = number(
        10.0,
        0.0,
        1e6,
        "independent readings that the noise assumed counts as, against those on a sphere itself, "
        "when it is judged how much noise these have",
    )
    unevenness: float = number(
        0.01,
        0.0,
        1.0,
        "standard deviation of a ball's surface from a sphere, in radii: half a millimetre of a "
        "5 cm ball, 3 mm of an exercise ball, which its weight deforms",
    )
    edge_growth: float = number(
        0.7,
        0.0,
        10.0,
        "standard deviation of the part of a pixel, the same all round and in every frame, by "
        "which outlines seem larger or smaller than they are: a matching window lets the nearer "
        "side of an edge grow by up to one pixel (root mean square 0.7 where every second camera "
        "does), mixed readings at edges take about as much away",
    )
    window_radii: float = number(
        1.8, 1.0, 100.0, "distance from its centre that is inspected around a sphere, in radii"
    )
    window_readings: int = number(
        32768, 100, 100000000, "readings around a sphere that are inspected: bounds the time"
    )
    new_readings: float = number(
        0.5,
        0.0,
        1.0,
        "part of a sphere's readings that must be nearer than what was read there when the "
        "environment was modelled, or lie where nothing was, for it to be new in the scene",
    )
    new_goes_on: float = number(
        0.7,
        0.0,
        1.0,
        "part of the ring round its outline in which the cluster of a new sphere may go on: each "
        "ball of its size that it touches covers 0.15, a hand more",
    )
    touching_goes_on: float = number(
        0.2,
        0.0,
        1.0,
        "the same of a sphere that was found inside the outline of a cluster, where the other "
        "spheres of the cluster do not count: one more ball of its size covers 3 of 16 sectors, "
        "the finger that it may be the tip of 4 or 5",
    )
    static_goes_on: float = number(
        0.13,
        0.0,
        1.0,
        "the same of a sphere that was there when the environment was modelled: 2 of 16 sectors, "
        "as where it touches one other thing",
    )
    static_level: float = number(
        0.25,
        0.0,
        1.0,
        "part of the ring in which any surface may go on round such a sphere: the plane that a "
        "ball lies on does so in a fifth of it",
    )
    static_ends: float = number(
        0.3,
        0.0,
        1.0,
        "part of the ring in which something must be read clearly behind such a sphere",
    )
    static_visible: float = number(
        0.9,
        0.0,
        1.0,
        "part of the outline in which the surface of such a sphere must be seen; set on the real "
        "scenes for tuning of `make bench-perception`",
    )
    shape_misfit: float = number(
        1.65,
        0.0,
        100.0,
        "mean squared error of the patches of a sphere's surface at most, in variances: three "
        "standard deviations, 3 sqrt(2 / 44), above one for 48 patches and four fitted numbers",
    )
    static_successes: float = number(
        0.8,
        0.0,
        1.0,
        "part of the searches so far in which what was there when the environment was modelled "
        "must have been found to be a sphere; a ball is one in nearly all of them",
    )
    known_radius_sigmas: float = number(
        3.0, 0.1, 100.0, "standard deviations by which a radius may differ from a known one"
    )
    known_radius_margin: float = number(
        9.0,
        0.0,
        1000.0,
        "squared distance, in variances, by which another known radius must be farther off",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class SolidDetectionSettings:
    """How boxes and capsules are fitted to a cluster and tested."""

    fitted_points: int = number(500, 20, 1000000, "points that a box or capsule is fitted to")
    spheres_leave: float = number(
        0.1,
        0.0,
        1.0,
        "part of a cluster that spheres may leave unexplained: noise, a shadow's edge, a finger",
    )

    capsule_sigmas: float = number(
        3.0, 0.1, 100.0, "standard deviations from a capsule within which a reading is on it"
    )
    capsule_inliers: float = number(
        0.93, 0.0, 1.0, "part of the readings that must lie on a capsule"
    )
    capsule_length: float = number(
        0.4, 0.0, 100.0, "length of a capsule's cylinder at least, in radii"
    )
    cap_readings: int = number(5, 1, 10000, "readings on each cap of a capsule at least")
    capsule_end_uncertainty: float = number(
        0.1,
        0.0,
        1.0,
        "standard deviation of a capsule's end at most, in half its overall length: an end that is "
        "hidden could be anywhere",
    )
    capsule_arc: float = number(
        100.0,
        0.0,
        180.0,
        "arc of the cylinder that readings must cover, so that they determine its radius",
        unit="degrees",
    )

    box_inliers: float = number(
        0.88, 0.0, 1.0, "part of the readings that must lie on the faces of a box"
    )
    face_hypotheses: int = number(150, 1, 100000, "random planes that are tried for a face")
    face_scored_points: int = number(200, 3, 1000000, "points that these are scored on")
    face_sigmas: float = number(
        2.5, 0.1, 100.0, "standard deviations from a face within which a reading is on it"
    )
    surface_deviation: float = number(
        0.001,
        0.0,
        0.1,
        "unevenness of a surface, as a standard deviation; it biases the centre in every frame",
        unit="m",
    )
    face_angle: float = number(
        82.0, 0.0, 90.0, "angle between the normals of two faces at least", unit="degrees"
    )
    face_readings: int = number(25, 3, 100000, "readings on a face at least")
    face_part: float = number(0.08, 0.0, 1.0, "part of the readings on a face at least")
    face_refinements: int = number(3, 1, 100, "rounds of assigning readings to faces and fitting")
    face_cells: int = number(6, 1, 100, "cells along each side of a face, counted to see it filled")
    face_filled: float = number(
        0.75, 0.0, 1.0, "part of these cells that must have readings, and of readings in them"
    )
    standing_gap: float = number(
        0.04, 0.0, 1.0, "gap to a plane up to which a box stands on it", unit="m"
    )
    standing_angle: float = number(
        6.0, 0.0, 90.0, "angle between a box's axis and the plane's normal at most", unit="degrees"
    )

    def __post_init__(self) -> None:
        check_settings(self)
