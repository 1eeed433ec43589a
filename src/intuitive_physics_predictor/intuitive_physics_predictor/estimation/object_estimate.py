"""States of spheres, estimated from all detections since each began to move as simulated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Detections, SeenSpin
from intuitive_physics.prior_knowledge.initial_spins import unknown_spin
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator, pack_worlds
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics.state import ANGULAR_VELOCITY, LINEAR_VELOCITY, ObjectState
from intuitive_physics_predictor.estimation.modes import (
    FIRST_STEP,
    Modes,
    derivative_steps,
    find_modes,
    misfit,
)
from intuitive_physics_predictor.estimation.pair_knowledge import PairKnowledge
from intuitive_physics_predictor.estimation.trajectory_fit import TrajectoryFit
from intuitive_physics_predictor.estimation.unknowns import SPIN, Unknowns
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates, draw_weighted
from intuitive_physics_predictor.noise import LEARNED, with_spin_prior
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

SAMPLES = 200
"""Samples of a posterior: many times those of a prediction."""

EXPLORED = 64
"""Spins, drawn from their prior, among which other explanations are searched."""

MOST_STARTS = 2
"""Number of other explanations that are followed, the best ones."""

EXPLORATIONS = 8
"""Number of detections, after the spin has begun to matter, with which other explanations are
searched; later they are searched only where the newest detections fit badly."""

MATTERS = 0.5
"""Smallest difference in misfit between spins at which the spin matters."""

DOUBTFUL_MISFIT = 15.0
"""χ² of the newest detections above which other explanations are searched."""

LONGEST = 1.0
"""s after which a fit begins again from its own posterior: this bounds its computing time and
forgets small errors of the model."""

NEWEST = 4
"""Number of newest detections whose misfit shows whether the motion is still the simulated one."""

LARGEST_MISFIT = 40.0
"""χ² of their 12 coordinates above which it is not: noise exceeds it 7 times in 100,000."""

RESTING_SPEED = 0.05
"""m/s. A slower object moves too little for more than its perceived state."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Environment, parameters and simulator of an object's motion.

    Parameters
    ----------
    environment : Ω_e
    uncertain : θ_s
    simulator : the model of the motion
    spin_prior : of spins that are a guess, one of `SPIN_PRIORS`
    """

    environment: Environment
    uncertain: UncertainParameters
    simulator: Simulator
    spin_prior: str = LEARNED


class ObjectEstimate:
    """Follows one sphere, detection by detection.

    A fit begins with a perceived state and takes every detection after it, through bounces, slides
    and rolls, and every spin that its surface shows. Where the newest detections do not fit any
    more (a hand, another object), it begins again with what is perceived then; after `LONGEST`,
    with the moments of its own posterior.

    Parameters
    ----------
    rng : of the samples
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._fit: TrajectoryFit | None = None
        self._modes: Modes | None = None
        self._bias = np.zeros((3, 3))
        self._seen_before = -np.inf
        self._time = -np.inf
        self._explorations = 0
        self.states: WeightedStates | None = None

    def update(
        self,
        surroundings: Surroundings,
        sphere: SceneObject,
        state: ObjectState,
        time: float,
        detections: Detections | None,
        guess_scale: float = 1.0,
    ) -> None:
        """Take the detections of a frame; `states` are then those at its time.

        Parameters
        ----------
        surroundings : that the object moves in
        sphere : the object
        state : as perceived at `time`
        time : s; when it is not later than before, the estimate is forgotten
        detections : new ones, at most up to `time`; None: there are none
        guess_scale : factor on the standard deviations of a spin that is a guess
        """
        if time <= self._time or detections is None or _rests(state):
            self._forget()
        self._time = time
        if detections is None or _rests(state):
            return
        self._bias = detections.bias
        fit = self._fit
        if fit is None:
            self._begin(surroundings, sphere, state, detections, time, guess_scale)
            return
        new = detections.times > fit.last
        if new.any():
            self._take(fit, detections, new)
        if self._modes is None:
            return
        if _newest_misfit(self._modes) > LARGEST_MISFIT:
            self._begin(surroundings, sphere, state, detections, time, guess_scale)
            return
        self.states = draw_weighted(fit, self._modes, SAMPLES, time, self._rng)
        if time - fit.begin > LONGEST and len(self._modes.misfits) == 1:
            self._go_on(surroundings, sphere, self.states, time)

    def renew(self, surroundings: Surroundings, sphere: SceneObject) -> None:
        """Continue in other surroundings, or with other parameters."""
        if self.states is not None:
            self._go_on(surroundings, sphere, self.states, self._time)
        else:
            self._forget()

    def _begin(
        self,
        surroundings: Surroundings,
        sphere: SceneObject,
        state: ObjectState,
        detections: Detections,
        time: float,
        guess_scale: float,
    ) -> None:
        world, parameters = _world_of(surroundings, sphere)
        learned = surroundings.uncertain.learned
        unseen = state if detections.spin is None else _without(detections.spin, state)
        thrown = with_spin_prior(unseen, sphere, learned, surroundings.spin_prior, guess_scale)
        # A ball that was hit in its motion spins differently from a thrown one.
        first = unseen if self._fit is not None and _is_less_certain(unseen, thrown) else thrown
        unknowns = Unknowns.of_state(first, self._bias, parameters)
        guess = unknown_spin(sphere.shape, first) or 0.0
        self._start(replace(unknowns, guessed_spin=guess), world, time, surroundings)
        self._seen_before = -np.inf
        self.states = None

    def _go_on(
        self, surroundings: Surroundings, sphere: SceneObject, states: WeightedStates, time: float
    ) -> None:
        world, parameters = _world_of(surroundings, sphere)
        unknowns = Unknowns.of_moments(*states.moments, parameters)
        guess = states.unknowns.guessed_spin
        self._start(replace(unknowns, guessed_spin=guess), world, time, surroundings)
        # The moments include what the surface showed until now.
        self._seen_before = time

    def _start(
        self, unknowns: Unknowns, world: WorldBatch, time: float, surroundings: Surroundings
    ) -> None:
        self._fit = TrajectoryFit(unknowns, world, time, surroundings.simulator)
        self._modes = None
        self._explorations = 0

    def _take(self, fit: TrajectoryFit, detections: Detections, new: NDArray[np.bool_]) -> None:
        for time, position, covariance in zip(
            detections.times[new],
            detections.positions[new],
            detections.covariances[new],
            strict=True,
        ):
            fit.add(float(time), position, covariance)
        if detections.spin is not None and detections.spin.since > self._seen_before:
            fit.see_spin(detections.spin, fit.last)
        self._modes = find_modes(fit, *self._starts(fit))

    def _starts(self, fit: TrajectoryFit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Starts (m, n) of the search for modes, and the differences for derivatives (m, n, n)."""
        size = fit.unknowns.size
        if self._modes is None:
            centres, steps = np.zeros((1, size)), FIRST_STEP * np.eye(size)[None]
        else:
            centres, steps = self._modes.centres, derivative_steps(self._modes.information)
        others = self._other_spins(fit, centres[0])
        steps = np.concatenate([steps, np.repeat(steps[:1], len(others), axis=0)])
        return np.concatenate([centres, others]), steps

    def _other_spins(self, fit: TrajectoryFit, centre: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the best (m, n) of many spins, all else as in an explanation (n,)."""
        doubtful = self._modes is not None and _newest_misfit(self._modes) > DOUBTFUL_MISFIT
        if self._explorations >= EXPLORATIONS and not doubtful:
            return np.empty((0, len(centre)))
        spins = fit.unknowns.root[SPIN]
        along = np.linalg.pinv(spins) @ spins
        drawn = self._rng.standard_normal((EXPLORED, len(centre)))
        others = centre + (drawn - centre) @ along
        misfits = misfit(others, fit.residuals(others))
        prior = 0.5 * (others**2).sum(axis=1)
        if np.ptp(misfits - prior) < MATTERS:
            return np.empty((0, len(centre)))
        self._explorations += 1
        return np.asarray(others[np.argsort(misfits)[:MOST_STARTS]])

    def _forget(self) -> None:
        self._fit = self._modes = self.states = None


class SceneEstimate:
    """Follows the spheres of a scene, from frame to frame.

    The orientation of boxes and capsules is perceived, and so is how they turn.

    Parameters
    ----------
    rng : of all samples
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._surroundings: Surroundings | None = None
        self._followed: dict[str, ObjectEstimate] = {}

    def updates(
        self,
        surroundings: Surroundings,
        objects: Sequence[SceneObject],
        states: Sequence[ObjectState],
        time: float,
        detections: Sequence[Detections | None],
        guess_scale: float = 1.0,
    ) -> Iterator[WeightedStates | None]:
        """Take a frame, and yield the states of one object after the other at its time.

        None is yielded for an object whose perceived state is all there is. An object whose
        states nobody takes is not updated.

        Parameters
        ----------
        surroundings : that the objects move in
        objects : all that are tracked
        states : of each, as perceived
        time : s, of the states
        detections : new ones of each; None where there are none
        guess_scale : factor on the standard deviations of spins that are a guess
        """
        ids = {item.id for item in objects}
        self._followed = {name: kept for name, kept in self._followed.items() if name in ids}
        is_new = surroundings is not self._surroundings
        self._surroundings = surroundings
        for item, state, detected in zip(objects, states, detections, strict=True):
            if not isinstance(item.shape, Sphere):
                yield None
                continue
            estimate = self._followed.setdefault(item.id, ObjectEstimate(self._rng))
            if is_new:
                estimate.renew(surroundings, item)
            estimate.update(surroundings, item, state, time, detected, guess_scale)
            yield estimate.states


def _newest_misfit(modes: Modes) -> float:
    """χ² of the newest detections in the best explanation."""
    newest = modes.residuals[0, -3 * NEWEST :]
    return float(newest @ newest)


def _without(spin: SeenSpin, state: ObjectState) -> ObjectState:
    """Return a state whose spin is the guess again, without the spin that the surface showed.

    The density of the perceived spin is the product of both, so the information is their sum.
    """
    spins = state.covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY]
    left = np.trace(np.linalg.inv(spins) - np.linalg.inv(spin.covariance))
    if left <= 0.0:
        return state
    covariance = state.covariance.copy()
    covariance[ANGULAR_VELOCITY] = covariance[:, ANGULAR_VELOCITY] = 0.0
    covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = 3.0 / left * np.eye(3)
    return ObjectState(
        state.position, state.orientation, state.linear_velocity, np.zeros(3), covariance
    )


def _is_less_certain(state: ObjectState, other: ObjectState) -> bool:
    """Whether the spin of a state is less certain than that of another."""
    spins = [each.covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] for each in (state, other)]
    return bool(np.trace(spins[0]) > np.trace(spins[1]))


def _rests(state: ObjectState) -> bool:
    """Whether an object is at rest within the uncertainty of its perceived velocity."""
    return bool(np.linalg.norm(state.linear_velocity) < RESTING_SPEED) and bool(
        np.trace(state.covariance[LINEAR_VELOCITY, LINEAR_VELOCITY]) < RESTING_SPEED**2
    )


def _world_of(surroundings: Surroundings, sphere: SceneObject) -> tuple[WorldBatch, PairKnowledge]:
    """Return the world of one object, and what is known of the parameters it depends on."""
    scene = Scene(surroundings.environment, (sphere,), (ObjectState(np.zeros(3)),))
    parameters: StaticParameters = surroundings.uncertain.learned.parameters
    world = pack_worlds([scene], parameters)
    return world, PairKnowledge.of(surroundings.uncertain, world)
