"""Amount of noise in a prediction: a few numbers, fitted to the past and kept beside θ_s."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.validation import non_negative_float
from intuitive_physics_predictor.noise import StateNoise
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

FORMAT = "intuitive_physics/noise_scales/1"
"""Format and version that a file of scales names."""

SCALES_KEY = "noise_scales"
"""Key of the scales in a file of θ_s; readers of θ_s alone ignore it."""

KEPT = 4
"""Distributions of θ_s in the cache, at most 8 MB each: that of the ticks and of some requests."""


@dataclass(frozen=True)
class NoiseScales:
    """Factors on the uncertainties a prediction is given, and noise it is not given.

    The defaults take the uncertainties of perception and learner as they are. Each scale is a
    number, so that a node has a parameter for it.

    Parameters
    ----------
    state : factor on the perceived standard deviations of pose and linear velocity
    spin : factor on the perceived standard deviations of the angular velocity
    static_parameters : factor on the learner's standard deviations of what was identified
    unidentified : share, at most 1, of the way to its bounds that what was not identified may go
    contact : standard deviation of frictions and restitution about those of their pair
    size : relative standard deviation of the objects' dimensions
    """

    state: float = 1.0
    spin: float = 1.0
    static_parameters: float = 1.0
    unidentified: float = 1.0
    contact: float = 0.0
    size: float = 0.0

    def __post_init__(self) -> None:
        for name in NOISE_SCALES:
            value = non_negative_float(getattr(self, name), f"noise scale {name}")
            object.__setattr__(self, name, value)
        if self.unidentified > 1.0:
            raise InvalidInputError(
                f"noise scale unidentified is {self.unidentified:g}; expected 0 to 1"
            )

    def state_noise(self) -> StateNoise:
        """Noise on the perceived states."""
        return StateNoise(scale=self.state, spin_scale=self.spin)

    def parameters(
        self, learned: LearnedParameters, materials: tuple[str, ...] | None = None
    ) -> UncertainParameters:
        """Distribution of θ_s for these materials, default all; the last ones drawn are kept."""
        return _uncertain_parameters(learned, self, materials)

    def to_dict(self) -> dict[str, Any]:
        """Plain data that JSON and YAML hold as it is."""
        return {"format": FORMAT, **asdict(self)}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> NoiseScales:
        """Read what `to_dict` wrote; what is missing has its default.

        Raises
        ------
        InvalidInputError
            When the format is another one, a name unknown or a value no number ≥ 0.
        """
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            got = data.get("format") if isinstance(data, Mapping) else type(data).__name__
            raise InvalidInputError(f"noise scales have the format {got!r}; expected {FORMAT!r}")
        unknown = sorted(set(map(str, data)) - {"format", *NOISE_SCALES})
        if unknown:
            raise InvalidInputError(
                f"noise scale is {unknown[0]!r}; expected {', '.join(NOISE_SCALES)}"
            )
        return NoiseScales(**{name: data[name] for name in NOISE_SCALES if name in data})


@lru_cache(maxsize=KEPT)
def _uncertain_parameters(
    learned: LearnedParameters, scales: NoiseScales, materials: tuple[str, ...] | None
) -> UncertainParameters:
    return UncertainParameters(
        learned,
        scale=scales.static_parameters,
        unidentified=scales.unidentified,
        contact=scales.contact,
        materials=materials,
    )


NOISE_SCALES = tuple(field.name for field in fields(NoiseScales))
"""Names of the scales."""
