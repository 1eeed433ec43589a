"""ODE, the paper's engine, through a C++ program."""

from __future__ import annotations

from benchmarks.peers.engine import Engine, Prepared
from benchmarks.peers.rollout_program import PreparedProgram, compile_program
from benchmarks.scenes import Instance


class Ode(Engine):
    """Debian's ODE with its quick stepper and the full contact model.

    `auto_disable` lets bodies at rest sleep, at ODE's defaults. With `boxes_roll` boxes, too, have
    rolling friction, as ours and as ODE users give it to all.
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
            self.how = "the same with rolling friction for round objects only"
        self._flags = (auto_disable, boxes_roll)

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        program = compile_program(
            "ode_rollout", ["-O2", "-lode"], "install ODE: tools/bench_packages.sh"
        )
        return PreparedProgram(program, instance, self._flags, steps, time_step)
