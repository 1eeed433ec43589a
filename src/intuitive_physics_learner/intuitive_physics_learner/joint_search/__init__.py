"""The search that is the joint fit: how long it goes on, and what it has determined.

`joint_search` takes the steps of the fits (`joint_estimation`) as a search, `identifiability` says
how well they know θ_s, and `cost_descent` lowers J where trajectories cannot be fitted.
"""

from intuitive_physics_learner.joint_search.joint_search import JointSearch

__all__ = ["JointSearch"]
