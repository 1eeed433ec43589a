"""The joint fit of θ_s and initial states, by steps of Levenberg and Marquardt's method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics.prior_knowledge.spin_evidence import SpinEvidence
from intuitive_physics.settings import check_settings, number, other
from intuitive_physics_learner.joint_estimation.damped_steps import DampedSteps
from intuitive_physics_learner.joint_estimation.fit_horizons import advanced_horizons
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation
from intuitive_physics_learner.joint_estimation.normal_equations import (
    Elimination,
    NormalEquations,
    agreement_weights,
    joint_posterior,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock
from intuitive_physics_learner.joint_estimation.scans import (
    SCAN_LEVELS,
    compatible_moves,
    scanned,
)
from intuitive_physics_learner.joint_estimation.trajectory_model import TrajectoryModel
from intuitive_physics_learner.search.gaussian import Gaussian, LocalLikelihood
from intuitive_physics_learner.search.learning_task import FitTask
from intuitive_physics_learner.search.plain_state import Resumable, restore, state_of

HELD_STEPS = 3
"""Steps of initial states alone by which two θ_s are compared; set by hand."""

LARGEST_VOTE = 3.0
"""Loss that a single observation counts at most when two θ_s are compared: a likelihood ratio of e³
≈ 20, hardly chance."""

FIRST_DAMPING = 1e-2
"""Damping of the first Levenberg-Marquardt step, a part of the diagonal; set by hand."""

SMALLEST_DAMPING = 1e-6
"""Damping at least; set by hand."""

LARGEST_DAMPING = 1e4
"""Damping at most; set by hand."""

DAMPING_FACTORS = (0.1, 1.0, 10.0, 100.0)
"""Factors on the last damping that are tried in one step; set by hand."""

STRAIGHT_STEPS = 9
"""Steps of a fit after which initial states take another step from where a damped one ended.
Before, θ_s may be far off, and initial states that suit it hide that. Of 0, 5 and 9 the last left
the least loss above that of the truth, on 60 objects; set by hand."""

SETTLED_MOVE = 0.02
"""Largest move of any parameter of a step that has converged, standard deviations of the parameter;
set by hand."""

SETTLED_STEPS = 2
"""Consecutive converged steps after which the fit has converged; set by hand."""

SMALLEST_RESPONSE = 1e-9
"""m per width of a parameter; a slope below this is rounding."""

HELD_PRECISION = 1e12
"""Per width², of a parameter that is held: it moves by rounding alone."""


@dataclass(frozen=True)
class JointEstimationSettings:
    """The schedule of a fit. All other numbers of the estimation are constants beside their use.

    A number that says "set by hand" has no derivation: it was set when the estimator was written,
    and the synthetic sets of `make bench-learning` are what it was run on with that value. Lengths
    in σ are in standard deviations of the noise of an observed position on one axis. Lengths in
    widths are parts of the unit interval that each parameter of θ_s is searched on.
    """

    largest_advance: float = number(
        0.2,
        0.0,
        1e4,
        "by which a fit horizon advances at most in one step; 0: horizons stay as they are given, "
        "and so does the spread of initial spins; set by hand",
        unit="s",
    )
    scan_steps: tuple[int, ...] = other(
        (2, 5, 9, 14), "numbers of steps after which the fit scans each parameter; set by hand"
    )

    def __post_init__(self) -> None:
        check_settings(self)


FIXED_HORIZONS = JointEstimationSettings(largest_advance=0.0, scan_steps=())
"""Those of a fit up to given horizons, that scans nothing."""


@dataclass(frozen=True, eq=False)
class ObservationFit:
    """Result of a fit for one observation, from which another fit can begin.

    Parameters
    ----------
    estimate : (d,) deviations from the observed initial states, in SI units
    deviations : (d,) standard deviation of each, in SI units
    horizon : s, the last time that is fitted
    """

    estimate: NDArray[np.float64]
    deviations: NDArray[np.float64]
    horizon: float


class JointFit(Resumable):
    """Fits all trajectories, each from an initial state of its own and up to its fit horizon.

    `blocks` the stated ones of a model of the same observations; None: they are made.

    Attributes
    ----------
    model : simulates near the estimate, and counts simulations
    estimate : θ_s, initial states and fit horizons
    weights : (n_observations,) with which each counts in what it says of θ_s, since the last step
    steps : taken so far
    misfits : share of the observations with a misfit in the last step
    responsive : (n,) bool, which parameters any of the fitted points depends on
    """

    remembered = ("_damping", "_settled", "misfits", "steps", "responsive", "weights")

    def __init__(
        self,
        task: FitTask,
        settings: JointEstimationSettings,
        blocks: list[ObservationBlock] | None = None,
    ) -> None:
        self.settings = settings
        self.prior = task.prior
        self.model = TrajectoryModel(task, settings.largest_advance, blocks)
        self.estimate = self.model.initial_estimate()
        self.weights = task.weights
        self.responsive = np.zeros(self.unit.size, dtype=bool)
        self._damping = FIRST_DAMPING
        self._settled = 0
        self.misfits = 0.0
        self.steps = 0

    @property
    def unit(self) -> NDArray[np.float64]:
        """The estimate of θ_s on the unit cube, (n,)."""
        return self.estimate.unit

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviation (n,) of each parameter, in widths, by the slopes of the last step."""
        return self.estimate.deviations

    @property
    def settled(self) -> bool:
        """Whether the fit has converged: more steps would change nothing."""
        return self._settled >= SETTLED_STEPS

    @property
    def _fixed(self) -> bool:
        """Whether fit horizons and the spread of initial spins stay as they are given."""
        return self.settings.largest_advance == 0.0

    @property
    def held_simulations(self) -> float:
        """Simulations of single observations that `return_if_better` takes, about."""
        each = self.model.simulations / max(self.steps, 1)
        return 3 * (HELD_STEPS + 1) * each

    def likelihoods(self) -> list[LocalLikelihood]:
        """Return the likelihood of θ_s near the estimate, of each observation."""
        return self.model.likelihoods(self.estimate, self.weights)

    def spin_evidence(self) -> SpinEvidence:
        """Return what all observations say of how balls are thrown, each by its weight."""
        evidence = SpinEvidence()
        for likelihood, weight in zip(self.likelihoods(), self.weights.tolist(), strict=True):
            evidence.add_all(likelihood.spins, weight)
        return evidence

    def observation_fits(self) -> list[ObservationFit]:
        """Return what was found for each observation."""
        fits = {
            int(member): ObservationFit(part.estimate[k], part.deviations[k], part.horizons[k])
            for block, part in zip(self.model.blocks, self.estimate.fits, strict=True)
            for k, member in enumerate(block.members)
        }
        return [fits[member] for member in range(len(fits))]

    @property
    def horizons(self) -> NDArray[np.float64]:
        """Last time (n_observations,) in s that is fitted of each observation."""
        return np.array([each.horizon for each in self.observation_fits()])

    def state_draws(self, generator: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw initial states from their posterior by the points up to the fit horizons.

        Returns (n_observations, count, objects, 13) in SI units, as `ObjectState.to_vector`; the
        first of each is the estimate.
        """
        model, estimate = self.model, self.estimate
        equations = model.equations(estimate, model.linearised(estimate))
        posterior, eliminated = model.posterior(estimate, equations, self.weights)
        objects = int(model.cost.trajectory_object.max()) + 1
        states = np.empty((len(model.cost.observations), count, objects, 13))
        for block, fits, equation, left in zip(
            model.blocks, estimate.fits, equations, eliminated, strict=True
        ):
            draws = fits.draws(generator, equation.state_covariances(left, posterior), count)
            states[block.members] = block.initial_states.states(draws.swapaxes(0, 1), objects)
        return states

    def begin_at(
        self,
        unit: NDArray[np.float64],
        deviations: NDArray[np.float64],
        fits: Sequence[ObservationFit | None],
    ) -> None:
        """Continue from what others found, of θ_s `unit` (n,) and `deviations` (n,), in widths."""
        self.estimate.unit = unit.copy()
        self.estimate.deviations = deviations.copy()
        for block, part in zip(self.model.blocks, self.estimate.fits, strict=True):
            for k, member in enumerate(block.members):
                fit = fits[member]
                if fit is not None:
                    part.estimate[k] = fit.estimate
                    part.deviations[k] = fit.deviations
                    part.horizons[k] = fit.horizon

    def return_if_better(self, unit: NDArray[np.float64]) -> bool:
        """Go back to `unit` (n,) where trajectories fit better from it, up to the present horizons.

        Both θ_s are held while initial states are fitted, from those found here and from those
        observed. The gain of a single observation counts up to `LARGEST_VOTE`, so that no single
        fit that took a wrong turn decides. Returns whether it was better.
        """
        here, fits = self._held(self.unit, self.observation_fits())
        nothing = [replace(fit, estimate=0.0 * fit.estimate) for fit in fits]
        there, states = self._held(unit, fits)
        others, other_states = self._held(unit, nothing)
        fresh = others < there
        there = np.where(fresh, others, there)
        votes = np.clip(here - there, -LARGEST_VOTE, LARGEST_VOTE)
        if votes.sum() <= 0.0:
            return False
        chosen = [b if new else a for a, b, new in zip(states, other_states, fresh, strict=True)]
        self.begin_at(unit, self.deviations, chosen)
        return True

    def rises_at(self, moves: Sequence[tuple[int, float]]) -> list[float]:
        """Return by how much the loss rises for each move, one parameter by index held at a place.

        Observations that depend on it are fitted to it, with all other parameters, by slopes there,
        up to the present horizons and with the present weights. What the others say of these
        parameters stays as it is by the slopes at the estimate.
        """
        likelihoods = self.likelihoods()
        return [self._rise_at(*move, likelihoods) for move in moves]

    def _rise_at(
        self, parameter: int, place: float, likelihoods: Sequence[LocalLikelihood]
    ) -> float:
        asked = self.model.task.influence[:, parameter]
        members, others = np.flatnonzero(asked), np.flatnonzero(~asked)
        known = self.prior.plus([likelihoods[k] for k in others.tolist()], self.weights[others])
        unit, fits = self.unit.copy(), self.observation_fits()
        unit[parameter] = place
        prior = known.held_at(parameter, place, HELD_PRECISION)
        task = replace(self.model.task.of(members), prior=prior)
        begun = [fits[k] for k in members.tolist()]
        fit = self._continued(task, unit, begun, self.model.spins)
        self.model.simulations += fit.model.simulations
        before, after = known.losses(np.array([self.unit, fit.unit])).tolist()
        losses = np.array([each.loss for each in fit.likelihoods()])
        losses -= [likelihoods[k].loss for k in members.tolist()]
        return float(self.weights[members] @ losses) + after - before

    def _held(
        self, unit: NDArray[np.float64], fits: Sequence[ObservationFit]
    ) -> tuple[NDArray[np.float64], list[ObservationFit]]:
        """Fit initial states with θ_s held; return the loss (n_observations,) of each, and them."""
        model, prior = self.model, Gaussian.about(unit, HELD_PRECISION * np.eye(unit.size))
        task = replace(model.task, prior=prior)
        fit = self._continued(task, unit, fits, blocks=model.stated_blocks)
        losses = np.array([likelihood.loss for likelihood in fit.likelihoods()])
        model.simulations += fit.model.simulations
        return losses, fit.observation_fits()

    def _continued(
        self,
        task: FitTask,
        unit: NDArray[np.float64],
        fits: Sequence[ObservationFit],
        spins: InitialSpins | None = None,
        blocks: list[ObservationBlock] | None = None,
    ) -> JointFit:
        """Return a fit by the task's prior that begins at `unit` (n,), up to fixed horizons."""
        fit = JointFit(task, FIXED_HORIZONS, blocks)
        fit.model.widen_spins(spins or InitialSpins())
        fit.begin_at(unit, np.minimum(task.prior.deviations, self.deviations), fits)
        for _ in range(HELD_STEPS):
            fit.step()
        return fit

    def step(self) -> None:
        """Take a damped Gauss-Newton step in all unknowns, then move the fit horizons.

        The parts are those of `docs/method/joint_estimation.md`, in the order of a step.
        """
        linear = self.model.linearised(self.estimate)
        if self.steps in self.settings.scan_steps and self._leave_local_optima(linear):
            linear = self.model.linearised(self.estimate)
        self.steps += 1
        equations = self.model.equations(self.estimate, linear)
        eliminated = [each.eliminated() for each in equations]
        agreement = agreement_weights(self.prior, self.unit, eliminated, self.weights)
        self.weights = self.model.task.weights * agreement
        self._note_responses(linear)
        goals, evidence = self._predict_beyond_horizons(linear, equations, eliminated)
        self._take_best_damped_step(linear, equations, goals)
        if not self._fixed:
            self.model.widen_spins(evidence.initial_spins())

    def state(self) -> dict[str, Any]:
        return {
            **super().state(),
            **state_of(self.estimate, ("unit", "deviations")),
            **state_of(self.model, ("simulations",)),
            "spins": self.model.spins.to_dict(),
            "fits": [part.state() for part in self.estimate.fits],
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        super().load_state(state)
        restore(self.estimate, ("unit", "deviations"), state)
        restore(self.model, ("simulations",), state)
        self.model.widen_spins(InitialSpins.from_dict(state["spins"]))
        for part, saved in zip(self.estimate.fits, state["fits"], strict=True):
            part.load_state(saved)

    def _note_responses(self, linear: Sequence[Linearisation]) -> None:
        for block, slopes in zip(self.model.blocks, linear, strict=True):
            d = block.prior_deviations.shape[1]
            moving = (np.abs(slopes.slopes[:, d:]) > SMALLEST_RESPONSE).any(axis=(2, 3))
            self.responsive[block.parameters[moving]] = True

    def _predict_beyond_horizons(
        self,
        linear: Sequence[Linearisation],
        equations: Sequence[NormalEquations],
        eliminated: Sequence[Elimination],
    ) -> tuple[list[NDArray[np.float64]], SpinEvidence]:
        """Take over the posterior's deviations; return goals (W,) s, and spin evidence."""
        posterior = joint_posterior(self.prior, self.unit, eliminated, self.weights)
        self.estimate.deviations = posterior.deviations
        goals, evidence = [], SpinEvidence()
        for (block, part), slopes, equation, left in zip(
            self.model.parts(self.estimate), linear, equations, eliminated, strict=True
        ):
            covariances = equation.state_covariances(left, posterior)
            # Of the prior that this step has: the estimate suits that of the last one.
            means = left.state_means(part.estimate, self.unit, posterior)
            spins = self.model.spin_likelihoods(block, means, covariances)
            for likelihood, weight in zip(spins, self.weights[block.members], strict=True):
                evidence.add_all(likelihood, float(weight))
            part.deviations = np.sqrt(np.einsum("wdd->wd", covariances))
            spreads = equation.spreads(slopes, left, posterior)
            goals.append(
                advanced_horizons(
                    block, slopes, spreads, part.horizons, self.settings.largest_advance
                )
            )
        return goals, evidence

    def _take_best_damped_step(
        self,
        linear: Sequence[Linearisation],
        equations: Sequence[NormalEquations],
        goals: list[NDArray[np.float64]],
    ) -> None:
        """Take the best of several damped steps, each initial state its own, and move horizons."""
        late = self.steps > STRAIGHT_STEPS
        steps = DampedSteps(
            self.model, self.estimate, linear, equations, self.weights, restepped=late
        )
        dampings = np.clip(
            self._damping * np.array(DAMPING_FACTORS), SMALLEST_DAMPING, LARGEST_DAMPING
        )
        steps.try_steps(dampings)
        best = int(np.argmin(steps.losses))
        moved = np.abs(steps.units[best] - self.unit) / self.estimate.deviations
        self.estimate.unit = steps.units[best]
        # Where no step was better, the next ones are damped most.
        self._damping = float(dampings[best - 1])
        advanced = self._take_states(steps.best_states(best), goals)
        settled = moved.max() < SETTLED_MOVE and not advanced
        self._settled = self._settled + 1 if settled else 0

    def _take_states(
        self,
        best: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]],
        goals: list[NDArray[np.float64]],
    ) -> bool:
        """Take the best initial states; return whether any horizon got farther than before."""
        advanced, misfits, counted = False, 0, self.model.task.counted
        for (block, part), (states, left), goal in zip(
            self.model.parts(self.estimate), best, goals, strict=True
        ):
            part.estimate = states
            if self._fixed:
                part.note_misfits(block, left)
            else:
                advanced |= part.advance(block, left, goal)
            misfits += int((part.misfits & counted[block.members]).sum())
        self.misfits = misfits / max(int(counted.sum()), 1)
        return advanced

    def _leave_local_optima(self, linear: Sequence[Linearisation]) -> bool:
        """Move parameters to where on their range they fit better; return whether any moved."""
        rises, state_estimates = scanned(
            self.model, self.estimate, linear, SCAN_LEVELS, self.weights
        )
        levels = np.argmin(rises, axis=1)
        moves = compatible_moves(-rises.min(axis=1), self.model.task.influence)
        for (block, part), estimates in zip(
            self.model.parts(self.estimate), state_estimates, strict=True
        ):
            for parameter in moves:
                rows, columns = np.nonzero(block.parameters == parameter)
                part.estimate[rows] = estimates[columns, levels[parameter], rows]
        unit = self.estimate.unit.copy()
        unit[moves] = np.array(SCAN_LEVELS)[levels[moves]]
        self.estimate.unit = unit
        return bool(moves)
