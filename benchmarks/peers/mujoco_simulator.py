"""MuJoCo behind the simulators' interface, for worlds of one object among planes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import MissingPeerError
from benchmarks.peers.mujoco_rollout import restitution_spring
from intuitive_physics.errors import InvalidInputError
from intuitive_physics.simulation import Rollout, Simulator, WorldBatch, WorldStatus
from intuitive_physics.simulation.world_batch import BOX, SPHERE


class MujocoSimulator(Simulator):
    """Simulates one world after the other, the contact tuned to its pair of materials.

    MuJoCo has one friction, so μ_d stands for both; μ_r times the radius is its rolling arm; its
    restitution is a spring. The object carries what its pair with the planes has.

    Parameters
    ----------
    time_step : s
    """

    name = "mujoco"

    def __init__(self, time_step: float) -> None:
        try:
            import mujoco
            from mujoco import rollout
        except ImportError:
            raise MissingPeerError("MuJoCo is missing: .venv/bin/pip install mujoco") from None
        self._mujoco: Any = mujoco
        self._run: Any = rollout.rollout
        self._time_step = time_step

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        if worlds.object_counts.max() > 1:
            raise InvalidInputError("a world has several objects; expected one in each")
        positions = np.full((worlds.size, 1, times.shape[1], 3), np.nan)
        status = np.full(worlds.size, WorldStatus.OK)
        for w in range(worlds.size):
            row = times[w if len(times) > 1 else 0]
            row = row[np.isfinite(row)]
            path = self._path(worlds, w, float(row[-1]))
            clock = np.arange(len(path)) * self._time_step
            for axis in range(3):
                positions[w, 0, : row.size, axis] = np.interp(row, clock, path[:, axis])
            if not np.isfinite(path).all():
                status[w] = WorldStatus.NOT_FINITE
        return Rollout(positions, None, status)

    def _path(self, worlds: WorldBatch, w: int, duration: float) -> NDArray[np.float64]:
        """Positions (n_steps + 1, 3) of the object from the start on."""
        mujoco = self._mujoco
        model = mujoco.MjModel.from_xml_string(_model_text(worlds, w, self._time_step))
        data = mujoco.MjData(model)
        state = worlds.states[w, 0]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, state[[6, 3, 4, 5]])
        data.qpos[:] = state[[0, 1, 2, 6, 3, 4, 5]]
        # A free joint's angular velocity is in the body's frame.
        data.qvel[:] = np.concatenate([state[7:10], turn.reshape(3, 3).T @ state[10:13]])
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, start, kind)
        steps = int(np.ceil(duration / self._time_step)) + 1
        states, _ = self._run(model, data, start[None], nstep=steps)
        return np.concatenate([state[None, :3], states[0, :, 1:4]])


def _model_text(worlds: WorldBatch, w: int, time_step: float) -> str:
    environment = worlds.environment_index[w]
    material = worlds.object_materials[w, 0]
    plane_material = worlds.plane_materials[environment, 0]
    table = worlds.parameter_index[w]
    _, friction, rolling, restitution = worlds.coefficients[table, :, material, plane_material]
    sizes = worlds.dimensions[w, 0]
    kind = worlds.shape_kinds[w, 0]
    if kind == SPHERE:
        solid, arm = f'type="sphere" size="{sizes[0]}"', rolling * sizes[0]
    elif kind == BOX:
        solid, arm = f'type="box" size="{_words(sizes / 2)}"', 0.0
    else:
        solid = f'type="capsule" size="{sizes[0]} {sizes[1] / 2}"'
        arm = rolling * sizes[0]
    # Of two geoms the larger friction counts, and springs are mixed by weight: the object's alone.
    planes = "".join(
        f'<geom type="plane" size="20 20 1" pos="{_words(p[:3] * p[3])}" zaxis="{_words(p[:3])}"'
        ' friction="0 0 0" solmix="1e-9"/>'
        for p in worlds.planes[environment, : worlds.plane_counts[environment]]
    )
    spring = restitution_spring(float(restitution), time_step)
    return f"""<mujoco>
  <option timestep="{time_step}" gravity="{_words(worlds.gravity[environment])}"/>
  <worldbody>{planes}<body><freejoint/>
    <geom {solid} condim="6" density="{worlds.density[table, material]}"
      friction="{friction} {arm} {arm}" solref="{spring}" solimp="0.99 0.99 0.001"/>
  </body></worldbody>
</mujoco>"""


def _words(numbers: NDArray[np.float64]) -> str:
    return " ".join(map(str, numbers.tolist()))
