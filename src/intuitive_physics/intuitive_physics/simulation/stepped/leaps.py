"""When several steps of a lone body may be taken at once, with the same result.

Its forces must be the same in each of them. So are those on a sphere that flies, that rolls or
slides on a level plane, and on a capsule that rolls on one.
"""

from __future__ import annotations

from intuitive_physics.geometry.vectors import load, norm, tangential
from intuitive_physics.kernels import fast_inlined
from intuitive_physics.simulation.world_batch import CAPSULE, SPHERE

SETTLED = 1e-9
"""m and m/s. Gaps and speeds that a step has closed or ended are smaller, but for rounding."""

LEVEL = 1e-9
"""Of gravity. On a plane along which it pulls more, what rolls may change its heading."""


@fast_inlined
def may_leap(body):
    """Whether it is worth asking: a box never rolls, and a capsule does not fly like this."""
    if body.asleep == 1 or body.drag != 0.0 or body.magnus != 0.0:
        return False
    return body.kind == SPHERE or (body.kind == CAPSULE and body.pressed == 1)


@fast_inlined
def is_level(world, n):
    """Whether gravity pulls along a plane's normal n alone."""
    return norm(tangential(load(world.gravity), n)) <= LEVEL * world.gravity_size
