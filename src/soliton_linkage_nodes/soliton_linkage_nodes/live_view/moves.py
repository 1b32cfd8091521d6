# SPDX-License-Identifier: Apache-2.0
"""Moves of the soliton: progress and outcome."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages import view_conversions as views

UNDER_WAY = 'under way'
"""State of a move that has not ended."""
_HELD = (MoveSoliton.Result.REACHED, MoveSoliton.Result.CANCELLED)
"""Outcomes after which the soliton is held."""


@dataclass
class Move:
    """The last move of the soliton, requested by this page or by another client."""

    state: str = ''
    """Empty before the first move, then UNDER_WAY, or the outcome."""
    goal: float = math.nan
    """Goal [rotor spacings]."""
    start: float = math.nan
    """Initial site coordinate of the soliton [rotor spacings]."""
    rotor: float = math.nan
    """Current site coordinate of the soliton [rotor spacings]."""
    message: str = ''
    foreign: bool = False
    """Whether another client requested the move."""
    ended_at: float = math.inf
    """Time of the outcome on the monotonic clock [s]."""
    handle: Any = field(default=None, repr=False)

    @property
    def under_way(self) -> bool:
        """Whether the move has not ended."""
        return self.state == UNDER_WAY

    @property
    def held(self) -> bool:
        """Whether the soliton is held where the move ended."""
        return self.state in (views.OUTCOMES[code] for code in _HELD)

    @property
    def progress(self) -> float:
        """Completed fraction of the distance, 0 to 1."""
        distance = self.goal - self.start
        if not (math.isfinite(distance) and math.isfinite(self.rotor) and distance):
            return 0.0
        return min(max((self.rotor - self.start) / distance, 0.0), 1.0)


def await_end(move: Move, handle: Any) -> None:
    """Set the outcome of a move from the result of its goal."""
    if handle is not None and handle.accepted:
        move.handle = handle
        handle.get_result_async().add_done_callback(lambda done: _conclude(move, done.result()))


def _conclude(move: Move, ended: Any) -> None:
    result = ended.result
    move.message, move.rotor, move.ended_at = result.message, result.rotor, time.monotonic()
    move.state = views.OUTCOMES.get(result.outcome, f'outcome {result.outcome}')
