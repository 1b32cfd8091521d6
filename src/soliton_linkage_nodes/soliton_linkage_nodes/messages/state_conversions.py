# SPDX-License-Identifier: Apache-2.0
"""What an analysis found, as a SolitonState: as its bytes, as a message, as a row of a table."""

from __future__ import annotations

import math
import struct
import sys
from functools import lru_cache
from operator import attrgetter
from typing import Any

from rclpy.serialization import deserialize_message

from soliton_linkage.estimation.analyser import Analysis
from soliton_linkage.estimation.orbit_filter import TrackingStatus
from soliton_linkage.estimation.state_report import EdgeRotors, Topology
from soliton_linkage.linkage.chain import Motion
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.joint_states import JointStates

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
_WOBBLE_OF = {
    'amplitude': 'amplitude',
    'amplitude_at_rest': 'rest_amplitude',
    'decay_length': 'decay_length',
    'theory_decay_length': 'exact_decay_length',
    'wavelength': 'wavelength',
    'theory_wavelength': 'exact_wavelength',
    'amplitude_deviation': 'amplitude_deviation',
    'decay_length_deviation': 'decay_length_deviation',
    'wavelength_deviation': 'wavelength_deviation',
}


def _names(message_type: Any) -> tuple[str, ...]:
    return tuple(message_type.get_fields_and_field_types())


def _format(message_type: Any) -> str:
    """Format of a message of plain numbers."""
    return ''.join(_FORMATS[kind] for kind in message_type.get_fields_and_field_types().values())


_NESTED = ('cycle', 'topology', 'energies', 'wobble')
_NESTED_TYPES = (msg.Cycle, msg.Topology, msg.Energies, msg.Wobble)
_SOLITON = _format(msg.Soliton)
_FOLLOWING = ''.join(map(_format, _NESTED_TYPES)) + 'ddI'

_soliton = attrgetter(*_names(msg.Soliton))
_cycle = attrgetter(
    *('estimate.place' if name == 'rotor' else f'cycle.{name}' for name in _names(msg.Cycle))
)
_energies = attrgetter(*_names(msg.Energies))
_wobble = attrgetter(*(_WOBBLE_OF[name] for name in _names(msg.Wobble)))
_rest = attrgetter('estimate.noise', 'estimate.misfit', 'unseen')
_NO_ENERGIES = len(_names(msg.Energies)) * (math.nan,)
_NO_WOBBLE = len(_names(msg.Wobble)) * (math.nan,)
_NO_SOLITON = len(_names(msg.Soliton)) * (math.nan,)
_NO_TOPOLOGY = (0, 0, math.nan, math.nan, 0, math.nan)
_NO_EDGES = (False, False, math.nan, math.nan)


def serialized_state(analysis: Analysis, joints: JointStates) -> bytes:
    """SolitonState of the frame that was analysed, as CDR bytes.

    CDR places numbers at multiples of their size from the end of the encapsulation header, as
    the machine does in a struct; a string is its length with the final zero, and its bytes, a
    sequence its count and its elements.
    """
    frame_id = joints.frame_id.encode() + b'\x00'
    motion, motion_name, *measured = _leading(analysis)
    name = motion_name.encode() + b'\x00'
    solitons = [value for soliton in analysis.solitons for value in _soliton(soliton)]
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
    """Names of the columns of a table of states: those of the fields of SolitonState.

    Fields of the nested messages have the name of theirs before them, those of the first
    soliton `soliton_`.
    """
    names = ['stamp_ns']
    for name in _names(msg.SolitonState)[1:]:
        nested = dict(zip(_NESTED, _NESTED_TYPES, strict=True)).get(name)
        names += [name] if nested is None else [f'{name}_{each}' for each in _names(nested)]
        if name == 'solitons':
            names += [f'soliton_{each}' for each in _names(msg.Soliton)]
    return names


def row(analysis: Analysis, joints: JointStates) -> tuple[Any, ...]:
    """A state as a row of the table; the soliton's cells are NaN where there is none."""
    solitons = analysis.solitons
    first = _soliton(solitons[0]) if solitons else _NO_SOLITON
    return (
        joints.stamp,
        *_leading(analysis),
        len(solitons),
        *first,
        *_following(analysis),
    )


@lru_cache(maxsize=64)
def _layout(frame_id: int, motion_name: int, solitons: int) -> struct.Struct:
    """Layout of a state, given the sizes of its strings and the number of its solitons."""
    return struct.Struct(f'@iII{frame_id}sBI{motion_name}sBdBI{solitons * _SOLITON}{_FOLLOWING}')


def _leading(analysis: Analysis) -> tuple[int, str, int, float, int]:
    """Fields of a state between the header and the solitons."""
    motion, measured = analysis.motion, analysis.measured_motion
    return (
        _MOTIONS[motion],
        motion.value if motion else 'unknown',
        _MOTIONS[measured.motion],
        measured.confidence,
        _STATUSES[analysis.estimate.status],
    )


def _following(analysis: Analysis) -> tuple[Any, ...]:
    """Fields of a state after the solitons, those of the nested messages one after the other."""
    energies, wobble = analysis.energies, analysis.wobble
    return (
        *_cycle(analysis),
        *_topology(analysis.topology, analysis.edge_rotors),
        *(_NO_ENERGIES if energies is None else _energies(energies)),
        *(_NO_WOBBLE if wobble is None else _wobble(wobble)),
        *_rest(analysis),
    )


def _topology(topology: Topology | None, edges: EdgeRotors | None) -> tuple[Any, ...]:
    sides, rotors = _NO_TOPOLOGY, _NO_EDGES
    if topology is not None:
        centre = topology.mode_centre
        sides = (*topology.winding_numbers, *topology.polarisations, topology.charge, centre)
    if edges is not None:
        rotors = (*(edges.toggled or (False, False)), *edges.turns)
    return *sides, *rotors
