"""Bayesian experimental design: the most informative throw for a question."""

from intuitive_physics_learner.design.questions import AboutMotion, AboutParameters, Question
from intuitive_physics_learner.design.suggestion import (
    Suggestion,
    SuggestionRequest,
    suggest,
    suggest_from_store,
)
from intuitive_physics_learner.design.throws import (
    Throw,
    ThrownObject,
    ThrowOptions,
    ViewingConditions,
)

__all__ = [
    "AboutMotion",
    "AboutParameters",
    "Question",
    "Suggestion",
    "SuggestionRequest",
    "Throw",
    "ThrowOptions",
    "ThrownObject",
    "ViewingConditions",
    "suggest",
    "suggest_from_store",
]
