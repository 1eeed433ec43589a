"""Noisy Newton (Sec. III-E): simulate many times from noisy copies of the perceived state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator, WorldStatus, make_simulator, pack_worlds
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.noise import StateNoise, sample_states

DEFAULT_SAMPLE_COUNT = 20
"""Samples a prediction, as in the paper (Sec. IV-D)."""


class PredictionFailedError(IntuitivePhysicsError):
    """No sample could be simulated to the end."""


def predict(
    scene: Scene,
    static_parameters: StaticParameters,
    times: ArrayLike,
    *,
    rng: np.random.Generator,
    sample_count: int = DEFAULT_SAMPLE_COUNT,
    noise: StateNoise | None = None,
    simulator: Simulator | None = None,
) -> TrajectoryDistribution:
    """Predict where the objects of a scene will be.

    Parameters
    ----------
    scene : environment and objects with their perceived states and covariances
    static_parameters : θ_s of at least the scene's materials
    times : (n_times,) s after the states, strictly increasing, none negative
    rng : source of the noise; the same state of it gives the same answer
    sample_count : simulations, all in one call of the simulator
    noise : on the states; default: that of the perceived covariances
    simulator : engine; default: auto

    Returns
    -------
    TrajectoryDistribution
        Of all samples that could be simulated to the end, with equal weights.

    Raises
    ------
    InvalidInputError, UnknownNameError, UnsupportedSceneError
        As `Simulator.rollout`.
    PredictionFailedError
        When no sample could be simulated to the end.
    """
    if sample_count < 1:
        raise InvalidInputError(f"sample count is {sample_count}; expected at least 1")
    engine = simulator or make_simulator("auto")
    states = sample_states(scene.states, noise or StateNoise(), sample_count, rng)
    worlds = pack_worlds([scene], static_parameters).repeated(states)
    rollout = engine.rollout_batch(worlds, times, orientations=False)
    ended = rollout.status == WorldStatus.OK
    if not ended.any():
        raise PredictionFailedError(
            f"none of {sample_count} samples could be simulated to the end; "
            "check the objects' states, their speeds above all"
        )
    positions = rollout.positions if ended.all() else rollout.positions[ended]
    return TrajectoryDistribution(
        object_ids=tuple(thing.id for thing in scene.objects),
        times=np.array(times, dtype=np.float64),
        positions=positions,
        weights=np.full(len(positions), 1.0 / len(positions)),
    )
