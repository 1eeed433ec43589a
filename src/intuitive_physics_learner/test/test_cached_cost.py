"""A cost that remembers is the same to the bit and simulates less."""

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.wrapped_costs import CachedCost

MATERIALS = ("ball", "cork", "stone", "floor")


def observed(glides):
    generator = np.random.default_rng(0)
    singles = [glides(generator, 0.5, materials=(name,)) for name in MATERIALS[:3]]
    return [*singles, glides(generator, 0.5, (4, 5), ("ball", "cork"))]


class CountingCost(TrajectoryCost):
    """Counts trials that were simulated."""

    simulated = 0

    def trial_distances(self, trials):
        self.simulated += trials.size
        return super().trial_distances(trials)


def test_same_to_the_bit(glide, glides):
    plain = TrajectoryCost(observed(glides), glide, MATERIALS)
    cached = CachedCost(plain)
    space, generator = ParameterSpace(MATERIALS), np.random.default_rng(1)
    point = generator.random(space.size)
    for _ in range(50):
        candidates = []
        for _ in range(4):
            moved = point.copy()
            moved[generator.integers(space.size)] = generator.random()
            candidates.append(space.to_parameters(moved))
        assert (cached.distances(candidates) == plain.distances(candidates)).all()
        point = space.to_unit(candidates[0])


def test_simulates_only_observations_that_a_change_influences(glide, glides):
    counting = CountingCost(observed(glides), glide, MATERIALS)
    cached = CachedCost(counting)
    theta = StaticParameters.uniform(MATERIALS)
    cached.costs([theta])
    assert counting.simulated == 4
    # Stone is in one observation, cork and floor in two, stone and cork in none.
    cached.costs([theta.with_pair("stone", "floor", restitution=0.1)])
    assert counting.simulated == 5
    cached.costs([theta.with_pair("cork", "floor", restitution=0.1)])
    assert counting.simulated == 7
    cached.costs([theta.with_pair("cork", "stone", restitution=0.1), theta])
    assert counting.simulated == 7
