"""How to learn in the background: what users set."""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number


@dataclass(frozen=True)
class OnlineOptions:
    """How to learn in the background. Ranges are those that a user of the node may give."""

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
        0.0,
        0.1,
        "chance for each observation that a change of the parameters of a pair is noticed where "
        "there is none; 0: no change is looked for",
    )

    def __post_init__(self) -> None:
        check_settings(self)
