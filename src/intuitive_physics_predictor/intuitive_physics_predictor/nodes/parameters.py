"""The predictor node's parameters: the library's options, and what only a node needs."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from intuitive_physics_predictor.live.options import PredictionOptions
from intuitive_physics_predictor.live.prediction_settings import PredictionSettings
from intuitive_physics_ros.parameters import Parameter, setting_parameters

OPTIONS = frozenset(option.name for option in fields(PredictionOptions))
"""Names of the parameters that are options of the library."""

PARAMETERS = [
    Parameter("rate", 100.0, "predictions a second", (0.1, 1000.0), read_only=False),
    Parameter(
        "published_samples",
        200,
        "samples in a message at most; mean and covariance are of all",
        (1, 10_000),
        read_only=False,
    ),
    Parameter(
        "seed",
        0,
        "seed of the next prediction's noise, one more each time",
        (0, 2**31 - 1),
        read_only=False,
    ),
    Parameter("marker_rate", 5.0, "RViz marker messages a second", (0.1, 100.0), read_only=False),
    *setting_parameters(PredictionOptions, read_only=False),
]


def settings_from_parameters(values: dict[str, Any]) -> PredictionSettings:
    """Return the library's settings from the node's parameters by name.

    Raises
    ------
    InvalidInputError
        When horizon, time step and number of samples do not go together.
    """
    return PredictionSettings(PredictionOptions(**{name: values[name] for name in OPTIONS}))
