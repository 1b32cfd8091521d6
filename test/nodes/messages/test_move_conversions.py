# SPDX-License-Identifier: Apache-2.0
"""Each end of a move has a code of its own, and what is told comes through."""

from __future__ import annotations

from soliton_linkage.steering.steering import Ended, Outcome
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages.move_conversions import move_result_to_msg


def test_an_outcome_is_the_constant_of_its_name() -> None:
    for outcome in Outcome:
        result = move_result_to_msg(Ended(outcome, 'why', 2.5))
        name = 'CANCELLED' if outcome is Outcome.STOPPED else outcome.name
        assert result.outcome == getattr(MoveSoliton.Result, name)
        assert (result.message, result.rotor) == ('why', 2.5)
