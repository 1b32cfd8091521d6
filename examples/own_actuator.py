# SPDX-License-Identifier: Apache-2.0
"""An actuator of one's own: a voice coil, whose torque follows the current without delay.

It runs the edge actuator's node with it, whose parameters are then those of the coil too:

    python3 examples/own_actuator.py --ros-args -p actuator:=voice_coil -p largest_current:=2.0
"""

import math
from dataclasses import dataclass

from soliton_linkage.actuation import ACTUATORS, Profile
from soliton_linkage.linkage.quantities import check_quantities, quantity


@dataclass(frozen=True)
class VoiceCoil:
    """Commands and levels are currents [A]; the torque is proportional to them."""

    torque_per_current: float = quantity(
        5e-3, 'torque along the unit zero mode that a current gives', 'N m/A', 1e-9
    )
    largest_current: float = quantity(1.0, 'largest current either way', 'A', 0.0)

    def __post_init__(self) -> None:
        """Refuse parameters out of their range."""
        check_quantities(self)

    def check_command(self, current: float) -> None:
        """Raise ValueError for a current [A] that cannot be asked for."""
        if not (math.isfinite(current) and abs(current) <= self.largest_current):
            raise ValueError(
                f'current = {current:g} A must be at most {self.largest_current:g} A either way; '
                'ask for less, or change largest_current'
            )

    def response(
        self, current: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Current at an instant [A], which is the commanded one, and its integral [A s]."""
        return float(command.before(end)), float(command.integral(start, end))

    def torque(self, current: float) -> float:
        """Torque of a current [N m]."""
        return self.torque_per_current * current

    def is_saturated(self, current: float) -> bool:
        """Whether a current gives less torque than in proportion to a small one."""
        return False

    def pulse_command(self, impulse: float, duration: float) -> float:
        """Current [A] that gives an impulse [N m s] if it lasts for a duration [s]."""
        return impulse / (self.torque_per_current * duration)


ACTUATORS['voice_coil'] = VoiceCoil


def main() -> None:
    """Run the node, which finds the coil by its name."""
    from soliton_linkage_nodes.edge_actuator import node

    node.main()


if __name__ == '__main__':
    main()
