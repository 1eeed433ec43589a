"""What the parts learn from: the paper's synthetic sets (Sec. IV-B) and streams of throws."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any, Protocol, TypeVar

import numpy as np

from benchmarks.command import report_progress
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_experiments.paper.paper_dataset import (
    PaperDataset,
    make_paper_dataset,
    throw_objects,
)
from intuitive_physics_experiments.paper.paper_room import (
    ROOM_MATERIAL,
    dataset_simulator,
    draw_parameters,
    draw_pool,
)
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningOptions,
    LearningResult,
    TrajectoryCost,
    learn,
)
from intuitive_physics_learner.assessment.assessment import clean_part

THREADS = 2  # threads of the learner's simulator
TOLERANCE = 0.05  # part of the oracle's J by which a learner may stay above it


Item = TypeVar("Item")


@dataclass(frozen=True)
class Size:
    """A size of the paper's sets: objects in the pool, with 50 samples of each.

    The bars are of the excess of all sets and of one set; None where one set has no bar.
    """

    objects: int
    seconds: float  # wall time that learning may take, with its uncertainties
    median: float
    worst: float | None
    sets: int
    quick_sets: int


SIZES = {
    "1x50": Size(1, 4.0, 0.05, 0.15, 10, 2),
    "10x50": Size(10, 30.0, 0.10, None, 3, 0),
    "20x50": Size(20, 120.0, 0.15, None, 2, 0),
}
"""By name: objects by samples. Bars and times are those of issue 17."""


@dataclass(frozen=True, eq=False)
class Task:
    """A set to learn from, the learner's engine, the untouched defaults and the oracle's J.

    The oracle is the true θ_s: its J in m on the training split, on the test split, and on the
    test split from the true initial states.
    """

    dataset: PaperDataset
    simulator: Simulator
    start: StaticParameters
    oracle: tuple[float, float, float] = (np.nan, np.nan, np.nan)

    def training_cost(self) -> TrajectoryCost:
        """J over the training split."""
        return self._cost(self.dataset.training_observations)

    def test_cost(self) -> TrajectoryCost:
        """J over the test split."""
        return self._cost(self.dataset.test_observations)

    def exact_cost(self, seconds: float = np.inf) -> TrajectoryCost:
        """J over the test split from the true initial states, which depends on θ_s alone.

        Over the first seconds of each throw.
        """
        observations = self.dataset.with_initial_states("true").test_observations
        return self._cost([clean_part(each, each.start_time + seconds) for each in observations])

    def compared(self, cost: TrajectoryCost, *learned: StaticParameters) -> list[float]:
        """J in m of each learned θ_s, then of the defaults."""
        candidates = [each.extended(self.start.materials) for each in learned]
        return cost.costs([*candidates, self.start]).tolist()

    def _cost(self, observations: Sequence[Observation]) -> TrajectoryCost:
        return TrajectoryCost(observations, self.simulator, self.start.materials)


def make_task(objects: int, seed: int, simulator: Simulator | None = None) -> Task:
    """Make the set of that seed, with 50 samples of each object."""
    dataset = make_paper_dataset(objects, 50, np.random.default_rng(seed))
    simulator = simulator or make_simulator("auto", threads=THREADS)
    task = Task(dataset, simulator, StaticParameters.uniform(dataset.parameters.materials))
    training, test, exact = (
        float(cost.costs([dataset.parameters])[0])
        for cost in (task.training_cost(), task.test_cost(), task.exact_cost())
    )
    return replace(task, oracle=(training, test, exact))


def ball_throws(seed: int, restitutions: Iterator[float] | None = None) -> Iterator[Observation]:
    """Yield throws of one ball through the paper's room, without end.

    The first throws of a seed are the same however many are taken. The restitution of ball and
    room is drawn, or one of the given ones for each throw.
    """
    rng = np.random.default_rng(seed)
    pool = draw_pool(1, rng, [Sphere.kind])
    simulator = dataset_simulator("auto")
    true = draw_parameters(pool, rng)
    while True:
        if restitutions is not None:
            restitution = next(restitutions, None)
            if restitution is None:
                return
            true = true.with_pair(pool[0].material, ROOM_MATERIAL, restitution=restitution)
        yield throw_objects(pool, true, simulator, "three_points", rng).observation


def seeds_of_sizes(quick: bool, first_seed: int) -> Iterator[tuple[str, int]]:
    """Yield the name of the size and the seed of all sets of all sizes."""
    for name, size in SIZES.items():
        for number in range(size.quick_sets if quick else size.sets):
            yield name, first_seed + number


def seeded_tasks(quick: bool, first_seed: int) -> Iterator[tuple[str, int, Task]]:
    """Yield the same with the task of each."""
    for name, seed in seeds_of_sizes(quick, first_seed):
        report_progress(f"{name}, seed {seed}")
        yield name, seed, make_task(SIZES[name].objects, seed)


class OfSize(Protocol):
    """A result of a set of some size."""

    @property
    def size(self) -> str:
        """Name of the size, a key of `SIZES`."""


Result = TypeVar("Result", bound=OfSize)


def by_size(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Return results by the name of their size, of the sizes that there are."""
    groups = {name: [result for result in results if result.size == name] for name in SIZES}
    return {name: group for name, group in groups.items() if group}


def side_by_side(calls: Sequence[Callable[[], Item]]) -> list[Item]:
    """Return what the calls return, each in one of two new processes."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        futures = [pool.submit(call) for call in calls]
        return [future.result() for future in futures]


@dataclass(frozen=True, eq=False)
class Learned:
    """What learning returned, after which wall time in s.

    `fell_back`: whether joint estimation was given up for lowering J.
    """

    result: LearningResult
    seconds: float
    fell_back: bool

    @property
    def parameters(self) -> LearnedParameters:
        """θ_s with its uncertainty."""
        return self.result.learned


def learn_by_default(
    observations: Sequence[Observation],
    *,
    seconds: float | None = None,
    threads: int = THREADS,
    seed: int = 0,
) -> Learned:
    """Learn as users do: the public function, from the library's defaults, by the default method.

    The limit of wall time covers the uncertainties; None keeps the limits of the library.
    """
    criteria = ConvergenceCriteria()
    if seconds is not None:
        criteria = ConvergenceCriteria(max_iterations=None, time_limit=seconds)
    checkpoint: dict[str, Mapping[str, Any]] = {}
    began = time.perf_counter()
    result = learn(
        observations,
        make_simulator("auto", threads=threads),
        LearningOptions(criteria=criteria, seed=seed),
        on_checkpoint=checkpoint.update,
    )
    took = time.perf_counter() - began
    return Learned(result, took, checkpoint["search"].get("lowering") is not None)
