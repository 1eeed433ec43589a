"""All that recursive learning remembers, as plain data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_learner.joint_estimation.joint_fit import ObservationFit
from intuitive_physics_learner.joint_estimation.local_likelihood import LocalLikelihood
from intuitive_physics_learner.online.change_point import ChangePoint
from intuitive_physics_learner.online.information import (
    Information,
    decode_array,
    encode_array,
)

FORMAT = "intuitive_physics/online_state/1"
"""Format of the JSON text, which every text names."""


@dataclass(eq=False)
class Member:
    """An observation that is kept.

    Parameters
    ----------
    id : of the observation
    number : how many observations came before it
    stamp : s, its start time
    fit : from which the next fit begins
    likelihood : of θ_s, from this observation alone where it is doubtful, else from the last joint
        fit
    weight : with which it counts; 0 where it is doubtful
    """

    id: str
    number: int
    stamp: float
    fit: ObservationFit
    likelihood: LocalLikelihood
    weight: float = 1.0


@dataclass(eq=False)
class OnlineState:
    """What is known of n parameters, and from what.

    Parameters
    ----------
    materials : known so far, in the order of `parameter_names`
    centre : (n,) mean where nothing is known, on the unit cube
    unit : (n,) the present estimate there
    retired : what is known from before the window
    posterior : with the window
    window : observations that are fitted jointly
    doubtful : observations that were set aside, the newest last
    moves : (n,) squares of the estimate's last moves over its variance, summed with forgetting
    narrowings : (n,) what `moves` is expected to be: by how much the variances have shrunk, over
        themselves
    published : newest version of θ_s; None before the first
    published_information : what is known according to it, of the n parameters
    score : prequential: ln p of the observations since then according to the candidate, less
        that according to what is published
    compared : number of these observations
    processed : observations so far
    set_aside : of these, how many are doubtful
    explained, met : number of observations that could be explained to their end, or as far as they
        can be predicted, and of all, both with forgetting
    changes : last changes that were noticed, and how many observations there were before each
    time : s, the latest start time of an observation
    position : revision of the store up to which observations are known
    spare_seconds : CPU time in s that earlier observations have left over
    """

    materials: tuple[str, ...]
    centre: NDArray[np.float64]
    unit: NDArray[np.float64]
    retired: Information
    posterior: Information
    moves: NDArray[np.float64]
    narrowings: NDArray[np.float64]
    window: list[Member] = field(default_factory=list)
    doubtful: list[Member] = field(default_factory=list)
    published: LearnedParameters | None = None
    published_information: Information = field(default_factory=lambda: Information.none(0))
    score: float = 0.0
    compared: int = 0
    processed: int = 0
    set_aside: int = 0
    explained: float = 0.0
    met: float = 0.0
    changes: list[tuple[ChangePoint, int]] = field(default_factory=list)
    time: float | None = None
    position: int = 0
    spare_seconds: float = 0.0

    @staticmethod
    def empty() -> OnlineState:
        """Before any observation."""
        nothing = np.zeros(0)
        known = Information.none(0), Information.none(0)
        return OnlineState((), nothing, nothing.copy(), *known, nothing.copy(), nothing.copy())

    def to_json(self) -> str:
        """Return it as JSON text, every number to its last digit."""
        data = {
            "format": FORMAT,
            **{name: getattr(self, name) for name in (*_PLAIN, "spare_seconds")},
            **{name: encode_array(getattr(self, name)) for name in _ARRAYS},
            **{name: _information_data(getattr(self, name)) for name in _INFORMATION},
            **{
                name: [_member_data(one) for one in getattr(self, name)]
                for name in ("window", "doubtful")
            },
            "changes": [{**asdict(change), "before": before} for change, before in self.changes],
            "published": None if self.published is None else self.published.to_dict(),
        }
        return json.dumps(data, allow_nan=False)

    @staticmethod
    def from_json(text: str) -> OnlineState:
        """Read what `to_json` wrote.

        Raises
        ------
        InvalidInputError
            When the text is cut short, of another format, or lacks a part.
        """
        try:
            data = json.loads(text)
            if data["format"] != FORMAT:
                raise InvalidInputError(
                    f"state of on-line learning has the format {data['format']!r}; expected "
                    f"{FORMAT!r}"
                )
            published = data["published"]
            return OnlineState(
                **{
                    **{name: data[name] for name in _PLAIN},
                    # Texts of before November 2026 have none.
                    "spare_seconds": data.get("spare_seconds", 0.0),
                    "materials": tuple(data["materials"]),
                    **{name: decode_array(data[name]) for name in _ARRAYS},
                    **{name: _read_information(data[name]) for name in _INFORMATION},
                    **{
                        name: [_read_member(one) for one in data[name]]
                        for name in ("window", "doubtful")
                    },
                    "changes": [_read_change(one) for one in data["changes"]],
                    "published": published and LearnedParameters.from_dict(published),
                }
            )
        except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
            raise InvalidInputError(f"state of on-line learning cannot be read: {error}") from None


_PLAIN = (
    "materials",
    "score",
    "compared",
    "processed",
    "set_aside",
    "explained",
    "met",
    "time",
    "position",
)
"""Fields that JSON can express."""

_ARRAYS = ("centre", "unit", "moves", "narrowings")
"""Fields that are arrays (n,)."""

_INFORMATION = ("retired", "posterior", "published_information")
"""Fields that are an `Information`."""


def _read_change(data: Mapping[str, Any]) -> tuple[ChangePoint, int]:
    pair = tuple(data["pair"])
    return ChangePoint(pair, data["length"], data["probability"]), int(data["before"])


def _information_data(information: Information) -> dict[str, Any]:
    return {"matrix": encode_array(information.matrix), "vector": encode_array(information.vector)}


def _read_information(data: Mapping[str, Any]) -> Information:
    return Information(decode_array(data["matrix"]), decode_array(data["vector"]))


def _member_data(member: Member) -> dict[str, Any]:
    fit, likelihood = member.fit, member.likelihood
    return {
        "id": member.id,
        "number": member.number,
        "stamp": member.stamp,
        "weight": member.weight,
        "estimate": encode_array(fit.estimate),
        "deviations": encode_array(fit.deviations),
        "horizon": float(fit.horizon),
        "parameters": likelihood.parameters.tolist(),
        "at": encode_array(likelihood.estimate),
        "information": encode_array(likelihood.information),
        "scores": encode_array(likelihood.scores),
        "loss": likelihood.loss,
    }


def _read_member(data: Mapping[str, Any]) -> Member:
    return Member(
        data["id"],
        data["number"],
        data["stamp"],
        ObservationFit(
            decode_array(data["estimate"]), decode_array(data["deviations"]), data["horizon"]
        ),
        LocalLikelihood(
            np.array(data["parameters"], dtype=np.int64),
            decode_array(data["at"]),
            decode_array(data["information"]),
            decode_array(data["scores"]),
            data["loss"],
        ),
        data["weight"],
    )
