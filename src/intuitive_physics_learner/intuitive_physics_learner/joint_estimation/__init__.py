"""Estimating θ_s and the initial states of all observations together, by damped Gauss-Newton steps.

The initial states are nuisance parameters: only θ_s is wanted, but the error of an initial state
that was measured from three noisy points moves a trajectory by metres. Given θ_s, the observations
depend on nothing in common, so their initial states are eliminated one observation at a time (as
points are in bundle adjustment) and what is left is a small problem in θ_s.

`docs/method/joint_estimation.md` derives it; its sections are the modules here, from the points
(`observation_blocks`, `point_noise`) over a step (`linearisation`, `normal_equations`, `joint_fit`)
to the order of fits (`staged_fit`, `several_starts`, `joint_search`) and what they have determined
(`joint_identifiability`).
"""

from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings
from intuitive_physics_learner.joint_estimation.joint_search import JointSearch

__all__ = ["JointEstimationSettings", "JointSearch"]
