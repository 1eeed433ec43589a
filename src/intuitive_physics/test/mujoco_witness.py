"""MuJoCo as a witness: a scene of ours as its model, as hard as its soft contacts become.

MuJoCo's contact is a stiff, damped spring and its friction gives way by creeping. At a step of
0.1 ms the spring's time constant can be 0.2 ms, and what is left of both is below 2 mm over a
second. Restitution is a tuned spring there, so it is a witness for e = 0 only; it has one
friction coefficient, so for μ_s = μ_d only; and sliding and rolling friction share one cone, so for
rolling friction far below that of sliding only.
"""

from __future__ import annotations

import mujoco
import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Sphere

STEP = 1e-4
# Twenty times the critical damping: at the critical one a contact rebounds at 13 % of its speed.
STIFF = f'solref="{2 * STEP} 20" solimp="0.99 0.999 0.0001"'


def mujoco_path(scene: Scene, theta: StaticParameters, times) -> np.ndarray:
    """Positions (n_objects, n_times, 3) at times that are multiples of `STEP`."""
    model = mujoco.MjModel.from_xml_string(_model(scene, theta))
    data = mujoco.MjData(model)
    for k, state in enumerate(scene.states):
        q = state.orientation
        data.qpos[7 * k : 7 * k + 7] = (*state.position, q[3], *q[:3])
        # A free joint's spin is in the body's axes.
        data.qvel[6 * k : 6 * k + 3] = state.linear_velocity
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[7 * k + 3 : 7 * k + 7])
        data.qvel[6 * k + 3 : 6 * k + 6] = turn.reshape(3, 3).T @ state.angular_velocity
    path, done = [], 0
    for steps in np.rint(np.asarray(times) / STEP).astype(int):
        mujoco.mj_step(model, data, nstep=steps - done)
        done = steps
        path.append(data.qpos.reshape(-1, 7)[:, :3].copy())
    return np.stack(path, axis=1)


def _model(scene: Scene, theta: StaticParameters) -> str:
    things = range(len(scene.objects))
    grounds = [f"ground_{k}" for k in range(len(_grounds(scene.environment)))]
    pairs = [_pair(f"thing_{i}", scene.objects[i], g, None, theta) for i in things for g in grounds]
    pairs += [
        _pair(f"thing_{i}", scene.objects[i], f"thing_{k}", scene.objects[k], theta)
        for i in things
        for k in range(i)
    ]
    return f"""
    <mujoco>
      <option timestep="{STEP}" gravity="{_numbers(scene.environment.gravity)}" cone="elliptic"
              integrator="RK4" solver="Newton" iterations="100" tolerance="1e-12"/>
      <worldbody>
        {"".join(_grounds(scene.environment))}
        {"".join(_thing(k, scene.objects[k], theta) for k in things)}
      </worldbody>
      <contact>{"".join(pairs)}</contact>
    </mujoco>"""


def _grounds(environment: Environment) -> list[str]:
    assert all(plane.boundary is None for plane in environment.planes)
    planes = [
        f'type="plane" size="0 0 1" pos="{_numbers(p.normal * p.offset)}" '
        f'zaxis="{_numbers(p.normal)}"'
        for p in environment.planes
    ]
    boxes = [
        f'type="box" size="{_numbers(0.5 * b.edge_lengths)}" pos="{_numbers(b.center)}" '
        f'quat="{_numbers(np.roll(b.orientation, 1))}"'
        for b in environment.boxes
    ]
    return [
        f'<geom name="ground_{k}" {what} contype="0" conaffinity="0"/>'
        for k, what in enumerate([*planes, *boxes])
    ]


def _thing(k: int, thing: SceneObject, theta: StaticParameters) -> str:
    density = theta.density[theta.index(thing.material)]
    match thing.shape:
        case Sphere() as s:
            geometry = f'type="sphere" size="{s.radius}"'
        case Box() as b:
            geometry = f'type="box" size="{_numbers(0.5 * np.array(b.edge_lengths))}"'
        case Capsule() as c:
            geometry = f'type="capsule" size="{c.radius} {0.5 * c.length}"'
    return f"""
    <body>
      <freejoint/>
      <inertial pos="0 0 0" mass="{thing.shape.mass(density)}"
                diaginertia="{_numbers(thing.shape.inertia(density))}"/>
      <geom name="thing_{k}" {geometry} contype="0" conaffinity="0"/>
    </body>"""


def _pair(
    name: str, thing: SceneObject, other: str, second: SceneObject | None, theta: StaticParameters
) -> str:
    values = theta.pair(thing.material, "ground" if second is None else second.material)
    mu, mu_r = values["dynamic_friction"], values["rolling_friction"]
    assert values["restitution"] == 0.0
    assert values["static_friction"] == mu
    if mu == 0.0:
        return f'<pair geom1="{name}" geom2="{other}" condim="1" {STIFF}/>'
    shapes = [t.shape for t in (thing, second) if t is not None]
    radii = [s.radius for s in shapes if isinstance(s, Sphere | Capsule)]
    arm = mu_r * min(radii, default=0.0)
    friction = f"{mu} {mu} {max(arm, 1e-9)} {max(arm, 1e-9)} {max(arm, 1e-9)}"
    dimensions = 6 if arm > 0.0 else 3
    return (
        f'<pair geom1="{name}" geom2="{other}" condim="{dimensions}" friction="{friction}" '
        f"{STIFF}/>"
    )


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)
