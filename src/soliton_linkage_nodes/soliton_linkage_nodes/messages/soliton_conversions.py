# SPDX-License-Identifier: Apache-2.0
"""The solitons of a SolitonState, as what an analysis tells of walls."""

from __future__ import annotations

from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage_msgs import msg


def solitons_from_msg(message: msg.SolitonState) -> tuple[AnalysedSoliton, ...]:
    """Return the solitons of a message."""
    return tuple(
        AnalysedSoliton(*(getattr(soliton, name) for name in AnalysedSoliton._fields))
        for soliton in message.solitons
    )
