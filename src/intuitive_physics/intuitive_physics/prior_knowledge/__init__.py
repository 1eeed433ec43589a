"""What is known of θ_s besides the observations: what a user gave, and what other pairs suggest."""

from intuitive_physics.prior_knowledge.given_knowledge import GivenKnowledge
from intuitive_physics.prior_knowledge.pair_prior import PairPriorSettings, with_pair_prior

__all__ = ["GivenKnowledge", "PairPriorSettings", "with_pair_prior"]
