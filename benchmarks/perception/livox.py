"""A LiDAR whose pattern does not repeat: what is found of balls that rest and roll."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.command import Outcome, report_progress
from benchmarks.perception.perceive import PerceptionRun, detected_spheres, tracked_spheres
from benchmarks.results.result import Column, Table
from intuitive_physics.scene import Environment, Plane, StaticBox
from intuitive_physics_experiments.rendering.camera import UP, Camera
from intuitive_physics_experiments.rendering.rosette_lidar import RosetteLidar, RosettePattern
from intuitive_physics_perception.settings import PerceptionSettings

SEED = 47  # of the scenes, each of which has a generator of its own
SCENES, QUICK_SCENES = 12, 2
RATE = 10.0  # clouds a second
NOISE = 0.005  # m, of a range
EMPTY, ROLLING = 12, 20  # clouds without a ball, and with one that rolls
RADII = (0.09, 0.15)  # m
SPEEDS = (0.1, 0.4)  # m/s
ENOUGH = 60  # readings on a ball from which on it counts


@dataclass
class Findings:
    """Counts over the clouds of all scenes."""

    clouds: int = 0
    environments: int = 0  # scenes whose floor was found
    visible: int = 0  # clouds with enough readings on the ball
    found: int = 0  # of these, with a detection of it
    followed: int = 0  # of these, in which it was published
    false: int = 0  # detections elsewhere


def measure_livox(quick: bool) -> Outcome:
    """Measure clouds of 10,000 readings."""
    count, findings = QUICK_SCENES if quick else SCENES, Findings()
    for k in range(count):
        report_progress(f"rosette scene {k + 1} of {count}")
        _perceive_scene(np.random.default_rng([SEED, k]), findings)
    recall = findings.found / findings.visible if findings.visible else float("nan")
    table = Table(
        title="Patterns that do not repeat",
        note=f"Clouds of a rosette, {RATE:g} a second of 10,000 readings, with {1e3 * NOISE:g} mm "
        f"of noise; a ball that rolls. Recall is over the clouds with at least {ENOUGH} readings "
        "on it.",
        columns=[
            Column("scenes"),
            Column("environments found"),
            Column("clouds with a ball"),
            Column("recall", "", ".1%"),
            Column("followed", "", ".1%"),
            Column("false in 1,000 clouds", "", ".1f"),
        ],
        rows=[
            [
                count,
                findings.environments,
                findings.visible,
                recall,
                findings.followed / max(findings.visible, 1),
                1e3 * findings.false / findings.clouds,
            ]
        ],
    )
    return Outcome([table], {"livox_recall": float(f"{recall:.4g}")})


def _perceive_scene(rng: np.random.Generator, findings: Findings) -> None:
    """Perceive one room, first empty, then with a ball that rolls, and count what is found."""
    environment, camera = _room(rng)
    lidar = RosetteLidar(camera, environment, RosettePattern(), NOISE, rng)
    up = camera.rotation.T @ UP
    run = PerceptionRun(PerceptionSettings(up_hint=(float(up[0]), float(up[1]), float(up[2]))))
    radius, start, velocity = _roll(rng)
    for n in range(EMPTY + ROLLING):
        begin, rolled = n / RATE, (n - EMPTY) / RATE
        times = lidar.pattern.times(begin, 1.0 / RATE) - EMPTY / RATE
        balls = ([start + times[:, None] * velocity], [radius]) if n >= EMPTY else ([], [])
        points, read, owner = lidar.read(begin, 1.0 / RATE, *balls)
        result = run.process(points, begin, offsets=(read - begin).astype(np.float32)[None])
        findings.clouds += 1
        if n == EMPTY - 1:
            findings.environments += _is_right(run, camera)
        if result.model is None:
            continue
        # Of the middle of the cloud, in which the ball moves by 4 cm at most.
        true = camera.to_optical(start + (rolled + 0.5 / RATE) * velocity)
        seen = [sphere.center for sphere in detected_spheres(result)]
        known = [item.state.position for item in tracked_spheres(result)]
        near, is_known = (
            [float(np.linalg.norm(result.model.to_sensor(p) - true)) < radius for p in places]
            for places in (seen, known)
        )
        is_there = n >= EMPTY
        is_visible = is_there and int((owner == 0).sum()) >= ENOUGH
        findings.visible += is_visible
        findings.found += is_visible and any(near)
        findings.followed += is_visible and any(is_known)
        findings.false += len(near) - (is_there and any(near))


def _room(rng: np.random.Generator) -> tuple[Environment, Camera]:
    """A floor, a wall, a crate, and a sensor that looks down at the floor."""
    material = "room"
    floor = Plane("floor", material, (0.0, 0.0, 1.0), 0.0)
    wall = Plane("wall", material, (-1.0, 0.0, 0.0), -rng.uniform(4.0, 5.0))
    edges = rng.uniform(0.2, 0.4, 3)
    center = np.array([rng.uniform(3.2, 3.6), rng.choice([-0.6, 0.6]), 0.5 * edges[2]])
    crate = StaticBox("crate", material, center, (0.0, 0.0, 0.0, 1.0), edges)
    position = np.array([0.0, 0.0, rng.uniform(1.0, 1.5)])
    camera = Camera.looking_at(position, [rng.uniform(2.2, 2.8), 0.0, 0.2])
    return Environment([floor, wall], [crate]), camera


def _roll(rng: np.random.Generator) -> tuple[float, np.ndarray, np.ndarray]:
    """Radius (m), first place (3,) m and velocity (3,) m/s of a ball that rolls across the view."""
    radius, side = float(rng.uniform(*RADII)), float(rng.choice([-1.0, 1.0]))
    speed = float(rng.uniform(*SPEEDS))
    start = np.array([rng.uniform(2.0, 2.4), -0.5 * side * speed * ROLLING / RATE, radius])
    return radius, start, np.array([0.0, side * speed, 0.0])


def _is_right(run: PerceptionRun, camera: Camera) -> bool:
    """Whether the floor and its height below the sensor are found within 2° and 3 cm."""
    model = run.pipeline.model
    if model is None:
        return False
    up = camera.rotation.T @ UP
    angle = np.degrees(np.arccos(np.clip(model.rotation[2] @ up, -1.0, 1.0)))
    return bool(angle < 2.0 and abs(model.translation[2] - camera.position[2]) < 0.03)
