"""How much of what a fit found is more than chance.

Numbers fitted to few outcomes are partly chance, and what was believed before is the better guess
where the outcomes do not contradict it. So a fit is shrunk towards where it began, by as much as
chance alone would have moved it: k numbers, found δ away with the covariance C, keep the share
1 - k / (δᵀ C⁻¹ δ), or nothing (James, Stein: Estimation with quadratic loss, 1961; positive part).

What chance does is read from how the gain in score differs from outcome to outcome. Near its best
the mean score of n outcomes is a parabola with the Hessian H, and C = H⁻¹ G H⁻¹ / n, where G is the
covariance of the single outcomes' slopes (Godambe: An optimum property of regular maximum
likelihood estimation, 1960). The gain over the start is δᵀ H δ / 2 on average, and its standard
error √(δᵀ G δ / n). Of one number, δᵀ C⁻¹ δ is so the square of twice the gain over its standard
error; for several it is taken to be the same.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import finite_array


def share_beyond_chance(gains: ArrayLike, numbers: int) -> float:
    """Share of the way from where a fit began to what it found that is to be gone.

    Parameters
    ----------
    gains : (n,) by how much the score of each outcome, independent of the others, became better
    numbers : that were fitted

    Returns
    -------
    float
        In [0, 1]; 0 where nothing was gained, or a single outcome cannot tell.

    Raises
    ------
    InvalidInputError
        When there is no outcome, a gain is not finite, or no number was fitted.
    """
    gained = finite_array(gains, "gains", (None,))
    if numbers < 1 or not len(gained):
        raise InvalidInputError(
            f"{numbers} numbers were fitted to {len(gained)} outcomes; expected at least one each"
        )
    mean = float(gained.mean())
    if len(gained) < 2 or mean <= 0.0:
        return 0.0
    by_chance = numbers * float(gained.var(ddof=1)) / len(gained)
    found = 4.0 * mean**2
    return 1.0 - by_chance / found if by_chance < found else 0.0
