"""On-line learning: θ_s improves in the background as observations arrive.

`OnlineLearner` learns from observations that it is given; `StoredOnlineLearning` from those of a
store, in the calling process; `background_learning` in a process of its own.
"""

from intuitive_physics_learner.online.lone_fit import LoneFit
from intuitive_physics_learner.online.online_learner import OnlineLearner
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.online.options import OnlineOptions
from intuitive_physics_learner.online.stored_online_learning import StoredOnlineLearning

__all__ = ["LoneFit", "OnlineLearner", "OnlineOptions", "OnlineState", "StoredOnlineLearning"]
