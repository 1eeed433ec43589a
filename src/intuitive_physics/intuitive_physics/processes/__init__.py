"""Processes that are started for a purpose: what they write, and that none outlives its run."""

from intuitive_physics.processes.child_process import ChildProcess, ProcessFailedError
from intuitive_physics.processes.guard import bound_command, guard_run

__all__ = ["ChildProcess", "ProcessFailedError", "bound_command", "guard_run"]
