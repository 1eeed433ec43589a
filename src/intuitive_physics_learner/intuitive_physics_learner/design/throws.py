"""Throws that could be made next: which objects, from what initial states, and how observed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.simulation.rigid_bodies.overlaps import overlapping
from intuitive_physics.state import ERROR_SIZE, ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import finite_array
from intuitive_physics_learner.cost.packed_observations import times_after_start
from intuitive_physics_learner.cost.parameter_influence import influence_on_worlds
from intuitive_physics_learner.cost.point_noise import SMALLEST_NOISE, position_noise
from intuitive_physics_learner.errors import NoObservationsError

ATTEMPTS = 50
"""Draws of all candidates at most until enough of them are valid."""

COVARIANCE = (ERROR_SIZE, ERROR_SIZE)
"""Shape of the covariance of an initial state."""

RANGES = ("position", "linear_velocity", "angular_velocity")
"""Fields of what may be thrown that are ranges of its initial state."""

IDENTITY = (0.0, 0.0, 0.0, 1.0)
"""Orientation (x, y, z, w) of an object whose axes are those of the environment."""


@dataclass(frozen=True, eq=False)
class ThrownObject:
    """One object of a throw, and between what initial states it may begin.

    Parameters
    ----------
    object : with material and shape
    position : (3, 2) m, lowest and highest on each axis of the environment's frame
    linear_velocity : (3, 2) m/s, likewise
    angular_velocity : (3, 2) rad/s, likewise; 0 by default
    covariance : (12, 12) of its initial state as it will be observed, in the order of
        `ObjectState`; 0 by default
    orientations : (n, 4) unit quaternions (x, y, z, w), from one of which it may begin
    """

    object: SceneObject
    position: NDArray[np.float64]
    linear_velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 2)))
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros(COVARIANCE))
    orientations: NDArray[np.float64] = field(default_factory=lambda: np.array([IDENTITY]))

    def __post_init__(self) -> None:
        set_field = super().__setattr__
        for name in RANGES:
            words = f"range of the {name.replace('_', ' ')}"
            ends = finite_array(getattr(self, name), words, (3, 2))
            if (ends[:, 0] > ends[:, 1]).any():
                raise InvalidInputError(
                    f"{words} is {ends.tolist()}; expected lowest ≤ highest on each axis"
                )
            set_field(name, ends)
        set_field("covariance", finite_array(self.covariance, "state covariance", COVARIANCE))
        set_field("orientations", finite_array(self.orientations, "orientations", (None, 4)))

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lowest position (m), linear (m/s) and angular velocity (rad/s), (9,)."""
        return np.concatenate([getattr(self, name)[:, 0] for name in RANGES])

    @property
    def widths(self) -> NDArray[np.float64]:
        """Widths of the ranges in the order of `lower`, (9,)."""
        return np.concatenate([np.diff(getattr(self, name))[:, 0] for name in RANGES])

    def state(self, place: NDArray[np.float64], orientation: NDArray[np.float64]) -> ObjectState:
        """Return the initial state at a place of the ranges.

        `place` (9,) from 0 to 1, in the order of `lower`; `orientation` (4,) unit
        quaternion (x, y, z, w).
        """
        values = self.lower + place * self.widths
        return ObjectState(values[0:3], orientation, values[3:6], values[6:9], self.covariance)


@dataclass(frozen=True, eq=False)
class ViewingConditions:
    """How a throw will be observed.

    Parameters
    ----------
    times : (n_times,) s after the start, of the detections
    noise : m, standard deviation of a detected position on each axis
    region : (3, 2) m, lowest and highest position on each axis that is in view; a track ends where
        its object leaves it
    """

    times: NDArray[np.float64]
    noise: float
    region: NDArray[np.float64]

    @staticmethod
    def of_observations(
        observations: Sequence[Observation], margin: float = 0.0
    ) -> ViewingConditions:
        """Return what observations, at least one, have in common."""
        tracks = [(each, track) for each in observations for track in each.objects]
        periods = np.concatenate([np.diff(track.trajectory.times) for _, track in tracks])
        ends = [float(times_after_start(each, track)[-1]) for each, track in tracks]
        period, duration = float(np.median(periods)), float(np.median(ends))
        positions = np.concatenate([track.trajectory.positions for _, track in tracks])
        low, high = positions.min(axis=0), positions.max(axis=0)
        around = margin * float((high - low).max())
        intervals = max(1, round(duration / period))
        return ViewingConditions(
            np.linspace(0.0, intervals * period, intervals + 1),
            _detection_noise(observations),
            np.stack([low - around, high + around], axis=1),
        )

    def with_starts(self, options: ThrowOptions) -> ViewingConditions:
        """Return the same with all in view from where objects may be thrown."""
        starts = [thrown.position for cast in options.casts for thrown in cast]
        low, high = np.moveaxis(np.array([self.region, *starts]), 2, 0)
        return replace(self, region=np.stack([low.min(axis=0), high.max(axis=0)], axis=1))

    def observation(self, scene: Scene) -> Observation:
        """Return an observation of a throw with its detections still to be simulated, all zero."""
        unseen = np.zeros((self.times.size, 3))
        return Observation(
            scene.environment,
            tuple(
                ObservedObject(item, Trajectory(self.times, unseen), state)
                for item, state in zip(scene.objects, scene.states, strict=True)
            ),
            0.0,
            "suggested",
        )


@dataclass(frozen=True, eq=False)
class ThrowOptions:
    """The objects that can be thrown into an environment, and how.

    Parameters
    ----------
    environment : Ω_e
    casts : at least one; each holds the objects of one throw, which begin at the same time
    """

    environment: Environment
    casts: tuple[tuple[ThrownObject, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "casts", tuple(map(tuple, self.casts)))
        if not self.casts or not all(self.casts):
            raise InvalidInputError("nothing can be thrown; expected at least one object")

    @property
    def materials(self) -> tuple[str, ...]:
        """Materials of the objects, then of the environment, each once."""
        materials = [thrown.object.material for cast in self.casts for thrown in cast]
        return tuple(dict.fromkeys((*materials, *self.environment.materials)))

    @staticmethod
    def of_observations(
        observations: Sequence[Observation], only: str | None = None
    ) -> ThrowOptions:
        """Return what was thrown so far: the same objects from between the same initial states.

        Objects of one material and kind of shape count as the same one. What was seen together is
        thrown together. The environment, and the shape of each object, are the newest. `only` is an
        id or material that an object of each throw must have.
        """
        if not observations:
            raise NoObservationsError("there are no observations; expected at least one throw")
        newest: dict[tuple[tuple[str, str], ...], Observation] = {}
        tracks: dict[tuple[str, str], list[ObservedObject]] = {}
        for each in observations:
            newest[tuple(sorted(map(_kind, each.objects)))] = each
            for track in each.objects:
                tracks.setdefault(_kind(track), []).append(track)
        thrown = {kind: _observed_throw(same) for kind, same in tracks.items()}
        casts = []
        for each in newest.values():
            words = {
                word for track in each.objects for word in (track.object.id, track.object.material)
            }
            if only is None or only in words:
                casts.append(
                    tuple(
                        replace(thrown[_kind(track)], object=track.object) for track in each.objects
                    )
                )
        if not casts:
            materials = sorted(
                {track.object.material for same in tracks.values() for track in same}
            )
            raise InvalidInputError(
                f"no object {only!r} was seen; expected an id, or a material: "
                f"{', '.join(materials)}"
            )
        return ThrowOptions(observations[-1].environment, tuple(casts))

    def between(
        self,
        position: NDArray[np.float64] | None,
        linear_velocity: NDArray[np.float64] | None,
        angular_velocity: NDArray[np.float64] | None,
    ) -> ThrowOptions:
        """Return the same with other ranges; None leaves those of each object as they are.

        `position` (3, 2) m; `linear_velocity` (3, 2) m/s; `angular_velocity` (3, 2) rad/s.
        """
        asked = zip(RANGES, (position, linear_velocity, angular_velocity), strict=True)
        given: dict[str, Any] = {name: ends for name, ends in asked if ends is not None}

        def moved(thrown: ThrownObject) -> ThrownObject:
            return replace(thrown, **given)

        return ThrowOptions(self.environment, tuple(tuple(map(moved, cast)) for cast in self.casts))

    def influential(self, materials: Sequence[str]) -> NDArray[np.bool_]:
        """Which parameters (n,) of these materials any throw can depend on, by their names."""
        worlds = [(self.environment, [thrown.object for thrown in cast]) for cast in self.casts]
        return np.asarray(influence_on_worlds(worlds, materials).any(axis=0))

    def draw(self, count: int, rng: np.random.Generator) -> list[Throw]:
        """Draw valid throws, spread over the ranges; the casts take turns.

        Latin hypercube sampling (McKay, Beckman and Conover 1979): of n candidates of a cast, one
        lies in each n-th part of every range.
        """
        accepted: list[Throw] = []
        for _ in range(ATTEMPTS):
            drawn = list(self._drawn(count, rng))
            wrong = overlapping([throw.scene for throw in drawn])
            accepted += [throw for throw, bad in zip(drawn, wrong, strict=True) if not bad]
            if len(accepted) >= count:
                return accepted[:count]
        raise InvalidInputError(
            f"{len(accepted)} of {ATTEMPTS * count} throws begin without an overlap; expected "
            "ranges in which objects are outside planes, boxes and one another"
        )

    def _drawn(self, count: int, rng: np.random.Generator) -> Iterator[Throw]:
        each = -(-count // len(self.casts))
        places = []
        for cast in self.casts:
            rows = np.tile(np.arange(each)[:, None], (1, 9 * len(cast)))
            strata = rng.permuted(rows, axis=0)
            places.append((strata + rng.random(strata.shape)) / each)
        for turn in range(count):
            k = turn % len(self.casts)
            cast, place = self.casts[k], places[k][turn // len(self.casts)].reshape(-1, 9)
            turns = [rng.integers(len(thrown.orientations)) for thrown in cast]
            states = [
                thrown.state(at, thrown.orientations[turned])
                for thrown, at, turned in zip(cast, place, turns, strict=True)
            ]
            yield Throw(self.environment, cast, tuple(states))


@dataclass(frozen=True, eq=False)
class Throw:
    """One throw that could be made.

    Parameters
    ----------
    environment : Ω_e
    cast : the objects that are thrown at the same time
    states : θ_d of each, with the covariance that it will be observed with
    """

    environment: Environment
    cast: tuple[ThrownObject, ...]
    states: tuple[ObjectState, ...]

    def nearby(self, count: int, spread: float, rng: np.random.Generator) -> list[Throw]:
        """Return valid throws whose initial states differ a little, `count` of them at most."""
        candidates = []
        for _ in range(count):
            states = []
            for thrown, state in zip(self.cast, self.states, strict=True):
                vector, widths = state.to_vector(), thrown.widths
                values = np.concatenate([vector[0:3], vector[7:13]]) - thrown.lower
                place = np.divide(values, widths, out=np.zeros(9), where=widths > 0.0)
                moved = place + spread * rng.standard_normal(9)
                inside = np.clip(np.abs((moved + 1.0) % 2.0 - 1.0), 0.0, 1.0)
                states.append(thrown.state(inside, state.orientation))
            candidates.append(Throw(self.environment, self.cast, tuple(states)))
        wrong = overlapping([throw.scene for throw in candidates])
        return [throw for throw, bad in zip(candidates, wrong, strict=True) if not bad]

    @property
    def scene(self) -> Scene:
        """The world to simulate."""
        return Scene(self.environment, tuple(thrown.object for thrown in self.cast), self.states)

    @property
    def widths(self) -> NDArray[np.float64]:
        """Widths of the ranges, (n_objects, 12) as errors of a state; zero for orientations."""
        widths = np.zeros((len(self.cast), ERROR_SIZE))
        for row, thrown in zip(widths, self.cast, strict=True):
            row[[0, 1, 2, 6, 7, 8, 9, 10, 11]] = thrown.widths
        return widths


def _detection_noise(observations: Sequence[Observation]) -> float:
    """Standard deviation in m of a detection on each axis, as detections state it, if there are."""
    variances = [
        np.trace(track.detections.covariances, axis1=1, axis2=2) / 3.0
        for each in observations
        for track in each.objects
        if track.detections is not None
    ]
    if not variances:
        return position_noise(observations)
    return max(float(np.sqrt(np.median(np.concatenate(variances)))), SMALLEST_NOISE)


def _kind(track: ObservedObject) -> tuple[str, str]:
    return track.object.material, type(track.object.shape).__name__


def _observed_throw(tracks: Sequence[ObservedObject]) -> ThrownObject:
    """Return the newest of some objects, to be thrown from between the initial states of all."""
    states = [track.initial_state for track in tracks]
    vectors = np.array([state.to_vector() for state in states])
    ends = np.stack([vectors.min(axis=0), vectors.max(axis=0)], axis=1)
    return ThrownObject(
        tracks[-1].object,
        ends[0:3],
        ends[7:10],
        ends[10:13],
        np.mean([state.covariance for state in states], axis=0),
        vectors[:, 3:7],
    )
