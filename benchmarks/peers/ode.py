"""ODE, the paper's engine, through a C++ program that is compiled when it is first needed."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from pathlib import Path
from typing import IO, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import Engine, MissingPeerError, Prediction, Prepared
from benchmarks.scenes import Instance
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

SOURCE = Path(__file__).parent / "ode_rollout.cpp"  # the program that simulates with ODE
# The compiled program
PROGRAM = Path(__file__).resolve().parents[2] / "build/benchmarks/ode_rollout"


class Ode(Engine):
    """Debian's ODE with its quick stepper and the full contact model.

    `auto_disable` lets bodies at rest sleep, at ODE's defaults. With `boxes_roll` boxes, too, have
    rolling friction, as ODE users give it to all; ours gives it to round objects only.
    """

    def __init__(self, *, auto_disable: bool = False, boxes_roll: bool = True) -> None:
        self.name = "ODE"
        self.how = (
            "one world, simple space, quick stepper; the callback gives each contact its pair's e, "
            "rolling arm, and μ_s or μ_d by slip speed, friction's first axis along the slip"
        )
        if auto_disable:
            self.name += ", auto-disable"
            self.how = "the same with bodies at rest put to sleep, at ODE's defaults"
        if not boxes_roll:
            self.name += ", boxes do not roll"
            self.how = "the same with rolling friction for round objects only, as in ours"
        self._flags = (auto_disable, boxes_roll)

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        return _Prepared(instance, _request(instance, self._flags, steps, time_step), steps)


def compile_program() -> Path:
    """Compile the program if its source is newer, or raise `MissingPeerError`."""
    if PROGRAM.exists() and PROGRAM.stat().st_mtime >= SOURCE.stat().st_mtime:
        return PROGRAM
    compiler = shutil.which("g++")
    if compiler is None:
        raise MissingPeerError("there is no g++; install it: apt-get install g++")
    PROGRAM.parent.mkdir(parents=True, exist_ok=True)
    command = [compiler, "-std=c++17", "-O2", str(SOURCE), "-lode", "-o", str(PROGRAM)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise MissingPeerError(
            f"ODE's program does not compile; install ODE: tools/bench_packages.sh\n{done.stderr}"
        )
    return PROGRAM


class _Prepared(Prepared):
    def __init__(self, instance: Instance, request: NDArray[np.float64], steps: int) -> None:
        self._request = request
        self._shape = (*instance.starts.shape[:2], steps, 3)
        self._program = subprocess.Popen(
            [compile_program()], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._input = cast(IO[bytes], self._program.stdin)
        self._output = cast(IO[bytes], self._program.stdout)

    def predict(self) -> Prediction:
        length = np.array([self._request.size], dtype=np.float64)
        try:
            self._input.write(length.tobytes() + self._request.tobytes())
            self._input.flush()
        except BrokenPipeError:
            self._fail()
        answer = self._read(int(self._read(1)[0]))
        return Prediction(float(answer[0]), answer[1:].reshape(self._shape))

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(BrokenPipeError):
            self._input.close()
        self._output.close()
        self._program.wait()

    def _read(self, count: int) -> NDArray[np.float64]:
        data = self._output.read(8 * count)
        if len(data) < 8 * count:
            self._fail()
        return np.frombuffer(data)

    def _fail(self) -> NoReturn:
        raise RuntimeError(
            f"ODE's program ended with {self._program.wait()}; it has said why on standard error"
        )


def _request(
    instance: Instance, flags: tuple[bool, bool], steps: int, time_step: float
) -> NDArray[np.float64]:
    """Lay out an instance as `peers/ode_rollout.cpp` reads it."""
    environment = instance.scene.environment
    parameters = instance.static_parameters
    simulations, count = instance.starts.shape[:2]
    objects = [
        (*_shape_numbers(shape), shape.mass(rho), *shape.inertia(rho))
        for shape, rho in zip(instance.shapes, parameters.density, strict=False)
    ]
    planes = [(*plane.normal, plane.offset) for plane in environment.planes]
    return np.concatenate(
        [
            [simulations, count, len(planes), steps, *flags, time_step],
            environment.gravity,
            np.ravel(objects),
            np.ravel(planes),
            _pair_table(instance).ravel(),
            instance.starts.ravel(),
        ]
    )


def _pair_table(instance: Instance) -> NDArray[np.float64]:
    """Return (objects, objects + planes, 4): μ_s, μ_d, rolling arm in m, e."""
    parameters, scene = instance.static_parameters, instance.scene
    objects = [parameters.index(item.material) for item in scene.objects]
    bodies = objects + [parameters.index(plane.material) for plane in scene.environment.planes]
    table = parameters.coefficients[:, objects][:, :, bodies].transpose(1, 2, 0).copy()
    # Every pair has the same rolling arm.
    table[..., 2] = instance.surface.rolling_arm
    return table


def _shape_numbers(shape: Shape) -> tuple[float, float, float, float]:
    match shape:
        case Sphere():
            return 0, shape.radius, 0, 0
        case Box():
            return 1, *shape.edge_lengths
        case Capsule():
            return 2, shape.radius, shape.length, 0
    raise TypeError(f"ODE's program knows no {shape!r}; expected a Sphere, Box or Capsule")
