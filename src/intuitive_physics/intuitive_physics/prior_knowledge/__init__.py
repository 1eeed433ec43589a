"""Knowledge besides the observations: from the user, from other pairs, from earlier throws."""

from intuitive_physics.prior_knowledge.given_knowledge import GivenKnowledge
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread
from intuitive_physics.prior_knowledge.pair_prior import PairPriorSettings, with_pair_prior

__all__ = ["GivenKnowledge", "InitialSpins", "PairPriorSettings", "SpinSpread", "with_pair_prior"]
