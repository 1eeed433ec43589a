"""When what moves no more is left alone."""

from __future__ import annotations

from intuitive_physics.geometry.vectors import dot, load, scaled, store
from intuitive_physics.kernels import fast_inlined, kernel
from intuitive_physics.simulation.stepped.world import body_at, member_at

QUIET_SPEED = 2e-3
"""m/s. Bodies no point of which moves faster …"""

QUIET_STEPS = 10
"""… for so many steps, while something holds them, fall asleep."""


@fast_inlined
def is_still(body, velocity, spin):
    """Whether no point of the body moves faster than QUIET_SPEED."""
    rim = scaled(spin, body.reach)
    return dot(velocity, velocity) + dot(rim, rim) < QUIET_SPEED * QUIET_SPEED


@kernel
def put_to_sleep(world, count):
    """Let an island sleep when all of it has been quiet for long enough."""
    quiet = True
    for a in range(count):
        body = body_at(world, member_at(world, a))
        still = body.pressed == 1 and is_still(body, load(body.velocity), load(body.spin))
        body.quiet_steps = body.quiet_steps + 1 if still else 0
        quiet = quiet and body.quiet_steps >= QUIET_STEPS
    for a in range(count):
        body = body_at(world, member_at(world, a))
        body.asleep = quiet
        if quiet:
            store(body.velocity, (0.0, 0.0, 0.0))
            store(body.spin, (0.0, 0.0, 0.0))
