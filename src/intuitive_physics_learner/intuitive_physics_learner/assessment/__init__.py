"""Observations of disturbed or mistracked motions: found by laws that hold for every θ_s."""

from intuitive_physics_learner.assessment.assessment import assess_observations, reassessed

__all__ = ["assess_observations", "reassessed"]
