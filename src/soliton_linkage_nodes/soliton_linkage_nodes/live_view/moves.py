# SPDX-License-Identifier: Apache-2.0
"""Progress and outcome of the moves of the soliton."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages import view_conversions as views

UNDER_WAY = 'under way'
_HELD = (MoveSoliton.Result.REACHED, MoveSoliton.Result.CANCELLED)
"""Outcomes of a move after which soliton_steering holds the soliton."""


@dataclass
class Move:
    """Last move of the soliton, requested by this page or another client."""

    state: str = ''
    """Name of the outcome, UNDER_WAY during the move, or '' before the first move."""
    goal: float = math.nan
    """Site coordinate of the goal [rotor spacings]."""
    start: float = math.nan
    rotor: float = math.nan
    message: str = ''
    foreign: bool = False
    ended_at: float = math.inf
    """Time of the outcome on the monotonic clock [s], infinite before the outcome."""
    handle: Any = field(default=None, repr=False)

    @property
    def under_way(self) -> bool:
        """Whether the move is in progress."""
        return self.state == UNDER_WAY

    @property
    def held(self) -> bool:
        """Whether the soliton is held at the position at which the move ended."""
        return self.state in (views.OUTCOMES[code] for code in _HELD)

    @property
    def progress(self) -> float:
        """Completed fraction of the distance from start to goal, 0 to 1."""
        distance = self.goal - self.start
        if not (math.isfinite(distance) and math.isfinite(self.rotor) and distance):
            return 0.0
        return min(max((self.rotor - self.start) / distance, 0.0), 1.0)


def await_end(move: Move, handle: Any) -> None:
    """Store the outcome in `move` as soon as the action goal of `handle` has a result."""
    if handle is not None and handle.accepted:
        move.handle = handle
        handle.get_result_async().add_done_callback(lambda done: _conclude(move, done.result()))


def _conclude(move: Move, ended: Any) -> None:
    result = ended.result
    move.message, move.rotor, move.ended_at = result.message, result.rotor, time.monotonic()
    move.state = views.OUTCOMES.get(result.outcome, f'outcome {result.outcome}')
