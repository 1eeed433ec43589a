"""Set-up compiles all that a first recording needs: no frame of it waits for a compiler."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from intuitive_physics_cli.evaluation.recording_perception import find_frame_source, read_frames
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_perception import compile as perception
from intuitive_physics_perception.pipeline import PerceptionPipeline
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_recordings.bag_reader import BagReader


def test_no_frame_compiles_what_set_up_has_not(tmp_path: Path) -> None:
    render_bag(tmp_path / "throws", RenderSettings(throws=3))
    # In a process of its own, where no other test has compiled anything.
    asked = [sys.executable, __file__, str(tmp_path / "throws")]
    answered = subprocess.run(asked, check=True, capture_output=True, text=True, timeout=250)
    compiled, observations = json.loads(answered.stdout.splitlines()[-1])
    assert observations == {"images": 3, "clouds": 3}
    assert compiled == {}


def versions() -> dict[str, set[str]]:
    """Types of arguments for which each kernel has been compiled, or loaded, in this process."""
    return {
        f"{thing.py_func.__module__}.{thing.py_func.__qualname__}": set(map(str, thing.signatures))
        for thing in gc.get_objects()
        if isinstance(thing, Dispatcher)
    }


def as_cloud(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The readings of every second pixel in both directions, as a LiDAR's cloud has them."""
    some = points[::2, ::2].reshape(1, -1, 3)
    return np.ascontiguousarray(some[np.isfinite(some[..., 2])][None])


def main(path: str) -> None:
    """Print what playing a bag compiles after the warm-up, and how many throws are observed."""
    perception.warm_up()
    known = versions()
    with BagReader(path) as bag:
        frames = list(read_frames(bag, find_frame_source(bag)))
    observed = {}
    for kind, convert in (("images", lambda points: points), ("clouds", as_cloud)):
        pipeline = PerceptionPipeline(PerceptionSettings(), np.random.default_rng(0))
        results = [pipeline.process(convert(points), time) for time, points in frames]
        last = pipeline.finish()
        observed[kind] = sum(len(result.observations) for result in results) + len(last)
    now = versions()
    compiled = {name: sorted(now[name] - known.get(name, set())) for name in now}
    compiled = {name: types for name, types in compiled.items() if types}
    print(json.dumps([compiled, observed]))


if __name__ == "__main__":
    main(sys.argv[1])
