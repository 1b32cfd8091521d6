# SPDX-License-Identifier: Apache-2.0
"""What an analysis found, as a SolitonState: as its bytes, as a message, as a row of a table."""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Mapping
from functools import lru_cache
from operator import attrgetter
from typing import Any, get_type_hints

from rclpy.serialization import deserialize_message

from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import AnalysedSoliton, TrackingStatus
from soliton_linkage.estimation.state_report import EdgeRotors, Energies, Topology
from soliton_linkage.estimation.wobble import Wobble
from soliton_linkage.linkage.chain import Motion
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import JointStates

_ENCAPSULATION = b'\x00\x01\x00\x00' if sys.byteorder == 'little' else b'\x00\x00\x00\x00'
_FORMATS = {'double': 'd', 'uint8': 'B', 'int8': 'b', 'int32': 'i', 'uint32': 'I', 'boolean': '?'}
_MOTIONS = {
    None: msg.SolitonState.UNKNOWN,
    Motion.FLIPPER: msg.SolitonState.FLIPPER,
    Motion.WOBBLING_FLIPPER: msg.SolitonState.WOBBLING_FLIPPER,
    Motion.SPINNER: msg.SolitonState.SPINNER,
}
_STATUSES = {
    TrackingStatus.LOST: msg.SolitonState.LOST,
    TrackingStatus.ACQUIRED: msg.SolitonState.ACQUIRED,
    TrackingStatus.TRACKING: msg.SolitonState.TRACKING,
    TrackingStatus.COASTING: msg.SolitonState.COASTING,
}


class NumberFields:
    """The fields of a message of plain numbers, two or more, and what fills them.

    Each is filled by the attribute of the same name, or by that whose path is given. Raises
    TypeError where a class has no attribute for a field.
    """

    def __init__(
        self,
        kinds: Mapping[str, str],
        filled_by: type,
        paths: Mapping[str, str] | None = None,
    ) -> None:
        """Fill fields of these kinds, by their name, from instances of a dataclass."""
        self.names = tuple(kinds)
        self.format = ''.join(_FORMATS[kind] for kind in kinds.values())
        """As struct packs them."""
        paths = {name: (paths or {}).get(name, name) for name in kinds}
        for name, path in paths.items():
            _check_path(filled_by, name, path)
        self._values = attrgetter(*paths.values())

    def __call__(self, filled_by: Any) -> tuple[Any, ...]:
        """Values of the fields; NaN where there is nothing to fill them."""
        if filled_by is None:
            return len(self.names) * (math.nan,)
        values: tuple[Any, ...] = self._values(filled_by)
        return values


def _check_path(filled_by: Any, field: str, path: str) -> None:
    for attribute in path.split('.'):
        hints = get_type_hints(filled_by)
        if attribute not in hints and not hasattr(filled_by, attribute):
            raise TypeError(
                f'field {field} of SolitonState has no source: {filled_by.__name__} has no '
                f'{attribute}; add it, or leave it out of the message'
            )
        filled_by = hints.get(attribute)


def _kinds(message_type: Any) -> dict[str, str]:
    """Kind of each field of a message by its name, in their order."""
    return dict(message_type.get_fields_and_field_types())


_STATE = _kinds(msg.SolitonState)
_NESTED = {'cycle': msg.Cycle, 'topology': msg.Topology, 'energies': msg.Energies}
_NESTED['wobble'] = msg.Wobble
_LEADING = ('motion', 'measured_motion', 'measured_motion_confidence', 'status')
_SOLITON = NumberFields(_kinds(msg.Soliton), AnalysedSoliton)
_CYCLE = NumberFields(
    _kinds(msg.Cycle),
    Analysis,
    {name: f'cycle.{name}' for name in _kinds(msg.Cycle)} | {'rotor': 'estimate.place'},
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
    {n: kind for n, kind in _STATE.items() if kind in _FORMATS and n not in _LEADING},
    Analysis,
    {'noise': 'estimate.noise', 'misfit': 'estimate.misfit'},
)
_TOPOLOGY = ''.join(_FORMATS[kind] for kind in _kinds(msg.Topology).values())
_FOLLOWING = f'{_CYCLE.format}{_TOPOLOGY}{_ENERGIES.format}{_WOBBLE.format}{_REST.format}'
_NO_SIDES = (0, 0, math.nan, math.nan, 0, math.nan)
"""Where no topology can be told: the first fields of its message."""
_NO_EDGES = (False, False, math.nan, math.nan)
_ROTORS = 'rotor spacings'
_UNITS = {
    'rotor': _ROTORS,
    'velocity': 'm/s',
    'velocity_deviation': 'm/s',
    'phase': 'rad',
    'phase_deviation': 'rad',
    'rate': 'rad/s',
    'rate_deviation': 'rad/s',
    'zero_mode_rotor': _ROTORS,
    'first_turns': 'turns',
    'last_turns': 'turns',
    'noise': 'rad',
    'misfit': 'rad',
    **dict.fromkeys(('position', 'width', 'theory_width'), 'm'),
    **dict.fromkeys(('position_deviation', 'width_deviation'), 'm'),
    **dict.fromkeys(_ENERGIES.names, 'J'),
    **dict.fromkeys(_WOBBLE.names, 'm'),
}
"""Of the fields of SolitonState and of the messages in it; the others are plain numbers."""


def serialized_state(analysis: Analysis, joints: JointStates) -> bytes:
    """SolitonState of the frame that was analysed, as CDR bytes.

    CDR places numbers at multiples of their size from the end of the encapsulation header, as
    the machine does in a struct; a string is its length with the final zero, and its bytes, a
    sequence its count and its elements.
    """
    frame_id = joints.frame_id.encode() + b'\x00'
    motion, motion_name, *measured = _leading(analysis)
    name = motion_name.encode() + b'\x00'
    solitons = [value for soliton in analysis.solitons for value in _SOLITON(soliton)]
    layout = _layout(len(frame_id), len(name), len(analysis.solitons))
    return _ENCAPSULATION + layout.pack(
        joints.seconds,
        joints.nanoseconds,
        len(frame_id),
        frame_id,
        motion,
        len(name),
        name,
        *measured,
        len(analysis.solitons),
        *solitons,
        *_following(analysis),
    )


def state_to_msg(analysis: Analysis, joints: JointStates) -> msg.SolitonState:
    """SolitonState of the frame that was analysed."""
    return deserialize_message(serialized_state(analysis, joints), msg.SolitonState)


def columns() -> list[str]:
    """Names of the columns of a table of states, those of the fields of SolitonState, with units.

    Fields of the nested messages have the name of theirs before them, those of the first
    soliton `soliton_`, and a unit stands behind in brackets: `soliton_velocity [m/s]`.
    """
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
    """A state as a row of the table; the soliton's cells are NaN where there is none."""
    solitons = analysis.solitons
    return (
        joints.stamp,
        *_leading(analysis),
        len(solitons),
        *_SOLITON(solitons[0] if solitons else None),
        *_following(analysis),
    )


@lru_cache(maxsize=64)
def _layout(frame_id: int, motion_name: int, solitons: int) -> struct.Struct:
    """Layout of a state, given the sizes of its strings and the number of its solitons."""
    return struct.Struct(
        f'@iII{frame_id}sBI{motion_name}sBdBI{solitons * _SOLITON.format}{_FOLLOWING}'
    )


def _leading(analysis: Analysis) -> tuple[int, str, int, float, int]:
    """Fields of a state between the header and the solitons."""
    motion, measured = analysis.motion, analysis.measured_motion
    return (
        _MOTIONS[motion],
        motion.value if motion else 'unknown',
        _MOTIONS[measured.motion],
        measured.confidence,
        _STATUSES[analysis.status],
    )


def _following(analysis: Analysis) -> tuple[Any, ...]:
    """Fields of a state after the solitons, those of the nested messages one after the other."""
    return (
        *_CYCLE(analysis),
        *_topology(analysis.topology, analysis.edge_rotors),
        *_ENERGIES(analysis.energies),
        *_WOBBLE(analysis.wobble),
        *_REST(analysis),
    )


def _topology(topology: Topology | None, edges: EdgeRotors | None) -> tuple[Any, ...]:
    sides, rotors = _NO_SIDES, _NO_EDGES
    if topology is not None:
        centre = topology.mode_centre
        sides = (*topology.winding_numbers, *topology.polarisations, topology.charge, centre)
    if edges is not None:
        rotors = (*(edges.toggled or (False, False)), *edges.turns)
    return *sides, *rotors
