"""What is known besides the observations: what a user gave, other pairs suggest, earlier throws."""

from intuitive_physics.prior_knowledge.given_knowledge import GivenKnowledge
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread
from intuitive_physics.prior_knowledge.pair_prior import PairPriorSettings, with_pair_prior

__all__ = ["GivenKnowledge", "InitialSpins", "PairPriorSettings", "SpinSpread", "with_pair_prior"]
