"""Settings of the paper's experiments; what is made by `number` or `other` is an option."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Any, ClassVar

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import check_settings, number, numbers, other

# What the setting `engine` means.
ENGINE_GUIDE = (
    "that moves the objects: auto, stepped, bullet or mujoco; another one than learns shows what "
    "model error costs"
)


class ExperimentSettings:
    """Settings that are checked; `quick` has those of a run of about two minutes."""

    quick: ClassVar[dict[str, Any]] = {}

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class DatasetSettings(ExperimentSettings):
    """Settings of the synthetic set of Sec. IV-B."""

    objects: int = number(1, 1, inf, "objects in the pool")
    samples: int = number(10, 1, inf, "trajectories of each object")
    engine: str = other("auto", ENGINE_GUIDE)
    seed: int = number(0, 0, inf, "of all randomness")


@dataclass(frozen=True)
class LearningCurveSettings(ExperimentSettings):
    """Settings of the training and test error over numbers of objects and samples."""

    objects: tuple[int, ...] = numbers((1, 5, 10), 1, inf, "sizes of the pool")
    samples: tuple[int, ...] = numbers((10, 50, 100), 1, inf, "trajectories of each object")
    repetitions: int = number(10, 1, inf, "sets of each kind")
    iterations: int = number(1000, 1, inf, "evaluations of J for each learning")
    method: str = other("cma_es", "update rule")
    engine: str = other("auto", ENGINE_GUIDE)
    # each is learned with; see `paper_dataset.INITIAL_STATES`
    initial_states: tuple[str, ...] = ("three_points", "flight")
    seed: int = number(0, 0, inf, "of all randomness")
    quick: ClassVar[dict[str, Any]] = {
        "objects": (1, 5),
        "samples": (10,),
        "repetitions": 2,
        "iterations": 300,
    }


def _compared_rules() -> tuple[str, ...]:
    # The learner is imported when an experiment begins, not for the command line's help.
    from intuitive_physics_learner.search.update_rules import UPDATE_RULES

    return (*UPDATE_RULES, "bounded_adaptive_random")


@dataclass(frozen=True)
class SearchMethodsSettings(ExperimentSettings):
    """Settings of the comparison of update rules."""

    objects: tuple[int, ...] = numbers((1, 10, 20), 1, inf, "sizes of the pool")
    samples: tuple[int, ...] = numbers((1, 10, 50), 1, inf, "trajectories of each object")
    runs: int = number(10, 1, inf, "searches by each rule on each set, averaged")
    iterations: tuple[int, ...] = numbers(
        (2000, 500, 500),
        1,
        inf,
        "evaluations of J in each search, one number for each of `objects` or one for all; with 14 "
        "parameters `hybrid_random` needs 790 to leave its sweeps",
    )
    # update rules, with the settings of Table I: the nine, and the adaptive one whose steps Table I
    # bounds
    methods: tuple[str, ...] = field(default_factory=_compared_rules)
    seed: int = number(0, 0, inf, "of all randomness")
    quick: ClassVar[dict[str, Any]] = {
        "objects": (1, 10),
        "samples": (1,),
        "runs": 2,
        "iterations": (200,),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.iterations) not in (1, len(self.objects)):
            raise InvalidInputError(
                f"{len(self.iterations)} numbers of iterations for {len(self.objects)} sizes of "
                "the pool; expected one for all, or one for each"
            )

    def iterations_of(self, objects: int) -> int:
        """Evaluations of J in a search on a set of that many objects."""
        if len(self.iterations) == 1:
            return self.iterations[0]
        return self.iterations[self.objects.index(objects)]


@dataclass(frozen=True)
class PredictionExperimentSettings(ExperimentSettings):
    """Settings of the noisy-Newton predictions of test runs.

    Trajectories of one run share the error of θ_s and of their contacts, so that a few runs do not
    show how often regions hold the truth: `further` ones are only predicted.
    """

    objects: int = number(5, 1, inf, "objects in the pool")
    samples: int = number(
        50, 1, inf, "trajectories of each object, 80 % of them to learn from, as in the paper"
    )
    further: int = 30
    iterations: int = number(2000, 1, inf, "evaluations of J for the learning")
    sample_count: int = 20  # noisy-Newton samples of each prediction
    seed: int = number(0, 0, inf, "of all randomness")
    quick: ClassVar = {"objects": 3, "samples": 10, "iterations": 1000}


@dataclass(frozen=True)
class RgbdSettings(ExperimentSettings):
    """Settings of the thrown balls that are rendered, perceived, learned and predicted."""

    throws: int = number(30, 1, inf, "throws of each ball")
    duration: float = 2.4  # s of each throw
    iterations: int = number(1000, 1, inf, "evaluations of J for each learning")
    seed: int = number(0, 0, inf, "of throws, noise and searches")
    quick: ClassVar = {"throws": 3, "iterations": 150}
