"""Static parameters θ_s: density by material, four coefficients by *pair* of materials (Eq. 2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.limits import check_limit
from intuitive_physics.validation import finite_array, finite_float, name_string, set_fields

PAIR_COEFFICIENTS = ("static_friction", "dynamic_friction", "rolling_friction", "restitution")
"""Order of the four coefficients of a pair wherever they stand in one array."""

DEFAULT_DENSITY = 500.0
"""kg/m³, of a material of which nothing was learned; set by hand, between foam and water."""

DEFAULT_COEFFICIENTS = (0.5, 0.4, 0.01, 0.5)
"""Coefficients of a pair of materials of which nothing was learned, in the order of
`PAIR_COEFFICIENTS`; set by hand, dimensionless."""


def pair_count(materials: int) -> int:
    """ψ = m (m + 1) / 2: unordered pairs of m materials, each with itself included (Eq. 1)."""
    return materials * (materials + 1) // 2


def parameter_count(materials: int) -> int:
    """|θ_s| = m + 4 ψ (Eq. 3): 14, 275 and 945 for m = 2, 11 and 21."""
    return materials + len(PAIR_COEFFICIENTS) * pair_count(materials)


@dataclass(frozen=True, eq=False)
class StaticParameters:
    """θ_s of a set of materials.

    Parameters
    ----------
    materials : names, each once; their order is that of the axes below
    density : (m,) kg/m³
    coefficients : (4, m, m), symmetric in its last two axes: static friction μ_s and dynamic
        friction μ_d ≤ μ_s (dimensionless), rolling friction μ_r (dimensionless: its torque is at
        most μ_r · radius · normal force), restitution e in [0, 1]

    Raises
    ------
    InvalidInputError
        When a value lies outside the ranges above or a matrix is not symmetric.
    """

    materials: tuple[str, ...]
    density: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    def __init__(
        self, materials: Sequence[str], density: ArrayLike, coefficients: ArrayLike
    ) -> None:
        names = tuple(name_string(name, "material") for name in materials)
        if not names or len(set(names)) != len(names):
            raise InvalidInputError(
                f"materials are {list(names)}; expected at least one, each name once"
            )
        m = len(names)
        checked_density = finite_array(density, "density", (m,))
        checked = finite_array(coefficients, "pair coefficients", (len(PAIR_COEFFICIENTS), m, m))
        _check_ranges(names, checked_density, checked)
        set_fields(self, materials=names, density=checked_density, coefficients=checked)

    @staticmethod
    def uniform(
        materials: Sequence[str],
        *,
        density: float = DEFAULT_DENSITY,
        static_friction: float = DEFAULT_COEFFICIENTS[0],
        dynamic_friction: float = DEFAULT_COEFFICIENTS[1],
        rolling_friction: float = DEFAULT_COEFFICIENTS[2],
        restitution: float = DEFAULT_COEFFICIENTS[3],
    ) -> StaticParameters:
        """Give every material and every pair the same values."""
        m = len(materials)
        values = np.array([static_friction, dynamic_friction, rolling_friction, restitution])
        coefficients = np.broadcast_to(values[:, None, None], (4, m, m))
        return StaticParameters(materials, np.full(m, density), coefficients)

    def index(self, material: str) -> int:
        """Position of a material on the axes.

        Raises
        ------
        UnknownNameError
            When it is none of `materials`.
        """
        try:
            return self.materials.index(material)
        except ValueError:
            raise UnknownNameError(
                f"material is {material!r}; expected one of {', '.join(self.materials)}"
            ) from None

    def pair(self, a: str, b: str) -> dict[str, float]:
        """Return the four coefficients of a pair by name."""
        values = self.coefficients[:, self.index(a), self.index(b)]
        return dict(zip(PAIR_COEFFICIENTS, map(float, values), strict=True))

    def with_pair(self, a: str, b: str, **coefficients: float) -> StaticParameters:
        """Return a copy with other values of the named coefficients of one pair."""
        changed = self.coefficients.copy()
        i, j = self.index(a), self.index(b)
        for name, value in coefficients.items():
            if name not in PAIR_COEFFICIENTS:
                raise UnknownNameError(
                    f"coefficient is {name!r}; expected one of {', '.join(PAIR_COEFFICIENTS)}"
                )
            k = PAIR_COEFFICIENTS.index(name)
            changed[k, i, j] = changed[k, j, i] = finite_float(value, name)
        return StaticParameters(self.materials, self.density, changed)

    def with_density(self, material: str, density: float) -> StaticParameters:
        """Return a copy with another density (kg/m³) of one material."""
        changed = self.density.copy()
        changed[self.index(material)] = density
        return StaticParameters(self.materials, changed, self.coefficients)

    def extended(self, materials: Sequence[str]) -> StaticParameters:
        """Return parameters of `materials`: known values, and defaults for new materials."""
        base = StaticParameters.uniform(materials)
        density, coefficients = base.density.copy(), base.coefficients.copy()
        shared = [name for name in materials if name in self.materials]
        new = np.array([materials.index(name) for name in shared], dtype=int)
        old = np.array([self.index(name) for name in shared], dtype=int)
        density[new] = self.density[old]
        coefficients[:, new[:, None], new] = self.coefficients[:, old[:, None], old]
        return StaticParameters(materials, density, coefficients)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return {
            "density": {
                name: float(rho) for name, rho in zip(self.materials, self.density, strict=True)
            },
            "pairs": [
                {"materials": [a, b], **self.pair(a, b)} for a, b in material_pairs(self.materials)
            ],
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> StaticParameters:
        """Read what `to_dict` wrote, with all pairs."""
        try:
            check_limit("most_materials", len(data["density"]), "materials")
            materials = list(data["density"])
            density = [data["density"][name] for name in materials]
            given = {frozenset(pair["materials"]): pair for pair in data["pairs"]}
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"static parameters lack {error}; expected density by material and pairs"
            ) from None
        coefficients = np.empty((4, len(materials), len(materials)))
        for (i, a), (j, b) in _index_pairs(materials):
            pair = given.get(frozenset((a, b)))
            if pair is None:
                raise InvalidInputError(f"the pair ({a}, {b}) is missing; expected all pairs")
            values = [finite_float(pair.get(name), name) for name in PAIR_COEFFICIENTS]
            coefficients[:, i, j] = coefficients[:, j, i] = values
        return StaticParameters(materials, density, coefficients)


def material_pairs(materials: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the ψ unordered pairs (a, b) in the order of `parameter_names`."""
    for (_, a), (_, b) in _index_pairs(materials):
        yield a, b


def parameter_names(materials: Sequence[str]) -> list[str]:
    """Names of the |θ_s| parameters in the order of `ParameterSpace`'s vectors."""
    names = [f"density[{name}]" for name in materials]
    for a, b in material_pairs(materials):
        names += [f"{coefficient}[{a}, {b}]" for coefficient in PAIR_COEFFICIENTS]
    return names


def parameter_key(name: str) -> tuple[str, tuple[str, ...]]:
    """Return what a parameter's name stands for: its kind, and its materials in one order.

    Names of `parameter_names` that differ only in which material of a pair stands first have the
    same key. What is no such name has no materials.
    """
    kind, _, rest = name.partition("[")
    if not rest.endswith("]"):
        return name, ()
    materials = rest[:-1].split(",") if kind != "density" else [rest[:-1]]
    return kind, tuple(sorted(material.strip() for material in materials))


def parameter_places(
    materials: Sequence[str], others: Sequence[str]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the parameters that two sets of materials share.

    Returns
    -------
    places, other_places : (n_shared,) indices of the same parameters in the order of
        `parameter_names` of either
    """
    place = {name: i for i, name in enumerate(_unordered_names(others))}
    shared = [(k, place[n]) for k, n in enumerate(_unordered_names(materials)) if n in place]
    places, other_places = np.array(shared, dtype=np.int64).reshape(-1, 2).T
    return places, other_places


def _unordered_names(materials: Sequence[str]) -> list[tuple[str, frozenset[str]]]:
    # As `parameter_names`, but a pair has the same name whichever of its materials stands first.
    names = [("density", frozenset([name])) for name in materials]
    pairs = [frozenset(pair) for pair in material_pairs(materials)]
    return names + [(coefficient, pair) for pair in pairs for coefficient in PAIR_COEFFICIENTS]


def _index_pairs(materials: Sequence[str]) -> Iterator[tuple[tuple[int, str], tuple[int, str]]]:
    for i, a in enumerate(materials):
        for j in range(i, len(materials)):
            yield (i, a), (j, materials[j])


def _check_ranges(
    names: tuple[str, ...], density: NDArray[np.float64], coefficients: NDArray[np.float64]
) -> None:
    static, dynamic, rolling, restitution = coefficients
    # Searches make thousands of these: what is wrong is looked for where anything is.
    valid = (density > 0.0).all() and (coefficients == coefficients.transpose(0, 2, 1)).all()
    valid = valid and ((dynamic >= 0.0) & (dynamic <= static) & (rolling >= 0.0)).all()
    if not (valid and ((restitution >= 0.0) & (restitution <= 1.0)).all()):
        raise InvalidInputError(_out_of_range(names, density, coefficients))


def _out_of_range(
    names: tuple[str, ...], density: NDArray[np.float64], coefficients: NDArray[np.float64]
) -> str:
    """Say which value is out of its range, where any is."""
    for name, rho in zip(names, density, strict=True):
        if rho <= 0.0:
            return f"density of {name} is {rho:g}; expected above zero"
    for (i, a), (j, b) in _index_pairs(names):
        mu_s, mu_d, mu_r, e = coefficients[:, i, j]
        if not 0.0 <= mu_d <= mu_s:
            return (
                f"({a}, {b}) has dynamic friction {mu_d:g} and static friction {mu_s:g}; "
                "expected 0 ≤ dynamic ≤ static"
            )
        if mu_r < 0.0:
            return f"({a}, {b}) has rolling friction {mu_r:g}; expected ≥ 0"
        if not 0.0 <= e <= 1.0:
            return f"({a}, {b}) has restitution {e:g}; expected 0 to 1"
    return "pair coefficients are not symmetric; expected the same value for (a, b) and (b, a)"
