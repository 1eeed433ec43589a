"""Estimating θ_s and the initial states of all observations together, by damped Gauss-Newton steps.

The initial states are nuisance parameters: only θ_s is wanted, but the error of an initial state
that was measured from three noisy points moves a trajectory by metres. Given θ_s, the observations
depend on nothing in common, so their initial states are eliminated one observation at a time (as
points are in bundle adjustment) and what is left is a small problem in θ_s.

`docs/method/joint_estimation.md` derives it; its sections are the modules here: from the unknowns
and points (`observation_blocks`) over their slopes (`linearisation`), the elimination
(`normal_equations`), how far trajectories are fitted (`fit_horizons`) and all of these at one
estimate (`trajectory_model`) to what leaves local optima (`scans`), a step (`joint_fit`), and fits
from several starts (`several_starts`).
"""

from intuitive_physics_learner.joint_estimation.joint_fit import JointEstimationSettings

__all__ = ["JointEstimationSettings"]
