"""The program of `bound_command`: a module that the kernel kills when its parent ends."""

from __future__ import annotations

import runpy
import sys

from intuitive_physics.processes.guard import die_with_parent


def main() -> None:
    """Run `<parent's id> <module> <arguments>`."""
    parent, module = int(sys.argv[1]), sys.argv[2]
    die_with_parent(parent)
    sys.argv = sys.argv[2:]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
