"""What is known of θ_s besides the observations: what a user gave, and what other pairs suggest."""
