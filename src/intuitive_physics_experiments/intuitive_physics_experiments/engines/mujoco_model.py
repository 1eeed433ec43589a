"""A world of ours as MuJoCo's model: bodies, contacts by pair, and springs that rebound."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import brentq

from intuitive_physics.errors import UnsupportedSceneError
from intuitive_physics.scene import Environment
from intuitive_physics.simulation import WorldBatch
from intuitive_physics.simulation.world_batch import BOX, CAPSULE, SPHERE

SMALLEST_ARM = 1e-9
NO_OTHER_CONTACT = 'contype="0" conaffinity="0"'


def check_supported(worlds: WorldBatch) -> None:
    """Raise `UnsupportedSceneError` where MuJoCo cannot express a world."""
    if worlds.corner_counts.any():
        raise UnsupportedSceneError(
            "a plane has a boundary; mujoco simulates planes without edges only, use stepped"
        )
    if worlds.air_factors.any():
        raise UnsupportedSceneError(
            "an object has air drag or Magnus force; mujoco simulates neither here, use stepped"
        )
    for w in range(worlds.size):
        c = int(worlds.parameter_index[w])
        for *_, a, b, _ in _pairs(worlds, w):
            static, dynamic, *_ = worlds.coefficients[c, :, a, b]
            if static != dynamic:
                raise UnsupportedSceneError(
                    "static and dynamic friction differ; mujoco has one friction coefficient, "
                    "make them equal or use stepped"
                )


def model_key(worlds: WorldBatch, w: int) -> tuple[Any, ...]:
    """What worlds must share to share one model, but for their θ_s."""
    count = int(worlds.object_counts[w])
    return (
        int(worlds.environment_index[w]),
        worlds.shape_kinds[w, :count].tobytes(),
        worlds.dimensions[w, :count].tobytes(),
        worlds.unit_inertias[w, :count].tobytes(),
        worlds.mass_centres[w, :count].tobytes(),
        worlds.object_materials[w, :count].tobytes(),
    )


def model_text(worlds: WorldBatch, w: int, time_step: float) -> str:
    """Return world w as MuJoCo's XML, with unit masses and default coefficients."""
    environment = worlds.environments[worlds.environment_index[w]]
    count = int(worlds.object_counts[w])
    things = "".join(
        f'<body><freejoint/><inertial pos="{_words(worlds.mass_centres[w, i])}" mass="1" '
        'diaginertia="1 1 1"/>'
        f'<geom name="thing_{i}" {_solid(worlds, w, i)} {NO_OTHER_CONTACT}/></body>'
        for i in range(count)
    )
    pairs = "".join(f'<pair geom1="{a}" geom2="{b}" condim="6"/>' for a, b, *_ in _pairs(worlds, w))
    return f"""<mujoco>
  <option timestep="{time_step}" gravity="{_words(environment.gravity)}" cone="elliptic"/>
  <worldbody>{_grounds(environment)}{things}</worldbody>
  <contact>{pairs}</contact>
</mujoco>"""


def set_parameters(
    model: Any, worlds: WorldBatch, w: int, time_step: float, contact_time: float
) -> None:
    """Write masses, inertias and the pairs' coefficients of a world into its model.

    Parameters
    ----------
    time_step : s
    contact_time : s that a bounce lasts
    """
    import mujoco

    c = int(worlds.parameter_index[w])
    for i in range(int(worlds.object_counts[w])):
        density = worlds.density[c, worlds.object_materials[w, i]]
        model.body_mass[1 + i] = density * worlds.volumes[w, i]
        model.body_inertia[1 + i] = density * worlds.unit_inertias[w, i]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    for k, (_, _, a, b, radius) in enumerate(_pairs(worlds, w)):
        _, friction, rolling, restitution = worlds.coefficients[c, :, a, b]
        arm = max(rolling * radius, SMALLEST_ARM)
        model.pair_friction[k] = (friction, friction, SMALLEST_ARM, arm, arm)
        model.pair_dim[k] = 1 if friction == 0.0 else 6 if arm > SMALLEST_ARM else 3
        model.pair_solref[k] = _spring(restitution, time_step, contact_time)
        model.pair_solimp[k] = (0.99, 0.99, 0.001, 0.5, 2.0)


def damping_ratio(restitution: float) -> float:
    """Return ζ of a damped spring that pushes, never pulls, and rebounds with `restitution`.

    It lets go when its force is zero, before it is back at its length: e = exp(-ζ φ / √(1 - ζ²))
    with φ = π - atan2(2 ζ √(1 - ζ²), 1 - 2 ζ²) (Schwager and Pöschel, Granular Matter 2007).
    Springs of critical damping and more, which rebound with less than e⁻², are not told apart.
    """
    if restitution >= 1.0:
        return 0.0
    if restitution <= math.exp(-2.0):
        return 1.0

    def excess(ratio: float) -> float:
        root = math.sqrt(1.0 - ratio**2)
        phase = math.pi - math.atan2(2.0 * ratio * root, 1.0 - 2.0 * ratio**2)
        return math.exp(-ratio * phase / root) - restitution

    return float(brentq(excess, 0.0, 1.0 - 1e-9))


def _spring(restitution: float, time_step: float, contact_time: float) -> tuple[float, float]:
    """Return MuJoCo's `solref`: stiffness ω² and damping 2 ζ ω, as negative numbers."""
    frequency = math.pi / contact_time
    # More damping than stops a contact within one step would throw it back.
    ratio = min(damping_ratio(restitution), 0.5 / (frequency * time_step))
    return -(frequency**2), -2.0 * ratio * frequency


def _pairs(worlds: WorldBatch, w: int) -> Iterator[tuple[str, str, int, int, float]]:
    """Yield names, material codes and rolling radius (m) of all that can touch.

    Without a round object among the two nothing rolls: the radius is 0.
    """
    environment = worlds.environments[worlds.environment_index[w]]
    count = int(worlds.object_counts[w])
    materials = worlds.object_materials[w]
    radii = np.where(worlds.shape_kinds[w] == BOX, np.inf, worlds.dimensions[w, :, 0])
    for i in range(count):
        for k, ground in enumerate((*environment.planes, *environment.boxes)):
            code = worlds.materials.index(ground.material)
            yield f"ground_{k}", f"thing_{i}", code, int(materials[i]), _finite(radii[i])
    for i, k in combinations(range(count), 2):
        radius = _finite(min(radii[i], radii[k]))
        yield f"thing_{i}", f"thing_{k}", int(materials[i]), int(materials[k]), radius


def _finite(radius: float) -> float:
    return float(radius) if np.isfinite(radius) else 0.0


def _grounds(environment: Environment) -> str:
    planes = [
        f'type="plane" size="0 0 1" pos="{_words(plane.normal * plane.offset)}" '
        f'zaxis="{_words(plane.normal)}"'
        for plane in environment.planes
    ]
    boxes = [
        f'type="box" size="{_words(0.5 * box.edge_lengths)}" pos="{_words(box.center)}" '
        f'quat="{_words(box.orientation[[3, 0, 1, 2]])}"'
        for box in environment.boxes
    ]
    return "".join(
        f'<geom name="ground_{k}" {what} {NO_OTHER_CONTACT}/>'
        for k, what in enumerate([*planes, *boxes])
    )


def _solid(worlds: WorldBatch, w: int, i: int) -> str:
    dimensions = worlds.dimensions[w, i]
    match worlds.shape_kinds[w, i]:
        case kind if kind == SPHERE:
            return f'type="sphere" size="{dimensions[0]}"'
        case kind if kind == CAPSULE:
            return f'type="capsule" size="{dimensions[0]} {0.5 * dimensions[1]}"'
    return f'type="box" size="{_words(0.5 * dimensions)}"'


def _words(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in np.asarray(numbers))
