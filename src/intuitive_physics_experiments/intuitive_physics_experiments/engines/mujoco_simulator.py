"""MuJoCo behind the simulators' interface: one more opinion, for experiments.

Contacts are given by pair, so friction and rolling friction of each pair are what θ_s says. MuJoCo
has one friction coefficient, its contacts are damped springs and its friction creeps; restitution
is how far such a spring is damped.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from itertools import combinations
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from intuitive_physics.errors import IntuitivePhysicsError, UnsupportedSceneError
from intuitive_physics.scene import Environment
from intuitive_physics.simulation import Rollout, Simulator, WorldBatch, WorldStatus
from intuitive_physics.simulation.world_batch import BOX, CAPSULE, SPHERE
from intuitive_physics.validation import positive_float

SMALLEST_ARM = 1e-9  # m, the smallest arm of rolling and torsional friction that a contact is given

# Attributes of a geometry that touches only in the pairs that are listed.
NO_OTHER_CONTACT = 'contype="0" conaffinity="0"'


def check_supported(worlds: WorldBatch) -> None:
    """Raise `UnsupportedSceneError` where MuJoCo cannot express a world."""
    if worlds.corner_counts.any():
        raise UnsupportedSceneError(
            "a plane has a boundary; mujoco simulates planes without edges only, use stepped"
        )
    if worlds.has_air_forces.any():
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
    """Key of a world's model: worlds of one key differ by their θ_s only."""
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
    bodies = "".join(
        f'<body><freejoint/><inertial pos="{_words(worlds.mass_centres[w, i])}" mass="1" '
        'diaginertia="1 1 1"/>'
        f'<geom name="thing_{i}" {_solid(worlds, w, i)} {NO_OTHER_CONTACT}/></body>'
        for i in range(count)
    )
    pairs = "".join(f'<pair geom1="{a}" geom2="{b}" condim="6"/>' for a, b, *_ in _pairs(worlds, w))
    return f"""<mujoco>
  <option timestep="{time_step}" gravity="{_words(environment.gravity)}" cone="elliptic"/>
  <worldbody>{_grounds(environment)}{bodies}</worldbody>
  <contact>{pairs}</contact>
</mujoco>"""


def set_parameters(
    model: Any, worlds: WorldBatch, w: int, time_step: float, contact_time: float
) -> None:
    """Write masses, inertias and the pairs' coefficients of a world into its model; times in s."""
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
    Springs of critical damping and more, which rebound with less than e⁻², cannot be distinguished.
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


DEFAULT_TIME_STEP = 1e-3  # s

# s; eight steps: with fewer a spring misses its restitution, with more objects sink in deeper.
DEFAULT_CONTACT_TIME = 8e-3


class MujocoSimulator(Simulator):
    """Simulates batches of worlds with MuJoCo's `rollout`, on one thread.

    Outputs are interpolated linearly between steps of `time_step` s; a bounce lasts `contact_time`
    s, at least two steps.
    """

    name = "mujoco"

    def __init__(
        self,
        *,
        time_step: float = DEFAULT_TIME_STEP,
        contact_time: float = DEFAULT_CONTACT_TIME,
    ) -> None:
        self.time_step = positive_float(time_step, "time step")
        self.contact_time = max(positive_float(contact_time, "contact time"), 2.0 * self.time_step)
        self._mujoco = _mujoco()

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        check_supported(worlds)
        rows = np.broadcast_to(times, (worlds.size, times.shape[1]))
        shape = (*worlds.states.shape[:2], times.shape[1])
        positions = np.full((*shape, 3), np.nan)
        turned = np.full((*shape, 4), np.nan)
        status = np.full(worlds.size, int(WorldStatus.NOT_FINITE))
        models: dict[tuple[Any, ...], Any] = {}
        for members in _alike(worlds):
            first = int(members[0])
            count = int(worlds.object_counts[first])
            key = model_key(worlds, first)
            if key not in models:
                models[key] = self._mujoco.MjModel.from_xml_string(
                    model_text(worlds, first, self.time_step)
                )
            model = copy.copy(models[key])
            set_parameters(model, worlds, first, self.time_step, self.contact_time)
            states = self._simulated(model, worlds.states[members, :count], rows[members])
            for w, path in zip(members, states, strict=True):
                if not np.isfinite(path).all():
                    continue
                row = rows[w][np.isfinite(rows[w])]
                at = _interpolated(path, row / self.time_step)
                positions[w, :count, : row.size] = at[..., :3]
                turned[w, :count, : row.size] = at[..., [4, 5, 6, 3]]
                status[w] = WorldStatus.OK
        return Rollout(positions, turned if orientations else None, status)

    def _simulated(
        self, model: Any, states: NDArray[np.float64], times: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Poses (W, steps + 1, O, 7), position and (w, x, y, z), after each step."""
        import mujoco.rollout

        count = states.shape[1]
        steps = math.ceil(float(np.nanmax(times)) / self.time_step) + 1
        data = self._mujoco.MjData(model)
        starts = np.array([self._state_vector(model, data, state) for state in states])
        # MuJoCo stops a world that diverges and restarts it, with a warning.
        rolled, _ = mujoco.rollout.rollout(model, data, starts, nstep=steps)
        poses = np.concatenate([starts[:, None], rolled], axis=1)[:, :, 1 : 1 + 7 * count]
        time = rolled[:, -1, 0]
        poses[time < 0.5 * steps * self.time_step] = np.nan
        return poses.reshape(*poses.shape[:2], count, 7)

    def _state_vector(
        self, model: Any, data: Any, state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        mujoco = self._mujoco
        turn = np.zeros(9)
        for i, row in enumerate(state):
            quaternion = row[[6, 3, 4, 5]]
            mujoco.mju_quat2Mat(turn, quaternion)
            # A free joint's angular velocity is in the body's axes.
            spin = turn.reshape(3, 3).T @ row[10:13]
            data.qpos[7 * i : 7 * i + 7] = (*row[:3], *quaternion)
            data.qvel[6 * i : 6 * i + 6] = (*row[7:10], *spin)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        vector = np.empty(mujoco.mj_stateSize(model, kind))
        data.time = 0.0
        mujoco.mj_getState(model, data, vector, kind)
        return vector


def _mujoco() -> ModuleType:
    try:
        import mujoco
    except ImportError:
        raise IntuitivePhysicsError(
            "MuJoCo is not installed; expected it for this engine: pip install mujoco"
        ) from None
    return mujoco


def _alike(worlds: WorldBatch) -> list[NDArray[np.int64]]:
    """Worlds that share one model: same objects, environment and θ_s."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for w in range(worlds.size):
        key = (*model_key(worlds, w), int(worlds.parameter_index[w]))
        groups.setdefault(key, []).append(w)
    return [np.array(members) for members in groups.values()]


def _interpolated(poses: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (O, n, 7) at fractional steps (n,) of poses (steps, O, 7)."""
    before = np.clip(np.floor(at + 1e-9).astype(int), 0, len(poses) - 2)
    share = (at - before)[:, None, None]
    first, second = poses[before], poses[before + 1]
    flipped = np.sum(first[..., 3:] * second[..., 3:], axis=-1, keepdims=True) < 0.0
    second = np.concatenate(
        [second[..., :3], np.where(flipped, -1.0, 1.0) * second[..., 3:]], axis=-1
    )
    mixed = (1.0 - share) * first + share * second
    mixed[..., 3:] /= np.linalg.norm(mixed[..., 3:], axis=-1, keepdims=True)
    return mixed.transpose(1, 0, 2)
