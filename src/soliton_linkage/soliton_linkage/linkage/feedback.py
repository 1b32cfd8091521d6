# SPDX-License-Identifier: Apache-2.0
"""Parameters of the motor controllers that compute torques from measured angles."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.linkage.quantities import CheckedQuantities, document_fields, quantity

_LARGEST_GAIN = 1e6
"""Largest allowed absolute value of a gain, in the unit of the gain."""
MOST_FRAMES_OF_DELAY = 1000
"""Largest allowed delay [frames], which is one second at 1000 frames per second."""


def _gain(of: str, unit: str) -> float:
    description = f'feedback gain of {of}'
    gain: float = quantity(0.0, description, unit, -_LARGEST_GAIN, _LARGEST_GAIN)
    return gain


@document_fields
@dataclass(frozen=True)
class Feedback(CheckedQuantities):
    """Gains, delay and torque limit of the feedback law in `motor_controllers`.

    Raises ValueError for values out of range.
    """

    angle: float = _gain('the coordinate of the own rotor', 'N m/rad')
    rate: float = _gain('the rate of the own rotor', 'N m s/rad')
    left_angle: float = _gain('the coordinate of the left neighbour', 'N m/rad')
    right_angle: float = _gain('the coordinate of the right neighbour', 'N m/rad')
    left_rate: float = _gain('the rate of the left neighbour', 'N m s/rad')
    right_rate: float = _gain('the rate of the right neighbour', 'N m s/rad')
    reference: float = quantity(
        0.0, 'coordinate at which the gain of the own rotor gives no torque', 'rad', -10.0, 10.0
    )
    delay: int = quantity(
        0, 'frames from a measurement to its torque', 'frames', 0, MOST_FRAMES_OF_DELAY
    )
    limit: float = quantity(0.1, 'largest torque of each motor', 'N m', 0.0, 1e6)

    @property
    def acts(self) -> bool:
        """Whether at least one gain differs from 0, so that the motors exert torques."""
        gains = self.angle, self.left_angle, self.right_angle
        return any((*gains, self.rate, self.left_rate, self.right_rate))


NO_FEEDBACK = Feedback()
