"""The predictor node as a process, against its clock, other engines and the truth."""
