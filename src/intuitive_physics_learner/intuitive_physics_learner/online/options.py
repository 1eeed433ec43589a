"""How to learn in the background: what users set, and what was tuned."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from intuitive_physics.settings import check_settings, choice, number, other
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings
from intuitive_physics_learner.methods import JOINT_METHOD


@dataclass(frozen=True)
class RecursionSettings:
    """Numbers of recursive learning that have no place among the parameters of a node.

    Lengths in widths are parts of the unit interval that each parameter of θ_s is searched on.
    """

    batch: int = number(
        8,
        1,
        1000,
        "observations that wait are learned from together, at most so many: then the joint steps "
        "are shared; set by hand",
    )
    lone_steps: int = number(
        24,
        1,
        1000,
        "joint steps in which one observation is fitted by itself at most; set by hand: with "
        "`largest_advance` they suffice for 10 s of motion",
    )
    retry_steps: int = number(
        60,
        1,
        1000,
        "joint steps of a second, more careful fit of an observation that cannot be explained; set "
        "by hand",
    )
    free_scans: tuple[int, ...] = other(
        (2, 5),
        "numbers of steps after which a lone fit that knows nothing of θ_s scans each parameter; "
        "set by hand",
    )
    scoring_steps: int = number(
        3, 1, 1000, "joint steps up to a common horizon before evidences are compared; set by hand"
    )
    window_steps: int = number(
        8, 1, 1000, "joint steps of all observations of the window after new ones; set by hand"
    )
    restart_steps: int = number(
        60,
        0,
        1000,
        "joint steps of a fit of the window from its beginning, which is tried now and then; set "
        "by hand",
    )
    restart_scans: tuple[int, ...] = other(
        (2, 5, 9, 14), "numbers of steps after which such a fit scans each parameter; set by hand"
    )
    most_spared: float = number(
        32.0,
        0.0,
        1e6,
        "observations whose CPU time is saved up at most, for fits of the window from its "
        "beginning: a fit of 24 throws takes some 10 s, where a usual observation takes 0.3 s",
    )
    largest_advance: float = number(
        0.5,
        0.0,
        1e4,
        "by which a fit horizon advances at most in one step: more than in a fit that begins with "
        "nothing, for what is known predicts farther; set by hand",
        unit="s",
    )
    scan_period: int = number(
        8,
        1,
        10_000,
        "observations from one scan of all parameters to the next once the window is full; set by "
        "hand",
    )
    misfit_steps: int = number(
        4,
        1,
        1000,
        "last steps of a lone fit in which a misfit means that the motion cannot be explained "
        "farther: an advance beyond what can be explained ends in a misfit every other step or "
        "third",
    )
    conflict: float = number(
        7.0,
        0.0,
        1e6,
        "logarithm of the ratio of evidences, of what is not bound by what is known to what is, "
        "from which on an observation contradicts what is known: odds of a thousand to one",
    )
    smallest_explained: float = number(
        0.6,
        0.0,
        1.0,
        "share of the last observations that can be explained from which on one that cannot be is "
        "doubtful; where motion is too chaotic for that, most such observations are good ones; of "
        "clean throws of tumbling bodies 0.6 to 0.7 can be, of balls 0.9",
    )
    largest_score: float = number(
        3.0,
        0.0,
        1e6,
        "by which one observation changes the prequential score at most: a likelihood ratio of "
        "e³ ≈ 20, so that no single one decides",
    )
    surprising_move: float = number(
        4.0,
        0.0,
        1e6,
        "move of a parameter in standard deviations of what is published, beyond which it needs "
        "the evidence of a later observation: a chance of 6e-5",
    )
    smallest_move: float = number(
        0.1,
        0.0,
        1e6,
        "move of a parameter in its standard deviations that is worth a new version; set by hand",
    )
    smallest_narrowing: float = number(
        0.05,
        0.0,
        1.0,
        "part by which a standard deviation must change to be worth a new version; set by hand",
    )
    freedom: float = number(
        4.0,
        0.1,
        1e6,
        "degrees of freedom of Student's distribution by which observations that contradict all "
        "others count less; set by hand",
    )
    memory: float = number(
        20.0,
        1.0,
        1e6,
        "observations after which one counts 1/e of what it did in the judgement of the stated "
        "uncertainty and of the share that can be explained; set by hand",
    )
    recent: int = number(
        8, 2, 1000, "last observations among which the beginning of a change is looked for"
    )
    fewest_changed: int = number(
        4,
        2,
        1000,
        "observations that must agree on a change: fewer may be disturbed alike by chance",
    )
    doubtful: int = number(
        16, 0, 10_000, "doubtful observations that are kept for another look at most"
    )

    def __post_init__(self) -> None:
        check_settings(self)

    def joint(self, *, scans: tuple[int, ...] = ()) -> JointEstimationSettings:
        """Return the settings of joint fits that scan all parameters at the given steps."""
        return replace(
            JointEstimationSettings(), largest_advance=self.largest_advance, scan_steps=scans
        )

    def careful(self) -> RecursionSettings:
        """Return settings of lone fits that advance more slowly, and so miss fewer solutions."""
        usual = JointEstimationSettings()
        return replace(self, lone_steps=self.retry_steps, largest_advance=usual.largest_advance)


@dataclass(frozen=True)
class OnlineOptions:
    """How to learn in the background. Ranges are those that a user of the node may give.

    Parameters
    ----------
    recursion : tuned numbers
    """

    method: str = choice(
        JOINT_METHOD,
        (JOINT_METHOD,),
        "of learning in the background, which is recursive; the others search over all "
        "observations, when asked to learn",
    )
    seconds: float = number(
        30.0,
        0.1,
        1e6,
        "CPU time for learning in the background at most for each new observation; what one does "
        "not take is saved up for later ones; looked at between steps",
        unit="s",
    )
    window: int = number(
        24,
        4,
        1000,
        "observations that are fitted jointly; of those before them only what they say of the "
        "parameters is kept, as a Gaussian",
    )
    time_constant: float = number(
        0.0,
        0.0,
        1e12,
        "after which an observation counts 1/e of what it did, by the stamps of the observations; "
        "0: none is ever forgotten",
        unit="s",
    )
    false_alarm_rate: float = number(
        1e-4,
        1e-12,
        0.1,
        "chance for each observation that a change of the parameters of a pair is noticed where "
        "there is none",
    )
    recursion: RecursionSettings = field(default_factory=RecursionSettings)

    def __post_init__(self) -> None:
        check_settings(self)
