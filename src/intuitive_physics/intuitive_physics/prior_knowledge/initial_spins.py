"""The spread of the initial spins of balls, for each material.

A camera does not see the spin of a plain ball, so the first state of each throw states a guess:
mean zero, and a standard deviation σ₀ that is the same on each axis. The learner finds from many
throws what the spread σ really is. The predictor takes it where a state states the guess.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.shapes import Shape, Sphere
from intuitive_physics.state import ANGULAR_VELOCITY, ERROR_SIZE, ObjectState
from intuitive_physics.validation import name_string, non_negative_float, positive_float, set_fields

PRIOR_THROWS = 1.0 / (6.0 * np.log(4.0) ** 2)
"""Throws of exactly measured spin as which the guess σ₀ counts, a twelfth of one.

The guess is taken to be right to a factor of four, as rolling balls have 2 rad/s and balls from a
launcher 200: ln σ has the prior N(ln σ₀, ln² 4). One throw whose spin is measured exactly has three
components, each with the information 2 on ln σ, so that the prior counts as 1 / (6 ln² 4) throws,
and n throws leave the standard error 1 / √(6 (n + n₀)). Half a throw moves the estimate 85 % of the
way to what it says, two throws move it 96 %, and one whose trajectory says nothing of its spin does
not move it at all. The prior is normal in ln σ, and not the scaled inverse-χ² that is conjugate:
that one does not give way below σ₀, and in a room where σ is a fifth of it would stay two standard
errors too high after ten throws.
"""

SPIN_AXES = 3
"""Components of a spin, all of the same standard deviation."""

EQUAL = 1e-6
"""Relative difference of standard deviations up to which they are the same but for rounding."""


@dataclass(frozen=True)
class SpinSpread:
    """Spread of the initial spins of the balls of one material: normal, mean zero, alike on axes.

    Parameters
    ----------
    deviation : σ, rad/s on each axis, the mode of its posterior
    count : throws of exactly measured spin that would say as much; 0: it is the guess
    stated : σ₀, rad/s on each axis, the guess that first states state
    """

    deviation: float
    count: float
    stated: float

    def __post_init__(self) -> None:
        set_fields(
            self,
            deviation=positive_float(self.deviation, "standard deviation of initial spins"),
            count=non_negative_float(self.count, "effective number of throws"),
            stated=positive_float(self.stated, "stated standard deviation of an unknown spin"),
        )

    @property
    def relative_error(self) -> float:
        """Standard error of ln σ: 1 / √(6 (n + n₀)) with n the effective number of throws."""
        return float((2.0 * SPIN_AXES * (self.count + PRIOR_THROWS)) ** -0.5)


@dataclass(frozen=True)
class InitialSpins:
    """Spreads of the initial spins of some materials; of the others nothing is known.

    Parameters
    ----------
    by_material : the spread of each material
    """

    by_material: Mapping[str, SpinSpread] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_limit("most_materials", len(self.by_material), "materials with initial spins")
        for name, spread in self.by_material.items():
            name_string(name, "material")
            if not isinstance(spread, SpinSpread):
                raise InvalidInputError(
                    f"initial spins of {name} are {spread!r:.80}; expected a SpinSpread"
                )
        object.__setattr__(self, "by_material", dict(sorted(self.by_material.items())))

    def __bool__(self) -> bool:
        """Whether anything is known."""
        return bool(self.by_material)

    def updated(self, newer: InitialSpins) -> InitialSpins:
        """Return these with what is newer in place of what they say of the same materials."""
        return InitialSpins({**self.by_material, **newer.by_material})

    def among(self, materials: Sequence[str]) -> InitialSpins:
        """Return what is known of some materials."""
        return InitialSpins(
            {name: spread for name, spread in self.by_material.items() if name in materials}
        )

    def check_materials(self, materials: Sequence[str]) -> None:
        """Make sure that there are no others than these materials.

        Raises
        ------
        InvalidInputError
            When one is not among them.
        """
        unknown = sorted(set(self.by_material) - set(materials))
        if unknown:
            raise InvalidInputError(
                f"initial spins are of {unknown[0]!r}; expected materials of the parameters: "
                f"{', '.join(materials)}"
            )

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return plain data that `from_dict` reads."""
        return {name: asdict(spread) for name, spread in self.by_material.items()}

    @staticmethod
    def from_dict(data: Any) -> InitialSpins:
        """Read what `to_dict` wrote.

        Raises
        ------
        InvalidInputError
            When a field is missing or not what it must be.
        """
        try:
            return InitialSpins(
                {
                    name: SpinSpread(entry["deviation"], entry["count"], entry["stated"])
                    for name, entry in data.items()
                }
            )
        except (AttributeError, KeyError, TypeError) as error:
            raise InvalidInputError(
                f"initial spins cannot be read ({error}); expected deviation, count and stated of "
                "each material"
            ) from None


def unknown_spin(shape: Shape, state: ObjectState) -> float | None:
    """Return σ₀, rad/s on each axis, where the spin of a ball is a guess in its state.

    A guess has the mean zero, the same deviation on each axis, and nothing to do with the rest of
    the state. None where the angular velocity was seen, or is known exactly, and of other shapes.

    Parameters
    ----------
    shape : of the object
    state : as perceived
    """
    if not isinstance(shape, Sphere):
        return None
    covariance = state.covariance
    spin_covariance = covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY]
    across = covariance[ANGULAR_VELOCITY, : ERROR_SIZE - SPIN_AXES]
    variance = float(spin_covariance[0, 0])
    alike = np.allclose(
        spin_covariance, variance * np.eye(SPIN_AXES), rtol=EQUAL, atol=EQUAL * variance
    )
    if variance <= 0.0 or not alike or across.any() or state.angular_velocity.any():
        return None
    return float(np.sqrt(variance))
