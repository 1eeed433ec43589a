"""Tuned numbers of tracking, each with its unit and meaning.

Where a field does not say where its value comes from, it was set by hand when its stage was
written: there is no derivation, and the rendered rooms of the tests and of `make bench-perception`
are what it was run on with that value.
"""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number

FRAME_TIME = 1.0 / 30.0
"""s between the frames that are meant where a setting counts detections or is given for one frame:
at another frame rate it holds for as much time."""


def lasting(detections: float) -> float:
    """Return how long in s an object was seen at 30 Hz with that many detections, at least.

    Half a frame less, as stamps are not quite regular.

    Parameters
    ----------
    detections : one after another
    """
    return (detections - 1.5) * FRAME_TIME


@dataclass(frozen=True)
class MotionSettings:
    """How an object is expected to move from frame to frame."""

    max_bounces: int = number(4, 1, 100, "bounces within one step at most")
    support_distance: float = number(
        0.006, 0.0, 1.0, "gap up to which a plane supports an object", unit="m"
    )
    support_speed: float = number(
        0.25,
        0.0,
        10.0,
        "normal speed up to which an object stays on a plane: what is left of such a bounce is a "
        "hop of millimetres",
        unit="m/s",
    )
    normal_uncertainty: float = number(
        0.35,
        0.0,
        10.0,
        "standard deviation of the normal velocity after a bounce, as a part of the normal speed "
        "before it: what another restitution could make of it",
    )
    tangential_uncertainty: float = number(
        0.3,
        0.0,
        10.0,
        "the same of the tangential velocity: what friction could make of it",
    )
    rolling_inertia: float = number(
        0.4,
        0.0,
        1.0,
        "κ, moment of inertia over m r² of a ball that rolls, which gains g sin α / (1 + κ) on a "
        "slope: 2/5 of a uniform one, 2/3 of a thin shell",
    )
    angular_acceleration_noise: float = number(
        20.0,
        0.0,
        10000.0,
        "standard deviation of what changes an angular velocity, over 1/30 s: torques of contacts, "
        "precession",
        unit="rad/s²",
    )
    rolling_time: float = number(
        0.2,
        0.0,
        10.0,
        "time on a surface without losing speed to friction after which a ball rolls: one that "
        "slides at μ = 0.1 is 5 mm behind by then, and rolls itself 2 v / 7 μ g after it began",
        unit="s",
    )
    rolling_memory: float = number(
        0.6,
        0.0,
        10.0,
        "time for which that is looked back at most, where noise hides what friction takes in a "
        "shorter one",
        unit="s",
    )
    rolling_deceleration: float = number(
        0.6,
        0.0,
        100.0,
        "difference from the acceleration of rolling: more than rolling resistance and another "
        "κ make, less than sliding friction makes; half of it must be visible",
        unit="m/s²",
    )
    rolling_sigmas: float = number(
        2.0, 0.0, 100.0, "standard deviations of that difference by which noise may exceed it"
    )
    rolling_slip: float = number(
        0.1, 0.0, 1.0, "standard deviation of the slip of a rolling ball, as a part of its speed"
    )
    lift_sigmas: float = number(
        3.0, 0.0, 100.0, "standard deviations by which noise may lift a ball that rolls on a plane"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class TrackingSettings:
    """Which detection belongs to which track, and when a track begins, rests and ends."""

    gate: float = number(
        25.0,
        1.0,
        1000.0,
        "squared distance, in variances, from which on a detection contradicts what was predicted",
    )
    resting_speed_deviation: float = number(
        0.02, 0.0, 10.0, "standard deviation of the velocity of an object at rest", unit="m/s"
    )
    resting_angular_velocity_deviation: float = number(
        0.2,
        0.0,
        100.0,
        "standard deviation of the angular velocity of a box or capsule at rest",
        unit="rad/s",
    )
    height_deviation: float = number(
        0.01,
        0.0,
        1.0,
        "standard deviation of the height of a solid's centre above its lowest point",
        unit="m",
    )
    naming_angle: float = number(
        0.2, 0.001, 10.0, "angle that counts as much as `naming_length`", unit="rad"
    )
    naming_length: float = number(
        0.02,
        0.0001,
        10.0,
        "difference of edges that counts as much as `naming_angle` where two ways to name a box's "
        "edges are compared",
        unit="m",
    )
    hindsight: float = number(
        0.2,
        0.0,
        10.0,
        "time for which frames are kept, to look in them for a ball before it was first seen: a "
        "hand that lets it go is 50 to 80 ms away before the ball ends all round its outline",
        unit="s",
    )
    hindsight_frames: int = number(
        2, 1, 100, "frames looked back into in each new one, which bounds its time"
    )
    hindsight_gate: float = number(
        0.5,
        0.0,
        10.0,
        "how far from a straight line through the next two a ball may have been then, in radii: a "
        "hand that gains 30 m/s² moves it by 16 mm in 1/30 s",
    )
    color_time: float = number(
        0.116,
        0.001,
        1000.0,
        "time in which a colour fades from a track's mean, as light changes: at 30 Hz the newest "
        "frame has a weight of 0.25",
        unit="s",
    )
    color_deviation: float = number(
        0.1,
        0.001,
        1.0,
        "standard deviation of an object's mean colour (0 to 1) from frame to frame, as light and "
        "shade change",
    )
    max_color_cost: float = number(
        25.0,
        0.0,
        1000.0,
        "largest cost of another colour, in variances of position: a shadow costs no more than to "
        "be five standard deviations off",
    )
    radius_gate: float = number(
        4.0, 0.0, 100.0, "standard deviations by which a radius may differ within one track"
    )
    radius_slack: float = number(0.003, 0.0, 1.0, "what a radius may differ beyond that", unit="m")
    tentative_time: float = number(
        0.08,
        0.0,
        10.0,
        "a track that is not confirmed and unseen for longer is closed: at 30 Hz one frame may "
        "miss it",
        unit="s",
    )
    flight_gap: float = number(
        0.01,
        0.0,
        1.0,
        "gap to every surface from which on an object is in free flight",
        unit="m",
    )
    leaving_gate: float = number(
        25.0,
        1.0,
        1000.0,
        "squared velocity, in variances of a fit over half of `rest_time`, from which on it is no "
        "noise; what is faster than `rest_speed` besides leaves its rest",
    )
    resting_part: float = number(
        0.8,
        0.0,
        1.0,
        "part of `rest_speed` below which an object may come to rest: what has just left its rest "
        "does not come to it for noise",
    )
    recognition_patience: int = number(
        4,
        1,
        1000,
        "multiple of `confirming_hits` after which a track is confirmed though its radius does not "
        "yet distinguish known objects",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class InitialStateSettings:
    """How the initial state θ_d of an observed object is estimated.

    It is fitted to a stretch of points without a contact.
    """

    min_points: int = number(3, 3, 1000, "points of a stretch at least")
    max_duration: float = number(0.4, 0.01, 100.0, "duration of a stretch at most", unit="s")
    contact_gate: float = number(
        16.0,
        1.0,
        1000.0,
        "squared distance, in variances, from which on the next point shows a contact",
    )
    misfit_sigmas: float = number(
        5.0,
        0.0,
        100.0,
        "standard deviations by which χ² of a stretch may exceed its mean",
    )
    sure_evidence: float = number(
        7.0,
        -100.0,
        100.0,
        "logarithm of how much likelier points must be in free motion than in a hand: 1,000 times. "
        "A swing falls like a free ball for moments, and 30 to 90 beginnings are tried a second",
    )
    touching_evidence: float = number(
        -1.0,
        -100.0,
        100.0,
        "the same where a plane ends the flight or carries the object, as a hop may last for three "
        "frames at 30 Hz; an object that is held still above a plane is at -5 then",
    )
    hand_acceleration: float = number(
        10.0,
        0.1,
        1000.0,
        "standard deviation of the acceleration that a hand gives: from rest to 2 m/s in 0.2 s",
        unit="m/s²",
    )
    hand_time: float = number(0.1, 0.001, 10.0, "correlation time of that acceleration", unit="s")
    hand_memory: float = number(
        0.4,
        0.0,
        100.0,
        "time before a stretch, as it was found first, in which its beginning is looked for",
        unit="s",
    )
    holding_time: float = number(
        2.0, 0.01, 1000.0, "time for which a hand is seen to hold an object", unit="s"
    )
    release_chance: float = number(
        0.8,
        0.5,
        1.0,
        "probability with which the object is free where a stretch begins: a point too few costs "
        "little, a point of the hand spoils the velocity",
    )
    noise_window: float = number(
        0.15,
        0.0,
        10.0,
        "time in which a path is a cubic but for noise, by which the noise is measured: five "
        "frames at 30 Hz",
        unit="s",
    )
    touch_sigmas: float = number(
        3.0,
        0.0,
        100.0,
        "standard deviations of its position within which an object touches a plane",
    )
    touch_slack: float = number(0.005, 0.0, 1.0, "gap beyond that up to which it touches", unit="m")
    path_widening: float = number(
        1.5,
        1.0,
        100.0,
        "multiple of the largest standard deviation where an object was seen, up to which its "
        "smoothed path is part of an observation where it was not",
    )

    def __post_init__(self) -> None:
        check_settings(self)
