"""Whether learned posteriors are right: ranks of the true θ_s among their draws.

Talts, Betancourt, Simpson, Vehtari and Gelman (2018), *Validating Bayesian inference algorithms
with simulation-based calibration*: if θ_s is drawn from the prior and observations from θ_s, the
true value of each parameter has any rank among L independent draws of its posterior with the
probability 1 / (L + 1), whatever the observations say. Ranks near both ends come of a posterior
that is too narrow, ranks in the middle of one that is too wide, ranks to one side of a bias.

The prior is that of learned posteriors: uniform on the unit cube of `ParameterSpace` with its
default bounds. One sphere of a random size is thrown through the paper's room five times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chisquare

from benchmarks.command import Outcome, report_progress
from benchmarks.learning.paper_sets import learn_by_default, side_by_side
from benchmarks.results.result import Column, Table
from intuitive_physics.materials import PAIR_COEFFICIENTS
from intuitive_physics.observation import Observation
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.shapes import Sphere
from intuitive_physics.truncated_gaussian import TAKEN
from intuitive_physics_experiments.paper.paper_dataset import throw_objects
from intuitive_physics_experiments.paper.paper_room import (
    ROOM_MATERIAL,
    dataset_simulator,
    draw_pool,
    pool_materials,
)

WORLDS, QUICK_WORLDS = 200, 2
THROWS = 5  # of the sphere in each world
DRAWS = 99  # of each posterior, so that there are 100 ranks
BINS = 10  # of ranks; 100 is a multiple of it
LEAST_EXPECTED = 5.0  # ranks in each bin from which on χ² has its distribution (Cochran 1954)
LARGEST_RISK = 0.01  # of a complaint about right posteriors, over all parameters together


@dataclass(frozen=True, eq=False)
class World:
    """True θ_s (|θ_s|,) on the unit cube of the space, and what was seen of the sphere."""

    space: ParameterSpace
    truth: NDArray[np.float64]
    observations: list[Observation]

    @property
    def places(self) -> list[int]:
        """Indices of the parameters that the motion depends on, as `PAIR_COEFFICIENTS`."""
        ball = self.space.materials[0]
        return [self.space.names.index(f"{k}[{ball}, {ROOM_MATERIAL}]") for k in PAIR_COEFFICIENTS]


def draw_world(rng: np.random.Generator) -> World:
    """Draw a sphere, its θ_s from the prior, and its throws."""
    pool = draw_pool(1, rng, [Sphere.kind])
    space = ParameterSpace(pool_materials(pool))
    truth = rng.random(space.size)
    true, simulator = space.to_parameters(truth), dataset_simulator("auto")
    throws = [throw_objects(pool, true, simulator, "three_points", rng) for _ in range(THROWS)]
    return World(space, truth, [run.observation for run in throws])


def ranks_of(seed: int) -> list[int]:
    """Learn from the world of a seed; return the ranks of `PAIR_COEFFICIENTS`, each up to `DRAWS`.

    The limits of learning are those of the library, which do not depend on the machine's pace.
    """
    rng = np.random.default_rng(seed)
    world = draw_world(rng)
    learned = learn_by_default(world.observations, threads=1).parameters
    # The first draws of these are of a chain each, so they are independent.
    draws = learned.whole_posterior().draw(TAKEN * DRAWS, rng)[:DRAWS]
    return (draws < world.truth).sum(axis=0)[world.places].tolist()


@dataclass(frozen=True, eq=False)
class Ranks:
    """Ranks (n,) from 0 to `DRAWS` of the true values of a parameter."""

    name: str
    ranks: NDArray[np.int64]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Ranks in each of `BINS` bins."""
        return np.bincount(self.ranks * BINS // (DRAWS + 1), minlength=BINS)

    @property
    def test(self) -> tuple[float, float] | None:
        """χ² of the counts with `BINS` - 1 degrees of freedom, and its p; None of too few ranks."""
        if self.ranks.size < LEAST_EXPECTED * BINS:
            return None
        found = chisquare(self.counts)
        return float(found.statistic), float(found.pvalue)

    @property
    def middle(self) -> float:
        """Share of the ranks in the middle half."""
        return float(np.mean(np.abs(2 * self.ranks - DRAWS) * 2 < DRAWS + 1))


def complaints(parameters: Sequence[Ranks]) -> list[str]:
    """Name the parameters whose ranks are not those of a right posterior."""
    risk = LARGEST_RISK / len(parameters)
    return [
        f"rank_chi2: {each.name} has {each.test[0]:.1f}, p {each.test[1]:.1g}, below {risk:g}"
        for each in parameters
        if each.test is not None and each.test[1] < risk
    ]


def measure(quick: bool, first_seed: int) -> Outcome:
    """Learn from all worlds, two at a time."""
    worlds = QUICK_WORLDS if quick else WORLDS
    report_progress(f"ranks of the true θ_s in {worlds} worlds")
    ranks = side_by_side([partial(ranks_of, first_seed + k) for k in range(worlds)])
    by_parameter = zip(PAIR_COEFFICIENTS, np.array(ranks).T, strict=True)
    parameters = [Ranks(name, each) for name, each in by_parameter]
    table = Table.of(
        f"Ranks of the true θ_s among {DRAWS} draws of the learned posterior, in {worlds} worlds",
        parameters,
        [
            (Column("parameter of ball and room"), lambda p: p.name),
            (Column(f"ranks in each of {BINS} bins"), lambda p: " ".join(map(str, p.counts))),
            (Column("mean rank", "", ".1f"), lambda p: float(p.ranks.mean())),
            (Column("share in the middle half", "", ".2f"), lambda p: p.middle),
            (Column("χ²", "", ".1f"), lambda p: p.test and p.test[0]),
            (Column("p", "", ".2g"), lambda p: p.test and p.test[1]),
        ],
        note=(
            f"Each world: θ_s from the prior, one sphere, {THROWS} throws. Right posteriors have "
            f"equal counts, a mean rank of {DRAWS / 2:g} and 0.50 in the middle half; too narrow "
            "ones less, too wide ones more. Density does not act on a lone sphere."
        ),
    )
    figures = {each.name: each.test and round(each.test[0], 1) for each in parameters}
    return Outcome([table], {"rank_chi2": {"density": None, **figures}}, "", complaints(parameters))
