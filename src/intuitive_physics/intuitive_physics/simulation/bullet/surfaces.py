"""Coefficients by pair of materials, written as the coefficients by body that Bullet has.

Bullet gives each *body* a friction f, a restitution e and a rolling friction ρ (m), and a contact
of bodies a and b gets f_a f_b, e_a e_b and ρ_a f_b + ρ_b f_a. So pairs of materials can be
expressed exactly only where the wanted matrix has that form; where it has not, and where static and
dynamic friction differ, `surfaces` refuses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.shapes import Capsule, Shape, Sphere


@dataclass(frozen=True)
class Surface:
    """Bullet's coefficients of one body; rolling in m."""

    friction: float
    rolling: float
    restitution: float


def surfaces(
    coefficients: NDArray[np.float64],
    objects: NDArray[np.int64],
    static: NDArray[np.int64],
    shapes: list[Shape],
) -> list[Surface]:
    """Find the surfaces of all bodies, objects first, then the environment's.

    Parameters
    ----------
    coefficients : (4, m, m) as `StaticParameters.coefficients`
    objects : (n,) codes of the objects' materials
    static : (k,) codes of the materials of the environment's primitives
    shapes : of the objects

    Raises
    ------
    UnsupportedSceneError
        When no surfaces make the coefficients of all pairs that can touch.
    """
    mu_s, mu_d, mu_r, e = coefficients
    bodies = np.concatenate([objects, static])
    pairs = [(i, k) for i in range(len(objects)) for k in range(i + 1, len(bodies))]
    if not pairs:
        return [Surface(0.0, 0.0, 0.0) for _ in objects]
    firsts, seconds = np.transpose(pairs)
    touching = bodies[firsts], bodies[seconds]
    if (mu_s[touching] != mu_d[touching]).any():
        raise UnsupportedSceneError(
            "static and dynamic friction differ; bullet has one friction coefficient, "
            "make them equal or use stepped"
        )
    levers = _levers(shapes, len(static))
    arms = np.minimum(levers[firsts], levers[seconds])
    rolling = mu_r[touching] * np.where(np.isfinite(arms), arms, 0.0)
    if len(objects) == 1:
        friction = np.concatenate([[1.0], mu_d[touching]])
        restitution = np.concatenate([[1.0], e[touching]])
        own_rolling = np.concatenate([[0.0], rolling])
    else:
        friction = _factors(mu_d[touching], pairs, len(bodies), "friction")
        restitution = _factors(e[touching], pairs, len(bodies), "restitution")
        own_rolling = _rolling(rolling, friction, pairs)
    return [Surface(*map(float, row)) for row in np.stack([friction, own_rolling, restitution], 1)]


def _levers(shapes: list[Shape], n_static: int) -> NDArray[np.float64]:
    """Rolling radius in m; a contact has the smaller one, and without a finite one none rolls."""
    round_ones = [s.radius if isinstance(s, Sphere | Capsule) else np.inf for s in shapes]
    return np.array(round_ones + [np.inf] * n_static)


def _factors(
    wanted: NDArray[np.float64], pairs: list[tuple[int, int]], bodies: int, name: str
) -> NDArray[np.float64]:
    """Write the wanted value of each pair (i, k) as factors[i] * factors[k]."""
    factors = np.zeros(bodies)
    firsts, seconds = np.transpose(pairs)
    if wanted.any():
        incidence = np.eye(bodies)[firsts] + np.eye(bodies)[seconds]
        logarithms = np.log(np.maximum(wanted, 1e-300))
        factors = np.exp(np.linalg.lstsq(incidence, logarithms, rcond=None)[0])
    if not np.allclose(factors[firsts] * factors[seconds], wanted, rtol=1e-6, atol=1e-9):
        raise UnsupportedSceneError(
            f"the {name} of the pairs is no product of one number for each body; bullet "
            "multiplies the numbers of two bodies, use stepped"
        )
    return factors


def _rolling(
    wanted: NDArray[np.float64], friction: NDArray[np.float64], pairs: list[tuple[int, int]]
) -> NDArray[np.float64]:
    """Write the wanted arm (m) of each pair (i, k) as ρ_i f_k + ρ_k f_i, no ρ below zero."""
    rolling = np.zeros(len(friction))
    firsts, seconds = np.transpose(pairs)
    if wanted.any():
        design = np.zeros((len(pairs), len(friction)))
        rows = np.arange(len(pairs))
        design[rows, firsts] = friction[seconds]
        design[rows, seconds] = friction[firsts]
        rolling = np.asarray(np.linalg.lstsq(design, wanted, rcond=None)[0], dtype=np.float64)
    made = rolling[firsts] * friction[seconds] + rolling[seconds] * friction[firsts]
    rounding = 1e-9 * np.abs(rolling).max()
    if not np.allclose(made, wanted, rtol=1e-6, atol=1e-12) or rolling.min() < -rounding:
        raise UnsupportedSceneError(
            "the rolling friction of the pairs is no sum of one number for each body; bullet "
            "adds the numbers of two bodies, each times the other's friction, use stepped"
        )
    return np.maximum(rolling, 0.0)
