# SPDX-License-Identifier: Apache-2.0
"""Moves of the soliton: what the steering tells of them, as messages of the action."""

from __future__ import annotations

from soliton_linkage.steering.steering import Ended, Outcome, WallState
from soliton_linkage_msgs.action import MoveSoliton

_OUTCOMES = {
    Outcome.REACHED: MoveSoliton.Result.REACHED,
    Outcome.STOPPED: MoveSoliton.Result.CANCELLED,
    Outcome.PREEMPTED: MoveSoliton.Result.PREEMPTED,
    Outcome.OUT_OF_CHAIN: MoveSoliton.Result.OUT_OF_CHAIN,
    Outcome.OUT_OF_REACH: MoveSoliton.Result.OUT_OF_REACH,
    Outcome.NO_SOLITON: MoveSoliton.Result.NO_SOLITON,
    Outcome.SOLITON_LOST: MoveSoliton.Result.SOLITON_LOST,
    Outcome.NOT_HELD: MoveSoliton.Result.NOT_HELD,
    Outcome.INVALID_SPEED: MoveSoliton.Result.INVALID_SPEED,
}


def move_result_to_msg(ended: Ended) -> MoveSoliton.Result:
    """How a move of the soliton ended, as the result of the action."""
    return MoveSoliton.Result(
        outcome=_OUTCOMES[ended.outcome], message=ended.message, rotor=ended.place
    )


def move_feedback_to_msg(wall: WallState, phonon_energy: float) -> MoveSoliton.Feedback:
    """Where the soliton is on its way, with the energy of the phonons [J]."""
    return MoveSoliton.Feedback(rotor=wall.place, speed=wall.speed, phonon_energy=phonon_energy)
