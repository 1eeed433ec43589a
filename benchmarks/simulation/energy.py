"""The total energy of rollouts, read from positions and orientations alone.

Energies are read in the middle of short gaps between two outputs, of which READINGS follow one
another up to each of SAMPLES. There a step of our engines ends: within it, a body whose contacts
part or close moves by its last velocities all the time, so that one that falls has the speed of the
step's end while it is still higher.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene

GRAVITY = 9.81  # m/s², as an environment has it
GAP, READINGS = 1e-3, 3  # s, and gaps at each sample
SAMPLES = np.arange(1, 31) * 0.1  # s
# s, outputs to ask for: the last gap ends at the sample
TIMES: NDArray[np.float64] = (SAMPLES[:, None] + GAP * np.arange(-READINGS, 1)).ravel()
ALIKE = 5e-4  # m; readings that differ by less than the energy of this height are of one state
FALLING = 1e-3  # part of g; what falls with g to this part touches nothing

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Masses:
    """Masses (W, O) kg and principal inertias (W, O, 3) kg m² of many scenes; 0 for no object."""

    mass: Array
    inertia: Array
    starts: Array  # (W, O, 13)

    @classmethod
    def of(cls, scenes: Sequence[Scene], parameters: Sequence[StaticParameters]) -> Masses:
        """Take them from scenes, each with its θ_s."""
        shape = (len(scenes), max(len(scene.objects) for scene in scenes))
        mass, inertia, starts = np.zeros(shape), np.zeros((*shape, 3)), np.zeros((*shape, 13))
        starts[..., 6] = 1.0
        for w, (scene, theta) in enumerate(zip(scenes, parameters, strict=True)):
            for k, (thing, state) in enumerate(zip(scene.objects, scene.states, strict=True)):
                density = theta.density[theta.index(thing.material)]
                mass[w, k] = thing.shape.mass(density)
                inertia[w, k] = thing.shape.inertia(density)
                starts[w, k] = state.to_vector()
        return cls(mass, inertia, starts)

    @property
    def weight(self) -> Array:
        """N, of all objects of each scene."""
        return GRAVITY * self.mass.sum(axis=1)


def largest_gains(masses: Masses, positions: Array, orientations: Array, held: bool) -> Array:
    """Return by how much each scene's energy has grown at most, as a part of what is there.

    Parameters
    ----------
    masses : of W scenes
    positions, orientations : (W, O, len(TIMES), 3) m and (W, O, len(TIMES), 4)
    held : whether forces are held over steps, of which one ends at each of SAMPLES

    Returns
    -------
    gains : (W,) the largest rise over an earlier reading or the start that no error of the reading
        explains, over the energy before it; 0 where there is none. What moves is counted over the
        floor, z = 0
    """
    energies, misread = _readings(masses, positions, orientations, held)
    least = _first_energy(masses)
    gains = np.zeros(len(least))
    alike = ALIKE * masses.weight
    for k in range(len(SAMPLES)):
        highest, doubt = energies[:, k].max(axis=1), misread[:, k].max(axis=1)
        # An impact within a gap, or friction, makes the readings differ: none is then true. A
        # world that was stopped has no readings, NaN, which agree with nothing.
        agree = highest - energies[:, k].min(axis=1) < doubt + alike
        grown = np.where(agree, highest - doubt - least, 0.0)
        gains = np.maximum(gains, grown / least)
        least = np.where(agree, np.minimum(least, highest + doubt), least)
    return gains


def _first_energy(masses: Masses) -> Array:
    """E = Σ m v² / 2 + ω·I ω / 2 + m g z at the start, (W,) J."""
    s = masses.starts
    return _energy(masses, s[..., 2], s[..., 7:10], s[..., 3:7], s[..., 10:13])


def _readings(
    masses: Masses, positions: Array, orientations: Array, held: bool
) -> tuple[Array, Array]:
    """Return energies in the middle of the gaps, and how far they may be misread.

    Both are (W, n_samples, READINGS) J. Two orientations tell a spin whose axis turns meanwhile to
    (|ω| gap)² / 12 of it; that of a sphere does not turn. Where forces are held, gravity still
    works on what touches something until its step ends, τ later: the energy is misread by up to
    m g |v_z| τ. What falls freely is on its parabola.
    """
    there = masses.mass[..., None, None, None] > 0.0
    grouped = (*positions.shape[:2], len(SAMPLES), READINGS + 1)
    x = np.where(there, positions.reshape(*grouped, 3), 0.0)
    q = np.where(there, orientations.reshape(*grouped, 4), [0.0, 0.0, 0.0, 1.0])
    velocity = np.diff(x, axis=3) / GAP
    height = 0.5 * (x[..., :-1, 2] + x[..., 1:, 2])
    middle, spin = _turning(q[..., :-1, :], q[..., 1:, :])
    energy = _energy(masses, height, velocity, middle, spin)
    uneven = np.where(np.ptp(masses.inertia, axis=-1) > 0.0, masses.inertia.max(axis=-1), 0.0)
    squared = (spin**2).sum(axis=-1)
    turned = (uneven[..., None, None] * squared**2).sum(axis=1) * GAP**2 / 6
    fall = np.diff(velocity[..., 2], axis=3) / (GRAVITY * GAP) + 1.0
    touching = (np.abs(fall) > FALLING).any(axis=3, keepdims=True)
    ahead = masses.mass[..., None, None] * np.abs(velocity[..., 2]) * touching
    left = GAP * (np.arange(READINGS, 0, -1) - 0.5) * held
    return energy, turned + ahead.sum(axis=1) * GRAVITY * left


def _turning(before: Array, after: Array) -> tuple[Array, Array]:
    """Return the orientation between two (..., 4), and the spin (..., 3) rad/s from one to it."""
    after = after * np.where((before * after).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    middle = before + after
    middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    # after · before⁻¹ = (vector, scalar) turns by 2 atan2(|vector|, scalar).
    u, s, v, w = before[..., :3], before[..., 3:], after[..., :3], after[..., 3:]
    vector = s * v - w * u - np.cross(v, u)
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, (before * after).sum(axis=-1, keepdims=True))
    return middle, vector * angle / np.maximum(sine, 1e-12) / GAP


def _energy(
    masses: Masses, height: Array, velocity: Array, orientation: Array, spin: Array
) -> Array:
    """Return energies, summed over the objects of axis 1, of values (W, O, ...)."""
    more = (slice(None), slice(None), *[None] * (height.ndim - 2))
    own = _rotated_back(orientation, spin)
    kinetic = masses.mass[more] * (velocity**2).sum(axis=-1)
    kinetic = kinetic + (masses.inertia[more] * own**2).sum(axis=-1)
    total: Array = (0.5 * kinetic + masses.mass[more] * GRAVITY * height).sum(axis=1)
    return total


def _rotated_back(quaternions: Array, vectors: Array) -> Array:
    """Return vectors (..., 3) in the axes of the bodies of those orientations (..., 4)."""
    u, w = -quaternions[..., :3], quaternions[..., 3:]
    return vectors + 2.0 * np.cross(u, np.cross(u, vectors) + w * vectors)
