"""The cost J(θ_s), evaluated on one machine or many."""
