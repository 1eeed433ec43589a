"""Settings refuse what they cannot be and say why."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.settings import KnownObject, PerceptionSettings

NUMBERS = [setting for setting in fields(PerceptionSettings) if "lower" in setting.metadata]


def test_every_setting_is_described() -> None:
    assert all(setting.metadata["description"] for setting in fields(PerceptionSettings))


@pytest.mark.parametrize("setting", NUMBERS, ids=lambda setting: setting.name)
@pytest.mark.parametrize("bad", ["below", "above", np.nan, "many"])
def test_numbers_outside_their_range_are_refused(setting, bad) -> None:
    value = {
        "below": setting.metadata["lower"] - 1.0,
        "above": setting.metadata["upper"] + 1.0,
    }.get(bad, bad)
    with pytest.raises(InvalidInputError, match=setting.name):
        replace(PerceptionSettings(), **{setting.name: value})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"min_radius": 0.5}, "min_radius below max_radius"),
        ({"max_range": 0.1, "min_range": 0.2}, "min_range below max_range"),
        ({"min_points": 20.5}, "whole number"),
        ({"object_material": " "}, "object_material"),
        ({"estimate_noise": 1}, "true or false"),
        ({"up_hint": (0.0, 0.0, 0.0)}, "up_hint"),
        ({"known_objects": (KnownObject("a", 0.1, "m"), KnownObject("a", 0.2, "m"))}, "each name"),
        ({"gravity_source": "up_hint"}, "there is no up_hint"),
        ({"gravity_source": "moon"}, "one of plane, up_hint, imu"),
        ({"solids_are_objects": True, "find_solids": False}, "expected find_solids true"),
        ({"known_objects": ("ball",)}, "expected a KnownObject"),
    ],
)
def test_contradictions_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        PerceptionSettings(**changes)


def test_a_hint_is_scaled_to_one() -> None:
    assert PerceptionSettings(up_hint=(0.0, 0.0, 4.0)).up_hint == (0.0, 0.0, 1.0)


def test_a_known_object_has_a_radius() -> None:
    with pytest.raises(InvalidInputError, match="radius of known object ball"):
        KnownObject("ball", -0.1, "rubber")
