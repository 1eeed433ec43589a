"""MuJoCo behind the simulators' interface: one more opinion, for experiments.

Contacts are given by pair, so friction and rolling friction of each pair are what θ_s says. MuJoCo
has one friction coefficient, its contacts are damped springs and its friction creeps; restitution
is how far such a spring is damped.
"""

from __future__ import annotations

import copy
import math
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics.simulation import Rollout, Simulator, WorldBatch, WorldStatus
from intuitive_physics.validation import positive_float
from intuitive_physics_experiments.engines.mujoco_model import (
    check_supported,
    model_key,
    model_text,
    set_parameters,
)

DEFAULT_TIME_STEP = 1e-3
DEFAULT_CONTACT_TIME = 8e-3
"""s; eight steps: with fewer a spring misses its restitution, with more objects sink in deeper."""


class MujocoSimulator(Simulator):
    """Simulates batches of worlds with MuJoCo's `rollout`, on one thread.

    Parameters
    ----------
    time_step : s; outputs are interpolated linearly between steps
    contact_time : s that a bounce lasts, at least two steps

    Raises
    ------
    IntuitivePhysicsError
        When MuJoCo is not installed.
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
        # MuJoCo stops a world that blows up and starts it anew; a warning tells.
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
