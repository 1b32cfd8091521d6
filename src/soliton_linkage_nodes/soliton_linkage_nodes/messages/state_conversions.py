# SPDX-License-Identifier: Apache-2.0
"""Conversion of analyses to messages and table rows, and of messages to solitons."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from operator import attrgetter
from typing import Any, get_type_hints

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import (
    AnalysedSoliton,
    EventKind,
    SolitonEvent,
    TrackingStatus,
)
from soliton_linkage.estimation.state_report import EdgeRotors, Energies, Topology
from soliton_linkage.estimation.wobble import Wobble
from soliton_linkage.linkage.chain import Motion
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

_NUMBERS = ('double', 'uint8', 'int8', 'int32', 'uint32', 'boolean')
_MOTIONS: dict[Motion | None, int] = {None: msg.SolitonState.UNKNOWN} | {
    motion: getattr(msg.SolitonState, motion.name) for motion in Motion
}
_STATUSES = {status: getattr(msg.SolitonState, status.name) for status in TrackingStatus}


class NumberFields:
    """Mapping from the attributes of an object to the fields of a message.

    If an attribute has another name than its field, `paths` maps the field to the attribute, for
    example 'rotor' to 'estimate.site'.
    """

    def __init__(
        self, names: Iterable[str], filled_by: type, paths: Mapping[str, str] | None = None
    ) -> None:
        self.names = tuple(names)
        paths = {name: (paths or {}).get(name, name) for name in names}
        for name, path in paths.items():
            _check_path(filled_by, name, path)
        self._values = attrgetter(*paths.values())

    def __call__(self, filled_by: Any) -> tuple[Any, ...]:
        """Return the values of all fields from an object. For None, all values are NaN."""
        if filled_by is None:
            return len(self.names) * (math.nan,)
        values: tuple[Any, ...] = self._values(filled_by)
        return values

    def message(self, kind: Any, filled_by: Any) -> Any:
        """Return a message of the type `kind` with the values of an object."""
        return kind(**dict(zip(self.names, self(filled_by), strict=True)))


def _check_path(filled_by: Any, field: str, path: str) -> None:
    for attribute in path.split('.'):
        hints = get_type_hints(filled_by)
        if attribute not in hints and not hasattr(filled_by, attribute):
            raise TypeError(
                f'field {field} of SolitonState has no source: {filled_by.__name__} has no '
                f'{attribute}; add the attribute or remove the field from the message'
            )
        filled_by = hints.get(attribute)


def _kinds(message_type: Any) -> dict[str, str]:
    return dict(message_type.get_fields_and_field_types())


_STATE = _kinds(msg.SolitonState)
_NESTED = {'cycle': msg.Cycle, 'topology': msg.Topology, 'energies': msg.Energies}
_NESTED['wobble'] = msg.Wobble
_LEADING = ('motion', 'motion_name', 'measured_motion', 'measured_motion_confidence', 'status')
_SOLITON = NumberFields(_kinds(msg.Soliton), AnalysedSoliton)
_CYCLE = NumberFields(
    _kinds(msg.Cycle),
    Analysis,
    {name: f'cycle.{name}' for name in _kinds(msg.Cycle)} | {'rotor': 'estimate.site'},
)
_ENERGIES = NumberFields(_kinds(msg.Energies), Energies)
_WOBBLE = NumberFields(
    _kinds(msg.Wobble),
    Wobble,
    {
        'amplitude_at_rest': 'rest_amplitude',
        'theory_decay_length': 'exact_decay_length',
        'theory_wavelength': 'exact_wavelength',
    },
)
_REST = NumberFields(
    [name for name, kind in _STATE.items() if kind in _NUMBERS and name not in _LEADING],
    Analysis,
    {'noise': 'estimate.noise', 'misfit': 'estimate.misfit'},
)
_NO_SIDES = (0, 0, math.nan, math.nan, 0, math.nan)
"""Values of the first six fields of a Topology message if the topology is unknown."""
_NO_EDGES = (False, False, math.nan, math.nan)
_UNITS = {
    **dict.fromkeys(('rotor', 'zero_mode_rotor'), 'rotor spacings'),
    **dict.fromkeys(('velocity', 'velocity_deviation'), 'm/s'),
    **dict.fromkeys(('phase', 'phase_deviation', 'noise', 'misfit'), 'rad'),
    **dict.fromkeys(('rate', 'rate_deviation'), 'rad/s'),
    **dict.fromkeys(('first_turns', 'last_turns'), 'turns'),
    **dict.fromkeys(('position', 'width', 'theory_width'), 'm'),
    **dict.fromkeys(('position_deviation', 'width_deviation'), 'm'),
    **dict.fromkeys(_ENERGIES.names, 'J'),
    **dict.fromkeys(_WOBBLE.names, 'm'),
}


def state_to_msg(analysis: Analysis, joints: JointStates) -> msg.SolitonState:
    """Return the message that contains the analysis of the frame `joints`."""
    stamp = Time(sec=joints.seconds, nanosec=joints.nanoseconds)
    topology = _topology(analysis.topology, analysis.edge_rotors)
    motion, measured = analysis.motion, analysis.measured_motion
    return msg.SolitonState(
        header=Header(stamp=stamp, frame_id=joints.frame_id),
        motion=_MOTIONS[motion],
        motion_name=motion.value if motion else 'unknown',
        measured_motion=_MOTIONS[measured.motion],
        measured_motion_confidence=measured.confidence,
        status=_STATUSES[analysis.status],
        solitons=[_SOLITON.message(msg.Soliton, each) for each in analysis.solitons],
        cycle=_CYCLE.message(msg.Cycle, analysis),
        topology=msg.Topology(**dict(zip(_kinds(msg.Topology), topology, strict=True))),
        energies=_ENERGIES.message(msg.Energies, analysis.energies),
        wobble=_WOBBLE.message(msg.Wobble, analysis.wobble),
        **dict(zip(_REST.names, _REST(analysis), strict=True)),
    )


def columns() -> list[str]:
    """Return the column names of a table of states, for example `soliton_velocity [m/s]`."""
    names = ['stamp [ns]']
    for name in list(_STATE)[1:]:
        if name in _NESTED:
            names += [_column(name, each) for each in _kinds(_NESTED[name])]
        else:
            names.append(_column('', name))
        if name == 'solitons':
            names += [_column('soliton', each) for each in _SOLITON.names]
    return names


def _column(message: str, field: str) -> str:
    unit = f' [{_UNITS[field]}]' if field in _UNITS else ''
    return f'{message}_{field}{unit}' if message else f'{field}{unit}'


def row(analysis: Analysis, joints: JointStates) -> tuple[Any, ...]:
    """Return an analysis as a row of the table.

    The columns `soliton_...` describe the first soliton. Without solitons they are NaN.
    """
    message, solitons = state_to_msg(analysis, joints), analysis.solitons
    cells: list[Any] = [joints.stamp]
    for name in list(_STATE)[1:]:
        value = getattr(message, name)
        if name == 'solitons':
            cells += [len(solitons), *_SOLITON(solitons[0] if solitons else None)]
        elif name in _NESTED:
            cells += [getattr(value, each) for each in _kinds(_NESTED[name])]
        else:
            cells.append(value)
    return tuple(cells)


def _topology(topology: Topology | None, edges: EdgeRotors | None) -> tuple[Any, ...]:
    sides, rotors = _NO_SIDES, _NO_EDGES
    if topology is not None:
        centre = topology.mode_centre
        sides = (*topology.winding_numbers, *topology.polarisations, topology.charge, centre)
    if edges is not None:
        rotors = (*(edges.toggled or (False, False)), *edges.turns)
    return *sides, *rotors


def solitons_from_msg(message: msg.SolitonState) -> tuple[AnalysedSoliton, ...]:
    """Return the solitons of a message."""
    return tuple(
        AnalysedSoliton(*(getattr(soliton, name) for name in AnalysedSoliton._fields))
        for soliton in message.solitons
    )


KINDS = {kind: getattr(msg.SolitonEvent, kind.name) for kind in EventKind}
_EVENT_FIELDS = (
    *('rotor', 'ids_before', 'ids_after', 'charge_before', 'charge_after'),
    *('energy_before', 'energy_after', 'collisions'),
)
EVENT_COLUMNS = (
    *('stamp [ns]', 'time [ns]', 'kind_name', 'rotor [rotor spacings]', 'position [m]'),
    *('ids_before', 'ids_after', 'charge_before', 'charge_after'),
    *('energy_before [J]', 'energy_after [J]', 'collisions'),
)
"""Column names of a table with one event per row. Spaces separate the wall ids in a cell."""


def events_to_msgs(
    analysis: Analysis, joints: JointStates, spacing: float
) -> list[msg.SolitonEvent]:
    """Return one message per event of a frame. `spacing` is the distance of the pivots [m]."""
    return [
        msg.SolitonEvent(
            header=Header(stamp=time_to_msg(joints.stamp), frame_id=joints.frame_id),
            time=time_to_msg(_instant(analysis, joints, event)),
            kind=KINDS[event.kind],
            kind_name=event.kind.value,
            position=event.rotor * spacing,
            **{name: getattr(event, name) for name in _EVENT_FIELDS},
        )
        for event in analysis.events
    ]


def event_rows(analysis: Analysis, joints: JointStates, spacing: float) -> list[tuple[Any, ...]]:
    """Return one table row per event of a frame. `spacing` is the distance of the pivots [m]."""
    rows = []
    for event in analysis.events:
        rotor, *others = (getattr(event, name) for name in _EVENT_FIELDS)
        cells = (' '.join(map(str, each)) if isinstance(each, tuple) else each for each in others)
        instant = _instant(analysis, joints, event)
        rows.append((joints.stamp, instant, event.kind.value, rotor, rotor * spacing, *cells))
    return rows


def _instant(analysis: Analysis, joints: JointStates, event: SolitonEvent) -> int:
    """Return the time of an event [ns] on the clock of the stamps in joint_states."""
    return joints.stamp - round((analysis.estimate.time - event.time) * SECOND)
