# SPDX-License-Identifier: Apache-2.0
"""Moves of the soliton by soliton_steering, and pulls of a rotor with the pointer (mouse)."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages import view_conversions as views

UNDER_WAY = 'under way'
_HELD = (MoveSoliton.Result.REACHED, MoveSoliton.Result.CANCELLED)
"""Outcomes of a move after which soliton_steering holds the soliton."""
_ACCELERATION = 200.0
"""Largest angular acceleration that a pull would give to a rotor without springs [rad/s^2]. This
rotor would reach 10 rad/s in 0.05 s."""
_STRETCH = 1.0
"""Angle between rotor and pointer above which the spring torque of a pull is constant [rad]."""
_TOP_SPEED = 20.0
"""Angular speed of the rotor at which the damping torque of a pull equals the largest spring
torque [rad/s]."""
_DEAD_ZONE = 0.2
"""Radius of the circle around the pivot in which the pointer causes no torque [rotor lengths]."""


@dataclass
class Move:
    """Last move of the soliton, which this page or another client has requested."""

    state: str = ''
    """Name of the outcome, UNDER_WAY during the move, or '' before the first move."""
    goal: float = math.nan
    """Site coordinate of the goal [rotor spacings]."""
    start: float = math.nan
    rotor: float = math.nan
    message: str = ''
    foreign: bool = False
    ended_at: float = math.inf
    """End of the move on the monotonic clock [s]; infinite before the end."""
    handle: Any = field(default=None, repr=False)

    @property
    def under_way(self) -> bool:
        """Whether the move is in progress."""
        return self.state == UNDER_WAY

    @property
    def held(self) -> bool:
        """Whether soliton_steering holds the soliton where the move ended."""
        return self.state in (views.OUTCOMES[code] for code in _HELD)

    @property
    def progress(self) -> float:
        """Completed fraction of the distance from start to goal [1]."""
        distance = self.goal - self.start
        if not (math.isfinite(distance) and math.isfinite(self.rotor) and distance):
            return 0.0
        return min(max((self.rotor - self.start) / distance, 0.0), 1.0)


def await_end(move: Move, handle: Any) -> None:
    """Store the outcome in `move` as soon as the goal with this handle has a result."""
    if handle is not None and handle.accepted:
        move.handle = handle
        handle.get_result_async().add_done_callback(lambda done: _conclude(move, done.result()))


def _conclude(move: Move, ended: Any) -> None:
    result = ended.result
    move.message, move.rotor, move.ended_at = result.message, result.rotor, time.monotonic()
    move.state = views.OUTCOMES.get(result.outcome, f'outcome {result.outcome}')


@dataclass
class Pull:
    """Pull of one rotor towards the pointer by the torque of a damped torsion spring.

    The spring torque is proportional to the angle between rotor and pointer, up to 1 rad. Two
    limits apply to the torque: the limit of the actuator, and the torque that would accelerate a
    rotor without springs by 200 rad/s^2.
    """

    rotor: int
    x: float
    """Coordinate of the pointer along the chain from the first pivot [m]."""
    z: float
    """Height of the pointer above the pivots [m]."""
    held: bool = True
    """Whether the user still pulls the rotor."""

    def point_to(self, x: float, z: float) -> None:
        """Set the coordinates of the pointer [m]. Raises ValueError if one is not finite."""
        if not (math.isfinite(x) and math.isfinite(z)):
            raise ValueError(f'position ({x}, {z}) m of the pointer must be finite')
        self.x, self.z = float(x), float(z)

    def torque(self, chain: Chain, angles: Array, rates: Array | None, limit: float) -> float:
        """Return the torque on the pulled rotor, between -`limit` and `limit` [N m].

        `angles` [rad] and `rates` [rad/s] have one element per rotor. Without `rates`, the spring
        is not damped.
        """
        pivot = float(np.sum(chain.spacings[: self.rotor]))
        length = float(chain.rotor_lengths[self.rotor])
        angle = float(angles[self.rotor])
        if math.hypot(self.x - pivot, self.z) < _DEAD_ZONE * length or not math.isfinite(angle):
            return 0.0
        stretch = math.remainder(math.atan2(self.x - pivot, self.z) - angle, math.tau)
        rate = 0.0 if rates is None else float(rates[self.rotor])
        inertia = float(chain.masses[self.rotor]) * length**2
        largest = min(limit, _ACCELERATION * inertia)
        share = max(-1.0, min(1.0, stretch / _STRETCH)) - rate / _TOP_SPEED
        return largest * max(-1.0, min(1.0, share))
