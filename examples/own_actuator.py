# SPDX-License-Identifier: Apache-2.0
"""Custom actuator: a voice coil, whose torque follows the current without delay.

Run the edge actuator node with this actuator; the node declares the parameters of the coil:

    python3 examples/own_actuator.py --ros-args -p actuator:=voice_coil -p largest_current:=2.0
"""

import math
from dataclasses import dataclass

from soliton_linkage.actuation import ACTUATORS, Profile
from soliton_linkage.linkage.quantities import check_quantities, quantity


@dataclass(frozen=True)
class VoiceCoil:
    """Voice coil, whose torque is proportional to the current; its commands are currents [A]."""

    torque_per_current: float = quantity(
        5e-3, 'torque along the unit zero mode per current', 'N m/A', 1e-9
    )
    largest_current: float = quantity(1.0, 'largest absolute current', 'A', 0.0)

    def __post_init__(self) -> None:
        """Reject parameters out of their range."""
        check_quantities(self)

    def check_command(self, current: float) -> None:
        """Raise ValueError if a current [A] exceeds the limit."""
        if not (math.isfinite(current) and abs(current) <= self.largest_current):
            raise ValueError(
                f'current = {current:g} A must be at most {self.largest_current:g} A in '
                'absolute value; command a lower current, or change largest_current'
            )

    def response(
        self, current: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Return the commanded current [A] at `end`, and its integral since `start` [A s]."""
        return float(command.before(end)), float(command.integral(start, end))

    def torque(self, current: float) -> float:
        """Return the torque of a current [N m]."""
        return self.torque_per_current * current

    def is_saturated(self, current: float) -> bool:
        """Return False, because a voice coil never saturates."""
        return False

    def pulse_command(self, impulse: float, duration: float) -> float:
        """Return the current [A] that delivers an impulse [N m s] in a duration [s]."""
        return impulse / (self.torque_per_current * duration)


ACTUATORS['voice_coil'] = VoiceCoil


def main() -> None:
    """Run the node, which looks up the coil by its name."""
    from soliton_linkage_nodes import start

    start.edge_actuator()


if __name__ == '__main__':
    main()
