"""Dynamic parameters θ_d = {x, q, ẋ, ω} of one object (Eq. 2), with their covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.validation import (
    covariance_matrix,
    finite_array,
    set_fields,
    unit_quaternion,
)

ERROR_SIZE = 12
"""Components of the deviation of a state, which are the axes of its covariance."""

POSITION = slice(0, 3)
"""Components of a state's deviation that are the position's, m."""

ROTATION = slice(3, 6)
"""Deviation of the orientation, a rotation vector in the environment's frame, rad."""

LINEAR_VELOCITY = slice(6, 9)
"""Deviation of the linear velocity, m/s."""

ANGULAR_VELOCITY = slice(9, 12)
"""Deviation of the angular velocity, rad/s."""


@dataclass(frozen=True, eq=False)
class ObjectState:
    """θ_d: pose and twist of an object's centre, all in the environment's frame.

    Parameters
    ----------
    position : (3,) m
    orientation : (4,) unit quaternion (x, y, z, w), body to environment
    linear_velocity : (3,) m/s
    angular_velocity : (3,) rad/s, in the environment's frame (not the body's)
    covariance : (12, 12), order: position, rotation vector, linear velocity, angular velocity;
        all zeros where the state is known exactly
    """

    position: NDArray[np.float64]
    orientation: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    linear_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    covariance: NDArray[np.float64] = field(
        default_factory=lambda: np.zeros((ERROR_SIZE, ERROR_SIZE))
    )

    def __init__(
        self,
        position: ArrayLike,
        orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0),
        linear_velocity: ArrayLike = (0.0, 0.0, 0.0),
        angular_velocity: ArrayLike = (0.0, 0.0, 0.0),
        covariance: ArrayLike | None = None,
    ) -> None:
        if covariance is None:
            checked = np.zeros((ERROR_SIZE, ERROR_SIZE))
        else:
            checked = covariance_matrix(covariance, "state covariance", ERROR_SIZE)
        set_fields(
            self,
            position=finite_array(position, "position", (3,)),
            orientation=unit_quaternion(orientation, "orientation"),
            linear_velocity=finite_array(linear_velocity, "linear velocity", (3,)),
            angular_velocity=finite_array(angular_velocity, "angular velocity", (3,)),
            covariance=checked,
        )

    def with_covariance(self, covariance: ArrayLike) -> ObjectState:
        """Return the same state with another covariance.

        Parameters
        ----------
        covariance : (12, 12), in the order of `ObjectState`
        """
        return replace(self, covariance=np.asarray(covariance))

    def to_vector(self) -> NDArray[np.float64]:
        """Return the state without its covariance as one array.

        Returns
        -------
        array
            (13,): position (m), orientation (x, y, z, w), linear velocity (m/s), angular velocity
            (rad/s)
        """
        return np.concatenate(
            [self.position, self.orientation, self.linear_velocity, self.angular_velocity]
        )

    @staticmethod
    def from_vector(vector: ArrayLike, covariance: ArrayLike | None = None) -> ObjectState:
        """Read what `to_vector` wrote.

        Parameters
        ----------
        vector : (13,) in the units of `to_vector`
        covariance : (12, 12); None where the state is known exactly
        """
        v = finite_array(vector, "state vector", (13,))
        return ObjectState(v[0:3], v[3:7], v[7:10], v[10:13], covariance)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that `from_dict` reads."""
        return {
            "position": self.position.tolist(),
            "orientation": self.orientation.tolist(),
            "linear_velocity": self.linear_velocity.tolist(),
            "angular_velocity": self.angular_velocity.tolist(),
            "covariance": self.covariance.ravel().tolist(),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> ObjectState:
        """Read what `to_dict` wrote."""
        try:
            covariance = np.reshape(data["covariance"], (ERROR_SIZE, ERROR_SIZE))
            return ObjectState(
                data["position"],
                data["orientation"],
                data["linear_velocity"],
                data["angular_velocity"],
                covariance,
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"object state lacks {error}; expected position, orientation, "
                "linear_velocity, angular_velocity, covariance"
            ) from None
