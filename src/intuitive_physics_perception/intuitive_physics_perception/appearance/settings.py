"""Tuned numbers of how spin is seen, each with its unit and meaning.

All were set on rendered balls, by `make bench-perception options="--only looks"`.
"""

from __future__ import annotations

from dataclasses import dataclass

from intuitive_physics.settings import check_settings, number


@dataclass(frozen=True)
class AppearanceSettings:
    """How the rotation of a ball is found from what is painted on it."""

    cells: int = number(32, 8, 64, "cells along each edge of the image of a sphere")
    min_readings: int = number(
        90, 20, 100000, "readings with a colour that an image of a sphere needs at least"
    )
    frames: int = number(
        12,
        3,
        30,
        "images of a flight that are compared at most: the first, the newest, and of the "
        "others those that leave the smallest gaps",
    )
    search_frames: int = number(
        8, 3, 30, "newest images of a flight in which a spin is searched that is not known"
    )
    max_spin: float = number(
        150.0,
        1.0,
        10000.0,
        "fastest angular velocity that is looked for; more than half a turn from frame to frame, "
        "94 rad/s at 30 Hz, looks like a turn the other way",
        unit="rad/s",
    )
    search_step: float = number(
        0.3,
        0.2,
        1.0,
        "distance of the rotations from one image to another that are tried",
        unit="rad",
    )
    candidates: int = number(4, 1, 50, "rotations that are refined, the best of those tried")
    contrast: float = number(
        2.5,
        1.0,
        100.0,
        "standard deviation of the brightness of a surface, less shading, in those of the noise of "
        "a pixel, below which it is plain",
    )
    likelihood: float = number(
        40.0,
        0.0,
        1000.0,
        "logarithm of how much likelier the images must be than without a common pattern: the best "
        "of 10,000 rotations reaches 9 by chance",
    )
    lead: float = number(
        0.75,
        0.0,
        1.0,
        "part of that logarithm that any other rotation may have: with more there are two "
        "explanations, and the spin is unknown",
    )
    agreement: float = number(
        0.84, 0.0, 1.0, "correlation of the images of a flight that is at least needed"
    )
    alignment_deviation: float = number(
        0.012,
        0.0,
        1.0,
        "standard deviation of the angle by which an image is off, as its cells and the pattern's "
        "edges are no finer",
        unit="rad",
    )
    light_slope: float = number(
        0.3,
        0.0,
        10.0,
        "slope of the logarithm of brightness that light and shade leave after smooth ones are "
        "taken out, and which stands still",
        unit="1/rad",
    )
    light_turn: float = number(
        0.3,
        0.0,
        100.0,
        "standard deviation of the angular velocity with which light and highlights seem to turn "
        "with a plain ball",
        unit="rad/s",
    )
    highlight_turn: float = number(
        0.3,
        0.0,
        10.0,
        "the same of a highlight, as a part of the angular velocity of the line of sight",
    )
    standing_gate: float = number(
        25.0,
        0.0,
        1000.0,
        "squared angular velocity, in variances, that a pattern must have: what stands still in "
        "the room, or goes with the line of sight, may be light",
    )

    def __post_init__(self) -> None:
        check_settings(self)
