"""The search that is the joint fit: how long it goes on, and what it has determined.

`joint_search` takes the steps of the fits (`joint_estimation`) as a search, and `identifiability`
says how well they know θ_s.
"""

from intuitive_physics_learner.joint_search.joint_search import JointSearch

__all__ = ["JointSearch"]
