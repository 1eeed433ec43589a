"""Noisy Newton (Sec. III-E): simulate many times from noisy copies of the perceived state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.prior_knowledge.initial_spins import unknown_spin
from intuitive_physics.scene import Scene
from intuitive_physics.simulation import Simulator, WorldStatus, make_simulator, pack_worlds
from intuitive_physics.simulation.contact_noise import ContactNoise
from intuitive_physics.simulation.world_batch import WorldBatch
from intuitive_physics.state import ERROR_SIZE
from intuitive_physics_predictor.distribution import TrajectoryDistribution
from intuitive_physics_predictor.estimation.unknowns import PLACE
from intuitive_physics_predictor.estimation.weighted_states import WeightedStates
from intuitive_physics_predictor.noise import (
    StateNoise,
    StateSpread,
    draw_sizes,
    with_spin_prior,
)
from intuitive_physics_predictor.outside import condition_on_outside, objects_inside
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

DEFAULT_SAMPLE_COUNT = 20
"""Samples a prediction, as in the paper (Sec. IV-D)."""


class PredictionFailedError(IntuitivePhysicsError):
    """No sample could be simulated to the end."""


def predict(
    scene: Scene,
    static_parameters: StaticParameters | UncertainParameters,
    times: ArrayLike,
    *,
    rng: np.random.Generator,
    sample_count: int = DEFAULT_SAMPLE_COUNT,
    noise: StateNoise | None = None,
    size_noise: float = 0.0,
    contact_noise: ContactNoise | None = None,
    simulator: Simulator | None = None,
    orientations: bool = False,
) -> TrajectoryDistribution:
    """Predict where the objects of a scene will be.

    Parameters
    ----------
    scene : environment and objects with their perceived states and covariances
    static_parameters : θ_s of at least the scene's materials, known or drawn for each sample
    times : (n_times,) s after the states, strictly increasing, none negative
    rng : source of the noise; the same state of it gives the same answer
    sample_count : simulations, all in one call of the simulator
    noise : on the states; default: that of the perceived covariances
    size_noise : relative standard deviation of the objects' dimensions, one factor an object
    contact_noise : by which one impact differs from the next; default: none
    simulator : engine; default: auto
    orientations : whether to predict them too, which takes longer

    Returns
    -------
    TrajectoryDistribution
        Of all samples that could be simulated to the end, with equal weights, and the number of
        those that could not.

    Raises
    ------
    InvalidInputError, UnknownNameError, UnsupportedSceneError
        As `Simulator.rollout`.
    PredictionFailedError
        When no sample could be simulated to the end.
    """
    prepared = PreparedScene.of(scene, static_parameters, noise or StateNoise())
    worlds = prepared.sampled(sample_count, rng, size_noise, contact_noise)
    engine = simulator or make_simulator("auto")
    return predict_sampled(scene, worlds, times, simulator=engine, orientations=orientations)


@dataclass(frozen=True, eq=False)
class PreparedScene:
    """Parts that all samples of a scene share, for many predictions.

    Parameters
    ----------
    scene : as perceived
    static_parameters : θ_s, known or drawn for each sample
    world : the scene packed, a batch of one
    spread : of the objects' states as perceived
    noise : on the states
    estimates : of each object, from all its detections; None where there is only the perceived
        state; empty: of no object
    """

    scene: Scene
    static_parameters: StaticParameters | UncertainParameters
    world: WorldBatch
    spread: StateSpread
    noise: StateNoise
    estimates: tuple[WeightedStates | None, ...] = ()

    @staticmethod
    def of(
        scene: Scene,
        static_parameters: StaticParameters | UncertainParameters,
        noise: StateNoise,
        estimates: tuple[WeightedStates | None, ...] = (),
    ) -> PreparedScene:
        """Prepare a scene; estimates are not used where noise ignores the perceived covariance."""
        parameters, learned = static_parameters, None
        if isinstance(parameters, UncertainParameters):
            learned = parameters.learned
            parameters = learned.parameters
        states = [
            with_spin_prior(state, scene_object, learned, noise.spin_prior, noise.guess_scale)
            for state, scene_object in zip(scene.states, scene.objects, strict=True)
        ]
        spread = StateSpread.of(states, noise)
        world = pack_worlds([scene], parameters)
        used = estimates if noise.perceived else ()
        return PreparedScene(scene, static_parameters, world, spread, noise, used)

    @property
    def guessed(self) -> frozenset[str]:
        """Ids of the objects whose spin is little better known than a guess."""
        estimates = self.estimates or (None,) * len(self.scene.objects)
        return frozenset(
            item.id
            for item, state, estimate in zip(
                self.scene.objects, self.scene.states, estimates, strict=True
            )
            if (unknown_spin(item.shape, state) if estimate is None else estimate.spin_is_guess)
        )

    def sampled(
        self,
        count: int,
        rng: np.random.Generator,
        size_noise: float = 0.0,
        contact_noise: ContactNoise | None = None,
    ) -> WorldBatch:
        """Return `count` copies, each with its own draw of all that is uncertain, as `predict`.

        No object of a copy is inside a surface: see `outside`.
        """
        if count < 1:
            raise InvalidInputError(f"sample count is {count}; expected at least 1")
        world = self.world
        normal = rng.standard_normal((count, len(self.scene.objects), ERROR_SIZE))
        changes: dict[str, Any] = {"states": self.spread.at(normal)}
        if isinstance(self.static_parameters, UncertainParameters):
            changes["density"], changes["coefficients"] = self.static_parameters.draw(count, rng)
            changes["parameter_index"] = np.arange(count, dtype=np.int64)
        self._take_estimates(changes, rng)
        if size_noise != 0.0:
            factors = draw_sizes((count, len(self.scene.objects)), size_noise, rng)[..., None]
            changes["dimensions"] = world.dimensions * factors
            changes["volumes"] = world.volumes * factors[..., 0] ** 3
            changes["unit_inertias"] = world.unit_inertias * factors**5
            # Drag grows with the silhouette, the Magnus force with the silhouette times the radius.
            changes["air_factors"] = world.air_factors * factors ** np.array([2.0, 3.0])
            changes["mass_centres"] = world.mass_centres * factors
        worlds = world.taken(np.zeros(count, dtype=np.int64), **changes)
        condition_on_outside(worlds, self._estimated_spread, normal)
        return worlds.with_contact_noise(contact_noise, rng) if contact_noise else worlds

    @cached_property
    def _estimated_spread(self) -> StateSpread:
        """Normal distribution of the states, as estimated where they are, else as perceived."""
        if all(estimate is None for estimate in self.estimates):
            return self.spread
        states = list(self.scene.states)
        for k, estimate in enumerate(self.estimates):
            if estimate is not None:
                states[k] = estimate.state(states[k].orientation)
        return StateSpread.of(states, self.noise)

    @cached_property
    def _possible_estimates(self) -> tuple[WeightedStates | None, ...]:
        """The estimates given that no object is inside a surface."""
        means = self._estimated_spread.means
        possible: list[WeightedStates | None] = []
        for k, estimate in enumerate(self.estimates):
            if estimate is not None:
                count = len(estimate.values)
                states = np.repeat(means[None], count, axis=0)
                states[:, k, 0:3] = estimate.values[:, PLACE]
                worlds = self.world.taken(np.zeros(count, dtype=np.int64), states=states)
                estimate = estimate.where(~objects_inside(worlds, means)[:, k])
            possible.append(estimate)
        return tuple(possible)

    def _take_estimates(self, changes: dict[str, Any], rng: np.random.Generator) -> None:
        """Put the estimated states in the place of the perceived ones, with the θ_s of each."""
        states = changes["states"]
        for k, estimate in enumerate(self._possible_estimates):
            if estimate is None:
                continue
            motions, units = estimate.draw(len(states), self.noise, rng)
            states[:, k, 0:3], states[:, k, 7:13] = motions[:, 0:3], motions[:, 3:9]
            if "coefficients" in changes:
                estimate.unknowns.parameters.write(
                    units, changes["density"], changes["coefficients"]
                )


def predict_sampled(
    scene: Scene,
    worlds: WorldBatch,
    times: ArrayLike,
    *,
    simulator: Simulator,
    orientations: bool = False,
) -> TrajectoryDistribution:
    """Predict from samples that were drawn of a scene, the same to the bit as `predict`.

    What reaches through a bounded plane from behind is moved out of it.

    Parameters
    ----------
    worlds : samples of the scene
    times : (n_times,) s after the states, strictly increasing, none negative
    """
    rollout = simulator.rollout_batch(worlds, times, orientations=orientations, push_out=True)
    ended = rollout.status == WorldStatus.OK
    if not ended.any():
        raise PredictionFailedError(
            f"none of {worlds.size} samples could be simulated to the end; "
            "check the objects' states, their speeds above all"
        )
    positions, turned = rollout.positions, rollout.orientations
    if not ended.all():
        positions, turned = positions[ended], None if turned is None else turned[ended]
    return TrajectoryDistribution(
        object_ids=tuple(scene_object.id for scene_object in scene.objects),
        times=np.array(times, dtype=np.float64),
        positions=positions,
        weights=np.full(len(positions), 1.0 / len(positions)),
        orientations=turned,
        failed_count=int(worlds.size - len(positions)),
    )
