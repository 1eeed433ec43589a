"""Learn θ_s by the energy score of noisy predictions, starting from what J found.

J (Eq. 8) compares one simulation from the estimated first state with what was seen. Errors of that
state spread things apart, and J is then smallest where motion is damped: a box that is supposed to
land flat, while it truly lands on an edge, gets too little friction. A proper score of a
distribution has no such bias: its expectation is best at the θ_s that made the data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import Simulator, WorldBatch, pack_worlds
from intuitive_physics_learner.active_parameters import ActiveSpace, active_parameters
from intuitive_physics_learner.cost import FAILED_DISTANCE, TrajectoryCost
from intuitive_physics_learner.identifiability import identify
from intuitive_physics_learner.search import ConvergenceCriteria, ParameterSearch, SearchProgress
from intuitive_physics_learner.update_rules import make_update_rule
from intuitive_physics_predictor.noise import StateNoise, sample_states
from intuitive_physics_predictor.scores import energy_scores

METHOD = "cma_es"
SAMPLES = 4
"""Simulations of each observation; the fair estimate of the score needs few."""

PERIOD = 0.25
"""s between the times that are scored."""


class EnergyScoreCost:
    """Mean energy score of noisy predictions of observations, by θ_s.

    Every θ_s is judged with the same noise, so that the search sees a function.

    Parameters
    ----------
    observations : Y, each seen for at least `PERIOD`
    materials : of the θ_s that will be judged
    position_noise : m, standard deviation of the positions that were seen
    rng : of the noise
    """

    def __init__(
        self,
        observations: Sequence[Observation],
        materials: Sequence[str],
        position_noise: float,
        simulator: Simulator,
        rng: np.random.Generator,
    ) -> None:
        self._simulator = simulator
        neutral = StaticParameters.uniform(materials)
        self._groups = [_group(seen, neutral, position_noise, rng) for seen in _alike(observations)]

    def costs(self, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """Mean score of each candidate, shape (n_candidates,), in m."""
        parts = [self._scores(group, candidates) for group in self._groups]
        return np.asarray(np.concatenate(parts, axis=1).mean(axis=1))

    def _scores(self, group: _Group, candidates: Sequence[StaticParameters]) -> NDArray[np.float64]:
        """Scores of all points, shape (n_candidates, n_points), in m."""
        scores = []
        for candidate in candidates:
            rollout = self._simulator.rollout_batch(
                group.worlds.crossed([candidate]), group.times, orientations=False
            )
            simulated = np.nan_to_num(rollout.positions, nan=FAILED_DISTANCE)
            samples = simulated.reshape(SAMPLES, *group.seen.shape) + group.noise
            scores.append(energy_scores(samples, group.seen).ravel())
        return np.array(scores)


@dataclass(frozen=True, eq=False)
class _Group:
    """W observations of O objects at T times.

    Parameters
    ----------
    worlds : `SAMPLES` times W, world `s * W + w` sample s of observation w
    times : (T,) s
    seen : (W, O, T, 3) m
    noise : (SAMPLES, W, O, T, 3) m, that of seeing
    """

    worlds: WorldBatch
    times: NDArray[np.float64]
    seen: NDArray[np.float64]
    noise: NDArray[np.float64]


def learn_by_energy_score(
    observations: Sequence[Observation],
    learned: LearnedParameters,
    position_noise: float,
    simulator: Simulator,
    *,
    iterations: int,
    seed: int,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> LearnedParameters:
    """Search θ_s of the best energy score, by CMA-ES from `learned` on.

    Parameters
    ----------
    observations : that `learned` was learned from
    position_noise : m, standard deviation of the positions that were seen
    iterations : θ_s that are tried

    Returns
    -------
    LearnedParameters
        `learned` itself where nothing better was found; its cost is J as ever.
    """
    materials = learned.materials
    active = active_parameters(observations, materials)
    space = ParameterSpace(materials)
    searched = ActiveSpace(space, active, learned.parameters)
    rng = np.random.default_rng([seed, 2])
    score = EnergyScoreCost(observations, materials, position_noise, simulator, rng)
    rule = make_update_rule(
        METHOD,
        searched.size,
        np.random.default_rng([seed, 3]),
        searched.to_unit(learned.parameters),
    )
    criteria = ConvergenceCriteria(max_iterations=iterations)
    found = ParameterSearch(score.costs, searched, rule).run(criteria, on_progress=on_progress)
    if found.cost >= score.costs([learned.parameters])[0]:
        return learned
    cost = TrajectoryCost(observations, simulator, materials)
    told = identify(cost, space, found.parameters, active)
    return LearnedParameters(
        found.parameters,
        told.standard_deviations,
        told.identified,
        learned.version + 1,
        float(cost.costs([found.parameters])[0]),
        len(observations),
        METHOD,
    )


def _alike(observations: Sequence[Observation]) -> list[list[Observation]]:
    groups: dict[int, list[Observation]] = {}
    for seen in observations:
        groups.setdefault(len(seen.objects), []).append(seen)
    return [groups[count] for count in sorted(groups)]


def _group(
    observations: Sequence[Observation],
    neutral: StaticParameters,
    position_noise: float,
    rng: np.random.Generator,
) -> _Group:
    end = min(
        thing.trajectory.times[-1] - seen.start_time
        for seen in observations
        for thing in seen.objects
    )
    times = np.arange(PERIOD, end + 1e-9, PERIOD)
    seen = np.array(
        [
            [_positions_at(thing, observation.start_time + times) for thing in observation.objects]
            for observation in observations
        ]
    )
    scenes = [observation.scene() for observation in observations]
    states = np.stack(
        [sample_states(scene.states, StateNoise(), SAMPLES, rng) for scene in scenes], axis=1
    )
    worlds = pack_worlds(scenes, neutral).taken(
        np.tile(np.arange(len(scenes)), SAMPLES), states=states.reshape(-1, *states.shape[2:])
    )
    noise = position_noise * rng.standard_normal((SAMPLES, *seen.shape))
    return _Group(worlds, times, seen, noise)


def _positions_at(thing: ObservedObject, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Seen positions between neighbours in time (Eq. 5), (n, 3) m."""
    track = thing.trajectory
    return np.column_stack([np.interp(times, track.times, x) for x in track.positions.T])
