"""MuJoCo's batched `rollout`, on one thread."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import Engine, MissingPeerError, Prediction, Prepared
from benchmarks.scenes import DENSITY, Instance
from intuitive_physics.scene import Plane
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

# Steps that a bounce lasts: with fewer, springs miss e by far; with more, balls sink in deep
STEPS_IN_CONTACT = 6


class Mujoco(Engine):
    """MuJoCo with contacts as springs that are tuned to the restitution."""

    name = "MuJoCo"
    how = "rollout on one thread; condim 6, pyramidal cone, contacts as springs tuned to e"

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        return _Prepared(instance, steps, time_step)


class _Prepared(Prepared):
    def __init__(self, instance: Instance, steps: int, time_step: float) -> None:
        try:
            import mujoco
            import mujoco.rollout
        except ImportError:
            raise MissingPeerError("MuJoCo is missing: .venv/bin/pip install mujoco") from None
        # By default warnings go into a file of the present folder.
        mujoco.set_mju_user_warning(_warn)
        self._rollout = mujoco.rollout.rollout
        self._model = mujoco.MjModel.from_xml_string(_model_text(instance, time_step))
        self._data = mujoco.MjData(self._model)
        self._steps = steps
        starts = [_state_vector(mujoco, self._model, start) for start in instance.starts]
        self._initial = np.array(starts)

    def predict(self) -> Prediction:
        start = time.perf_counter()
        states, _ = self._rollout(self._model, self._data, self._initial, nstep=self._steps)
        count = self._model.nbody - 1
        bodies = states[:, :, 1 : 1 + 7 * count].reshape(*states.shape[:2], count, 7)
        positions = np.ascontiguousarray(bodies[..., :3].transpose(0, 2, 1, 3))
        return Prediction(time.perf_counter() - start, positions)


def _state_vector(mujoco: Any, model: Any, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return MuJoCo's state vector (time, positions, velocities) of states (n_objects, 13)."""
    data = mujoco.MjData(model)
    turn = np.zeros(9)
    for i, row in enumerate(start):
        quaternion = row[[6, 3, 4, 5]]
        mujoco.mju_quat2Mat(turn, quaternion)
        # A free joint's angular velocity is in the body's frame.
        spin = turn.reshape(3, 3).T @ row[10:13]
        data.qpos[7 * i : 7 * i + 7] = (*row[0:3], *quaternion)
        data.qvel[6 * i : 6 * i + 6] = (*row[7:10], *spin)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    return state


def _model_text(instance: Instance, time_step: float) -> str:
    planes = "".join(_plane_text(plane) for plane in instance.scene.environment.planes)
    objects = "".join(_object_text(shape) for shape in instance.shapes)
    surface = instance.surface
    friction = f"{surface.dynamic_friction} {surface.rolling_arm} {surface.rolling_arm}"
    return f"""<mujoco>
  <option timestep="{time_step}" gravity="{_words(instance.scene.environment.gravity)}"/>
  <default>
    <geom condim="6" friction="{friction}" density="{DENSITY}"
      solref="{restitution_spring(surface.restitution, time_step)}" solimp="0.99 0.99 0.001"/>
  </default>
  <worldbody>{planes}{objects}</worldbody>
</mujoco>"""


def restitution_spring(restitution: float, time_step: float) -> str:
    """Return MuJoCo's `solref` for a contact that rebounds with `restitution`.

    A damped oscillator's half period π/ω_d is the contact, over which its speed falls by the
    factor e = exp(-ζ ω π/ω_d), where ω_d = ω √(1 - ζ²). Negative numbers are stiffness ω² and
    damping 2 ζ ω; positive ones, for no rebound, time constant (MuJoCo's least) and damping ratio.
    """
    if restitution == 0.0:
        return f"{2 * time_step} 1"
    decay = -math.log(restitution) / math.pi
    ratio = decay / math.sqrt(1 + decay**2)
    frequency = math.pi / (STEPS_IN_CONTACT * time_step) / math.sqrt(1 - ratio**2)
    return f"{-(frequency**2)} {-2 * ratio * frequency}"


def _plane_text(plane: Plane) -> str:
    position = _words(plane.normal * plane.offset)
    return f'<geom type="plane" size="20 20 1" pos="{position}" zaxis="{_words(plane.normal)}"/>'


def _object_text(shape: Shape) -> str:
    match shape:
        case Sphere():
            solid = f'type="sphere" size="{shape.radius}"'
        case Box():
            solid = f'type="box" size="{_words(np.array(shape.edge_lengths) / 2)}"'
        case Capsule():
            solid = f'type="capsule" size="{shape.radius} {shape.length / 2}"'
        case _:
            raise TypeError(f"shape is {shape!r}; expected a Sphere, Box or Capsule")
    return f"<body><freejoint/><geom {solid}/></body>"


def _words(numbers: Any) -> str:
    return " ".join(map(str, np.asarray(numbers, dtype=float).tolist()))


def _warn(text: str) -> None:
    print(f"MuJoCo: {text}", file=sys.stderr)
