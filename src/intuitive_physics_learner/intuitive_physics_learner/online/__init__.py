"""On-line learning: θ_s improves in the background as observations arrive.

`OnlineLearner(simulator).learn_from(observation)` learns in the calling process and returns what is
published; `StoredOnlineLearning` does so from a store; `background_learning` in a process of its
own.
"""

from intuitive_physics_learner.online.lone_fit import LoneFit
from intuitive_physics_learner.online.online_learner import OnlineLearner
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.stored_online_learning import StoredOnlineLearning

__all__ = ["LoneFit", "OnlineLearner", "OnlineOptions", "OnlineState", "StoredOnlineLearning"]
