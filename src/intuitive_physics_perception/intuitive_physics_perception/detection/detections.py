"""Objects as one frame shows them: spheres, boxes and capsules, each with its covariance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.shapes import Box, Capsule

NEW_READINGS = 0.5
"""Part of a sphere's readings that must lie where nothing was before for it to be new in the scene,
of those that lie where it is known whether something was."""

TELLING = 0.25
"""Part of a sphere's readings that must lie where that is known. Set by hand."""

STAYED = 0.9
"""Part of those that must lie where something was for it to have been there. Set by hand: of what
stays, noise makes no reading new (`CHANGE_SIGMAS`), an edge a few in a hundred; of a small ball
that has come near something far away, a tenth to a half are."""

NEW_GOES_ON = 0.7
"""Part of the ring round its outline in which the cluster of a new sphere may go on: each ball of
its size that it touches covers 0.15, a hand more."""

STATIC_GOES_ON = 0.13
"""`NEW_GOES_ON` of a sphere that was there when the environment was modelled: 2 of 16 sectors, as
where it touches one other thing."""

STATIC_LEVEL = 0.25
"""Part of the ring in which any surface may go on round such a sphere: the plane that a ball lies
on does so in a fifth of it, seen from near."""

CARRIED_LEVEL = 0.6
"""The same round a sphere that lies on a plane: that goes on below it, in half of the ring as far
as noise shows where it lies; round a bulge in a plane it does in all."""

STATIC_ENDS = 0.3
"""Part of the ring in which something must be read clearly behind such a sphere."""

STATIC_VISIBLE = 0.9
"""Part of the outline in which the surface of such a sphere must be seen; set on the real scenes
for tuning of `make bench-perception`."""

NEW_VISIBLE = 0.7
"""The same of a new one: of a ball with a radius of four pixels 0.75 to 0.9 is seen."""


@dataclass(frozen=True, eq=False)
class Bulge:
    """How a smooth surface deviates from a sphere of radius r with the same outline.

    Besides a shift and a tilt, which an outline does not know, it lies by
    (a s² + b s² cos 2φ + c s² sin 2φ) r outside the sphere, s radii across the line of sight: for a
    flat one a is ½.

    Parameters
    ----------
    coefficients : (3,) a, b, c
    information : (3, 3), inverse of their covariance
    """

    coefficients: NDArray[np.float64]
    information: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outline:
    """How a sphere stands apart from what is about it.

    Parameters
    ----------
    new, known, unknown : parts of its readings that lie where nothing was before, where something
        was, and where nobody has looked, the rest of them on planes; None where nothing is known
        of the space
    goes_on : part of the ring round its outline in which its cluster goes on
    level : part of the ring in which any surface goes on
    level_off_planes : the same for what is on no plane of the environment
    level_come : the same for what is not known to have stood there before
    ends : part of the ring in which what is read lies behind all that could go on
    visible : part of the outline's disc in which its surface is read
    bulge : how that surface deviates from the sphere
    is_carried : whether it lies on a plane that carries it
    """

    new: float | None
    known: float | None
    unknown: float | None
    goes_on: float
    level: float
    level_off_planes: float
    level_come: float
    ends: float
    visible: float
    bulge: Bulge
    is_carried: bool = False

    @property
    def is_new(self) -> bool:
        """Whether most of it, where that is known, lies where nothing was before."""
        if self.new is None or self.known is None:
            return False
        telling = self.new + self.known
        return telling >= TELLING and self.new > NEW_READINGS * telling

    @property
    def has_not_come(self) -> bool:
        """Whether it is, as far as that is known, nothing that has come."""
        return self.unknown is not None and self.unknown <= 0.5 and not self.is_new

    @property
    def was_there(self) -> bool:
        """Whether something was before where it lies, as far as that is known."""
        if self.new is None or self.known is None:
            return False
        return self.has_not_come and self.known > STAYED * (self.new + self.known)

    def may_be_object(self, most_goes_on: float, *, is_object: bool) -> bool:
        """Return whether a sphere may be an object of its own and not a part of something larger.

        What has come where nothing was is most likely an object, and may touch others; so may what
        is one by other frames, and comes where nobody has looked. What was there already, or is
        first seen where nobody has looked, is most likely not, so it must end all round its outline
        and be seen as a whole.

        `most_goes_on`: part of the ring in which the cluster of what may touch others may go on;
        `is_object`: whether other frames have shown that it is one.
        """
        if self.new is None or self.is_new or (is_object and not self.was_there):
            return self.goes_on <= most_goes_on
        return self.stands_apart

    @property
    def stands_apart(self) -> bool:
        """Whether a sphere ends all round its outline and is seen as a whole.

        A bulge of a plane ends nowhere, but a plane was there before what is new. So was any other
        surface that carries it, which goes on round it no more than below a ball. Beside what stood
        there before something must be read behind it; before the sky nothing is. The plane on which
        a ball lies goes on round it where it is seen from above.
        """
        if self.goes_on > STATIC_GOES_ON:
            return False
        if self.is_new:
            return (
                self.level_come <= STATIC_LEVEL
                and self.level_off_planes <= CARRIED_LEVEL
                and self.visible >= NEW_VISIBLE
            )
        return (
            self.level_off_planes <= STATIC_LEVEL
            and self.level <= (CARRIED_LEVEL if self.is_carried else STATIC_LEVEL)
            and not (self.was_there and self.ends < STATIC_ENDS)
            and self.visible >= STATIC_VISIBLE
        )


@dataclass(frozen=True, eq=False)
class DetectedSphere:
    """A sphere in one frame.

    Parameters
    ----------
    center : (3,) m
    radius : m
    covariance : (4, 4) of centre and radius, m²
    points : readings on its surface
    range : m from the sensor to the centre
    color : (3,) mean red, green and blue, 0 to 1; None where unknown
    systematic : (4, 4) m², the part of the covariance that all frames share
    sweep : (3,) m, way of the centre during the exposure, in the middle of which it is at `center`;
        either end may be the first
    outline : how it stands apart; None where that was not looked at
    delay : s from the time of the frame to that of these readings
    """

    center: NDArray[np.float64]
    radius: float
    covariance: NDArray[np.float64]
    points: int
    range: float
    color: NDArray[np.float64] | None = None
    systematic: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4, 4)))
    sweep: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    outline: Outline | None = None
    delay: float = 0.0

    @property
    def numbers(self) -> NDArray[np.float64]:
        """Centre and radius in one array (4,) m."""
        return np.append(self.center, self.radius)

    def distances(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return how far points (n, 3) m are from the nearest place of the centre, (n,) m."""
        away = points - self.center
        length2 = max(float(self.sweep @ self.sweep), 1e-12)
        when = np.clip(away @ self.sweep / length2, -0.5, 0.5)
        return np.asarray(np.linalg.norm(away - when[:, None] * self.sweep, axis=1))

    def moved(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> DetectedSphere:
        """Return it in another frame, p_other = rotation p + translation.

        `rotation` (3, 3); `translation` (3,) m.
        """
        turn = np.eye(4)
        turn[:3, :3] = rotation
        return replace(
            self,
            center=rotation @ self.center + translation,
            sweep=rotation @ self.sweep,
            covariance=turn @ self.covariance @ turn.T,
            systematic=turn @ self.systematic @ turn.T,
        )


def without_doubles(spheres: list[DetectedSphere]) -> list[DetectedSphere]:
    """Keep, of spheres that share space, the one with more points."""
    kept: list[DetectedSphere] = []
    for sphere in sorted(spheres, key=lambda sphere: -sphere.points):
        if all(
            np.linalg.norm(sphere.center - other.center) > max(sphere.radius, other.radius)
            for other in kept
        ):
            kept.append(sphere)
    return kept


@dataclass(frozen=True, eq=False)
class DetectedSolid:
    """A box or capsule in one frame.

    Parameters
    ----------
    shape : what it is, with its dimensions
    center : (3,) m
    rotation : (3, 3), body to the frame of `center`
    position_covariance : (3, 3) m²
    rotation_covariance : (3, 3) rad², of a rotation vector in the frame of `center`
    size_variance : m², of each dimension
    points : readings on its surface
    misfit : mean squared distance from the surface, in variances of the noise
    color : (3,) mean red, green and blue, 0 to 1; None where unknown
    systematic_error : m, standard deviation of the error that all frames share, in each
        component of the centre; part of its covariance
    delay : s from the time of the frame to that of these readings
    """

    shape: Box | Capsule
    center: NDArray[np.float64]
    rotation: NDArray[np.float64]
    position_covariance: NDArray[np.float64]
    rotation_covariance: NDArray[np.float64]
    size_variance: float
    points: int
    misfit: float
    color: NDArray[np.float64] | None = None
    systematic_error: float = 0.0
    delay: float = 0.0

    @property
    def radius(self) -> float:
        """m, of the largest sphere about the centre inside it: it touches nothing before that."""
        if isinstance(self.shape, Capsule):
            return self.shape.radius
        return 0.5 * min(self.shape.edge_lengths)

    @property
    def systematic(self) -> NDArray[np.float64]:
        """(4, 4) m², the part of `covariance` that all frames share."""
        return self.systematic_error**2 * np.diag([1.0, 1.0, 1.0, 0.0])

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(4, 4) m² of centre and radius."""
        covariance = np.zeros((4, 4))
        covariance[:3, :3] = self.position_covariance
        covariance[3, 3] = self.size_variance
        return covariance

    def moved(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> DetectedSolid:
        """Return it in another frame, p_other = rotation p + translation.

        `rotation` (3, 3); `translation` (3,) m.
        """
        return replace(
            self,
            center=rotation @ self.center + translation,
            rotation=rotation @ self.rotation,
            position_covariance=rotation @ self.position_covariance @ rotation.T,
            rotation_covariance=rotation @ self.rotation_covariance @ rotation.T,
        )

    def doubted(self, factor: float, points: int, systematic_error: float) -> DetectedSolid:
        """Return it with all variances `factor` times as large, its number of points, and what errs
        alike in all frames, m, which is added to the covariance of its centre."""
        return replace(
            self,
            position_covariance=factor * self.position_covariance + systematic_error**2 * np.eye(3),
            rotation_covariance=factor * self.rotation_covariance,
            size_variance=factor * self.size_variance,
            points=points,
            systematic_error=systematic_error,
        )


Detection = DetectedSphere | DetectedSolid


def frame_covariance(detection: Detection) -> NDArray[np.float64]:
    """Return the part (4, 4) m² of a detection's covariance that its frame alone has."""
    return detection.covariance - detection.systematic


def given_radius(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    systematic: NDArray[np.float64],
    placed: NDArray[np.intp],
    radius: float,
    deviation: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return an estimate and both parts of its covariance, given a sphere's radius.

    Bayes' rule for a measurement of the radius alone, which moves the centre, too. Joseph's form,
    K P Kᵀ + g R gᵀ, keeps both parts of the covariance apart.

    `mean` (n,) and `covariance` (n, n), of each frame alone; `systematic` (4, 4) m² of centre and
    radius, which all frames share; `placed` (4,) places of these in the estimate; `radius` and its
    standard `deviation` in m. Returns the estimate (n,), and covariances (n, n) of each frame alone
    and (4, 4) of all.
    """
    total = covariance.copy()
    total[np.ix_(placed, placed)] += systematic
    k = placed[3]
    gain = total[:, k] / (total[k, k] + deviation**2)
    keep = np.eye(len(mean))
    keep[:, k] -= gain
    keep_placed = keep[np.ix_(placed, placed)]
    return (
        mean + gain * (radius - mean[k]),
        keep @ covariance @ keep.T + deviation**2 * np.outer(gain, gain),
        keep_placed @ systematic @ keep_placed.T,
    )


def kind_of(detection: Detection) -> str:
    """Return the name of a detection's shape."""
    return "sphere" if isinstance(detection, DetectedSphere) else detection.shape.kind
