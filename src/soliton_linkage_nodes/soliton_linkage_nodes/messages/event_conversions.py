# SPDX-License-Identifier: Apache-2.0
"""What happened to walls, as SolitonEvents and as rows of a table."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Header

from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import EventKind, SolitonEvent
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

KINDS = {kind: getattr(msg.SolitonEvent, kind.name) for kind in EventKind}
"""Numbers of the kinds of events in messages."""
EVENT_COLUMNS = (
    'stamp [ns]',
    'time [ns]',
    'kind_name',
    'rotor [rotor spacings]',
    'position [m]',
    'ids_before',
    'ids_after',
    'charge_before',
    'charge_after',
    'energy_before [J]',
    'energy_after [J]',
    'collisions',
)
"""Columns of a table of events; names of walls are apart by spaces."""


def events_to_msgs(
    analysis: Analysis, joints: JointStates, spacing: float
) -> list[msg.SolitonEvent]:
    """SolitonEvents of a frame that was analysed, of a chain with a spacing [m]."""
    if not analysis.events:
        return []
    stamp = time_to_msg(joints.stamp)
    return [
        msg.SolitonEvent(
            header=Header(stamp=stamp, frame_id=joints.frame_id),
            time=time_to_msg(_instant(analysis, joints, event)),
            kind=KINDS[event.kind],
            kind_name=event.kind.value,
            position=event.rotor * spacing,
            rotor=event.rotor,
            ids_before=event.ids_before,
            ids_after=event.ids_after,
            charge_before=event.charge_before,
            charge_after=event.charge_after,
            energy_before=event.energy_before,
            energy_after=event.energy_after,
            collisions=event.collisions,
        )
        for event in analysis.events
    ]


def event_rows(analysis: Analysis, joints: JointStates, spacing: float) -> list[tuple[Any, ...]]:
    """The same events as rows of the table."""
    return [
        (
            joints.stamp,
            _instant(analysis, joints, event),
            event.kind.value,
            event.rotor,
            event.rotor * spacing,
            ' '.join(map(str, event.ids_before)),
            ' '.join(map(str, event.ids_after)),
            event.charge_before,
            event.charge_after,
            event.energy_before,
            event.energy_after,
            event.collisions,
        )
        for event in analysis.events
    ]


def _instant(analysis: Analysis, joints: JointStates, event: SolitonEvent) -> int:
    """When an event happened, by the clock of the frames [ns]."""
    return joints.stamp - round((analysis.estimate.time - event.time) * SECOND)
