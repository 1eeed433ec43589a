"""The benchmark of simulations: what it looks for is found, and peers may be missing."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.command import run_benchmark
from benchmarks.peers import jolt
from benchmarks.peers.engine import Engine, MissingPeerError, Prepared, present
from benchmarks.peers.jolt import Jolt
from benchmarks.peers.ours import Ours
from benchmarks.scenes import Instance
from benchmarks.simulation import __main__ as simulation
from benchmarks.simulation import billiards
from benchmarks.simulation.accuracy import Accuracy
from benchmarks.simulation.billiards import as_instance, measure_breaks, random_places
from benchmarks.simulation.energy import TIMES, Masses, largest_gains
from benchmarks.simulation.overlaps import Solid, depths, find_overlaps
from benchmarks.simulation.random_scenes import random_scene, run_random_scenes
from benchmarks.simulation.report import key_figures, speed_table
from benchmarks.simulation.start_up import StartUp
from benchmarks.timing import Measured, best_peer

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Box, Capsule, Sphere
from intuitive_physics.state import ObjectState

FLOOR = Environment([Plane("floor", "room", (0, 0, 1), 0.0)])
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ALONG_X = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
ON_EDGE = (0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8))


class Absent(Engine):
    name = "absent"
    how = "nowhere"

    def __init__(self, *, optional: bool) -> None:
        self.optional = optional

    def prepare(self, instance: Instance, steps: int, time_step: float) -> Prepared:
        raise MissingPeerError("absent is missing: bring it")


def test_an_optional_peer_that_is_missing_is_left_out_with_a_word():
    ours = Ours("stepped")
    there, words = present([ours, Absent(optional=True), Absent(optional=True)])
    assert there == [ours]
    assert words == ["left out: absent is missing: bring it"]


def test_a_peer_that_is_not_optional_is_asked_for(monkeypatch: pytest.MonkeyPatch, capsys):
    missing = [Absent(optional=False)]
    monkeypatch.setattr(simulation, "all_engines", lambda: missing)
    assert run_benchmark("simulation", "a test", simulation.run, ["--quick"]) == 1
    assert "bring it" in capsys.readouterr().err


@pytest.mark.parametrize("named", ["", "/nowhere"])
def test_jolt_without_its_source_says_what_to_do(monkeypatch: pytest.MonkeyPatch, named: str):
    monkeypatch.setenv(jolt.VARIABLE, named)
    engines, words = present([Jolt(), Jolt(sleeping=False), Jolt(world_each=True)])
    assert engines == []
    assert len(words) == 1
    assert jolt.VARIABLE in words[0]
    assert jolt.UPSTREAM in words[0]


def test_a_break_without_pooltool_is_measured(monkeypatch: pytest.MonkeyPatch, tmp_path):
    monkeypatch.setattr(billiards, "PYTHON", tmp_path / "python")
    breaks = measure_breaks(1, 1, np.random.default_rng(0))
    assert set(breaks.seconds) == {"event_driven", "stepped"}
    assert "bench_packages.sh pooltool" in breaks.left_out


def test_balls_of_a_break_rest_at_its_end_and_stay_on_the_table():
    places = random_places(np.random.default_rng(1))
    instance = as_instance(places)
    with Ours("event_driven").prepare(instance, billiards.STEPS, billiards.TIME_STEP) as world:
        x = world.predict().positions[0]
    np.testing.assert_allclose(x[:, -1], x[:, -10], atol=1e-9)
    table = np.array([billiards.WIDTH, billiards.LENGTH])
    assert (x[..., :2] > billiards.RADIUS - 1e-6).all()
    assert (x[..., :2] < table - billiards.RADIUS + 1e-6).all()
    moved = np.linalg.norm(x[:, -1, :2] - places, axis=-1) > 0.01
    assert moved.sum() > 5


def measured(**seconds: float) -> Measured:
    return Measured(seconds, {name: np.zeros((2, 1, 3, 3)) for name in seconds})


def test_the_last_line_has_the_ratios_to_the_best_peer_and_the_laws():
    times = {
        "event_driven": 1e-4,
        "ODE": 2e-2,
        "ODE, auto-disable": 1e-2,
        "Jolt, rooms apart, awake": 5e-3,
    }
    scenes = {"1_sphere": [measured(**times)], "20_mixed": [measured(**times)]}
    accuracies = {name: Accuracy((0, 0), 0, 0, 0, 0.1, 0) for name in ("event_driven", "stepped")}
    breaks = billiards.Breaks(1, {"event_driven": 1e-3}, left_out="pooltool is missing")
    figures = key_figures(
        scenes, accuracies, StartUp(1, 1, 1, 1), breaks, run_random_scenes(4, dense=4)
    )
    assert json.loads(json.dumps(figures)) == figures
    assert figures["ratio_to_ode"] == {"1_sphere": 200.0, "20_mixed": 200.0}
    assert figures["ratio_to_ode_sleeping"] == {"1_sphere": 100.0, "20_mixed": 100.0}
    assert figures["ratio_to_best_peer"] == {"1_sphere": 50.0, "20_mixed": 50.0}
    assert figures["break_ms"] == {"event_driven": 1.0}
    laws = {"worst_energy_gain", "deepest_overlap_mm", "missed_contacts"}
    assert laws | {"peak_error_p95", "compile_s", "load_s"} < set(figures)
    assert best_peer(scenes["1_sphere"]) == "Jolt, rooms apart, awake"
    table = speed_table(scenes, dict.fromkeys(times, "as it is"), ["left out: Rapier is missing"])
    named = next(row for row in table.rows if row[0] == "ours against the fastest peer")
    assert named[1] == "50 × (Jolt, rooms apart, awake)"
    assert table.remarks[-1] == "left out: Rapier is missing"


def test_random_scenes_are_simulated_by_both_engines():
    kept = {one.engine: one for one in run_random_scenes(8, dense=8)}
    assert (kept["event_driven"].scenes, kept["event_driven"].dense_scenes) == (8, 8)
    assert (kept["stepped"].scenes, kept["stepped"].dense_scenes) == (8, 8)
    assert max(one.gain.value for one in kept.values()) < 1e-4
    assert max(one.deepest for one in kept.values()) < 1e-4
    assert sum(one.stopped + one.missed for one in kept.values()) == 0


def test_a_random_scene_is_always_the_same():
    one, again = random_scene(5), random_scene(5)
    for a, b in zip(one[0].states, again[0].states, strict=True):
        np.testing.assert_array_equal(a.to_vector(), b.to_vector())
    np.testing.assert_array_equal(one[1].coefficients, again[1].coefficients)


def flight(shape, spin=(0.0, 0.0, 0.0)) -> tuple[Masses, np.ndarray, np.ndarray]:
    """An object thrown up from 50 m, which never comes down: masses, and its exact poses."""
    state = ObjectState((0, 0, 50), linear_velocity=(3, 0, 4), angular_velocity=spin)
    scene = Scene(FLOOR, (SceneObject("it", "it", shape),), (state,))
    masses = Masses.of([scene], [StaticParameters.uniform(["it", "room"])])
    x = np.array([0, 0, 50.0]) + np.outer(TIMES, [3, 0, 4.0])
    x[:, 2] -= 0.5 * 9.81 * TIMES**2
    half = np.outer(TIMES, spin) / 2
    angle = np.linalg.norm(half, axis=1, keepdims=True)
    q = np.concatenate([half * np.sinc(angle / np.pi), np.cos(angle)], axis=1)
    return masses, x[None, None], q[None, None]


@pytest.mark.parametrize(
    ("shape", "spin"),
    [(Sphere(0.1), (20.0, -30.0, 10.0)), (Box((0.1, 0.2, 0.3)), (0.0, 0.0, 40.0))],
    ids=["sphere", "box"],
)
def test_free_flight_gains_no_energy(shape, spin):
    assert largest_gains(*flight(shape, spin), held=True)[0] < 1e-9


def test_energy_that_is_made_in_flight_is_found():
    masses, x, q = flight(Sphere(0.1))
    # From 2 s on it goes on at (1 + 1e-3) times its velocity along x.
    later = TIMES >= 2.0
    x[0, 0, later, 0] += 3e-3 * (TIMES[later] - 2.0)
    there = 0.5 * 25.0 + 9.81 * 50.0
    np.testing.assert_allclose(largest_gains(masses, x, q, held=False), 9e-3 / there, rtol=2e-3)


def test_what_is_lifted_out_of_the_floor_gains_energy():
    masses, x, q = flight(Sphere(0.1))
    x[..., :] = 0.0, 0.0, 0.1
    x[0, 0, TIMES >= 1.0, 2] += 1e-3
    masses = replace(masses, starts=np.zeros_like(masses.starts))
    masses.starts[..., 2], masses.starts[..., 6] = 0.1, 1.0
    np.testing.assert_allclose(largest_gains(masses, x, q, held=True), 1e-2, rtol=1e-3)


def at_rest(*placed) -> tuple[list[Scene], np.ndarray, np.ndarray]:
    """A scene of (shape, position, orientation) that stay: scenes, and poses at two times."""
    objects = tuple(SceneObject(f"o{k}", "it", shape) for k, (shape, _, _) in enumerate(placed))
    states = tuple(ObjectState(position, turn) for _, position, turn in placed)
    x = np.array([[[position] * 2 for _, position, _ in placed]], dtype=float)
    q = np.array([[[turn] * 2 for _, _, turn in placed]], dtype=float)
    return [Scene(FLOOR, objects, states)], x, q


BALL, CUBE, ROD = Sphere(0.1), Box((0.2, 0.2, 0.2)), Capsule(0.05, 0.4)
DIAGONAL = 0.1 * np.sqrt(2.0)  # from the middle of the cube to its edge


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ((BALL, UPRIGHT), (BALL, (0.197, 0, 0), UPRIGHT), 3e-3),
        ((BALL, UPRIGHT), (BALL, (0.201, 0, 0), UPRIGHT), -1e-3),
        ((CUBE, UPRIGHT), (BALL, (0.0, 0.1995, 0), ON_EDGE), 5e-4),
        ((CUBE, UPRIGHT), (BALL, (0.17, 0.17, 0), UPRIGHT), 0.1 - 0.07 * np.sqrt(2.0)),
        ((CUBE, UPRIGHT), (CUBE, (0.1, 0.198, 0.05), UPRIGHT), 2e-3),
        ((CUBE, UPRIGHT), (CUBE, (0.1 + DIAGONAL - 4e-3, 0, 0), ON_EDGE), 4e-3),
        ((CUBE, UPRIGHT), (ROD, (0.0, 0.3, 0.148), ALONG_X), -0.05),
        ((CUBE, UPRIGHT), (ROD, (0.25, 0.05, 0.148), ALONG_X), 2e-3),
        ((ROD, UPRIGHT), (ROD, (0.05, 0.097, 0.1), ALONG_X), 3e-3),
        ((ROD, UPRIGHT), (BALL, (0.0, 0.0, 0.345), UPRIGHT), 5e-3),
    ],
)
def test_depths_of_pairs(one, other, expected):
    scenes, x, q = at_rest((one[0], (0.0, 0.0, 0.0), one[1]), other)
    x[..., 2] += 5.0
    found = find_overlaps(scenes, x, q)
    np.testing.assert_allclose(found.in_objects, max(expected, 0.0), atol=1e-9)
    assert found.missed[0] == (expected > 1e-3)
    swapped = find_overlaps(*at_rest(other, (one[0], (0.0, 0.0, 0.0), one[1])))
    np.testing.assert_allclose(swapped.in_objects, max(expected, 0.0), atol=1e-9)


def test_crossed_edges_of_boxes_are_told_apart():
    # Two long beams, both on their edges, cross at right angles: only the cross product of their
    # edges is an axis along which a gap between them shows.
    beam = np.array([0.05, 0.05, 1.0])
    turned = np.eye(3)
    turned[:2, :2] = np.array([[1, -1], [1, 1]]) / np.sqrt(2.0)
    along_x = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    gap = 2 * 0.05 * np.sqrt(2.0)
    axes = np.stack([along_x @ turned, np.roll(np.eye(3), 2, axis=0) @ turned])
    # The first beam lies along x, the second along y; both have an edge up and an edge down.
    assert [np.abs(own[:, 2]).argmax() for own in axes] == [0, 1]
    for depth in (2e-3, -2e-3):
        a, b = (
            Solid(beam[None], np.zeros(1), np.array([[0, 0, z]]), axis[None])
            for z, axis in zip((0.0, gap - depth), axes, strict=True)
        )
        np.testing.assert_allclose(depths(a, b), depth, atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "height", "turn", "deep"),
    [
        (BALL, 0.098, UPRIGHT, 2e-3),
        (CUBE, DIAGONAL - 3e-3, (np.sin(np.pi / 8), 0.0, 0.0, np.cos(np.pi / 8)), 3e-3),
        (ROD, 0.245, UPRIGHT, 5e-3),
        (ROD, 0.051, ALONG_X, 0.0),
    ],
)
def test_depths_in_a_plane(shape, height, turn, deep):
    found = find_overlaps(*at_rest((shape, (0.3, 0.2, height), turn)))
    np.testing.assert_allclose(found.in_planes, deep, atol=1e-9)
    assert found.missed[0] == (deep > 1e-3)


def test_a_centre_behind_a_plane_is_a_missed_contact():
    scenes, x, q = at_rest((BALL, (0.0, 0.0, -5.0), UPRIGHT))
    assert find_overlaps(scenes, x, q).missed[0] == 1
    x[:], q[:] = np.nan, np.nan
    nothing = find_overlaps(scenes, x, q)
    assert (nothing.missed[0], nothing.deepest[0]) == (0, 0.0)
