"""C++ programs that roll out worlds in another engine, compiled when they are first needed.

`peers/rollout_request.h` says what they read and write.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import IO, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.engine import MissingPeerError, Prediction, Prepared
from benchmarks.scenes import Instance
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere

HERE = Path(__file__).parent
PROGRAMS = Path(__file__).resolve().parents[2] / "build/benchmarks"  # folder of compiled programs
HEADER = HERE / "rollout_request.h"  # read by all programs


def compile_program(
    name: str, options: Sequence[str], remedy: str, inputs: Sequence[Path] = ()
) -> Path:
    """Compile `peers/name.cpp` with options of g++ if it, or an input, is newer than its program.

    Raises
    ------
    MissingPeerError : it does not compile; the message has the remedy and the compiler's words
    """
    source, program = HERE / f"{name}.cpp", PROGRAMS / name
    newest = max(path.stat().st_mtime for path in (source, HEADER, *inputs))
    if program.exists() and program.stat().st_mtime >= newest:
        return program
    PROGRAMS.mkdir(parents=True, exist_ok=True)
    command = [compiler(), "-std=c++17", str(source), *options, "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise MissingPeerError(f"{source.name} does not compile; {remedy}\n{done.stderr}")
    return program


def compiler() -> str:
    """Return the path of g++, or raise `MissingPeerError`."""
    found = shutil.which("g++")
    if found is None:
        raise MissingPeerError("there is no g++; install it: apt-get install g++")
    return found


class PreparedProgram(Prepared):
    """A program that runs and waits for an instance, which it is given again and again.

    Both flags are the program's own choices.
    """

    def __init__(
        self,
        program: Path,
        instance: Instance,
        flags: tuple[bool, bool],
        steps: int,
        time_step: float,
    ) -> None:
        self._request = _request(instance, flags, steps, time_step)
        self._shape = (*instance.starts.shape[:2], steps, 3)
        self._name = program.name
        self._program = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
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
            f"{self._name} ended with {self._program.wait()}; it has said why on standard error"
        )


def _request(
    instance: Instance, flags: tuple[bool, bool], steps: int, time_step: float
) -> NDArray[np.float64]:
    """Lay out an instance as `peers/rollout_request.h` reads it."""
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
    raise TypeError(f"no program knows {shape!r}; expected a Sphere, Box or Capsule")
