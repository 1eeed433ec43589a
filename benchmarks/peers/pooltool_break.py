"""Breaks of billiards in pooltool, for benchmarks/simulation/billiards.py; a program of its own.

It runs in an environment of its own and imports nothing of this project. Standard input is JSON:
`radius` in m, `length` and `width` of the table in m, `cloth`, `rolling`, `cushion_restitution`,
`cushion_friction`, `speed` of the cue ball in m/s, `times` that each break is simulated, and
`breaks`, each a list of the balls' (x, y) in m from a corner, the cue ball first; it rolls along y.
Standard output is JSON: `version`, and for each break `seconds`, the median, and `events`.
"""

from __future__ import annotations

import importlib.metadata
import json
import statistics
import sys
import time
from typing import Any

import numpy as np

AT_REST, SLIDING = 0, 2  # pooltool's numbers of a ball's motion


def system(request: dict[str, Any], places: list[list[float]]) -> Any:
    """Return balls on a table without pockets; the cue ball, which slides, comes first."""
    import pooltool
    from pooltool.objects.table.specs import BilliardTableSpecs

    parameters = pooltool.BallParams(
        R=request["radius"],
        u_s=request["cloth"],
        u_r=request["rolling"],
        e_c=request["cushion_restitution"],
        f_c=request["cushion_friction"],
    )
    balls = {}
    for i, (x, y) in enumerate(places):
        name = str(i)
        moving = np.zeros((3, 3))
        moving[0] = x, y, request["radius"]
        if i == 0:
            moving[1] = 0.0, request["speed"], 0.0
        state = pooltool.objects.BallState(moving, SLIDING if i == 0 else AT_REST)
        balls[name] = pooltool.Ball(id=name, state=state, params=parameters)
    specs = BilliardTableSpecs(l=request["length"], w=request["width"])
    table = pooltool.Table.from_table_specs(specs)
    return pooltool.System(cue=pooltool.Cue(cue_ball_id="0"), table=table, balls=balls)


def main() -> None:
    """Answer the one request."""
    import pooltool

    request = json.load(sys.stdin)
    answers = []
    for k, places in enumerate(request["breaks"]):
        seconds, events = [], 0
        # The first simulation of all compiles.
        for _ in range(request["times"] + (k == 0)):
            shot = system(request, places)
            start = time.perf_counter()
            pooltool.simulate(shot, inplace=True)
            seconds.append(time.perf_counter() - start)
            events = len(shot.events)
        answers.append(
            {"seconds": statistics.median(seconds[-request["times"] :]), "events": events}
        )
    version = importlib.metadata.version("pooltool-billiards")
    json.dump({"version": version, "breaks": answers}, sys.stdout)


if __name__ == "__main__":
    main()
