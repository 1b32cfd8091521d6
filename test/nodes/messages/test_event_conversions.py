# SPDX-License-Identifier: Apache-2.0
"""Events as messages say what the analysis does."""

from __future__ import annotations

from soliton_linkage.estimation.estimates import EventKind
from soliton_linkage_msgs.msg import SolitonEvent
from soliton_linkage_nodes.messages.event_conversions import KINDS


def test_each_kind_has_a_number_of_its_own() -> None:
    assert sorted(KINDS.values()) == list(range(len(EventKind)))
    assert KINDS[EventKind.PASSING] == SolitonEvent.PASSING
