# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to numbers and texts for displays, and of user input to messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rclpy.parameter import Parameter, parameter_value_to_python
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_msgs import msg
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.runtime.parameters import (
    LARGEST_INTEGER,
    limits,
    type_complaint,
)
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

Numbers = dict[str, float]

OUTCOMES = {
    getattr(MoveSoliton.Result, name): name.lower().replace('_', ' ')
    for name in (
        *('REACHED', 'CANCELLED', 'OUT_OF_REACH', 'NO_SOLITON'),
        *('SOLITON_LOST', 'NOT_HELD', 'INVALID_SPEED'),
    )
} | {
    MoveSoliton.Result.OUT_OF_CHAIN: 'outside the chain',
    MoveSoliton.Result.PREEMPTED: 'replaced by another goal',
}
"""Text for each outcome of the action that moves a soliton."""
STATES = {
    name: getattr(Reset.Request, name.upper().replace('-', '_'))
    for name in ('initial', 'left-leaning', 'right-leaning', 'soliton', 'angles')
}
_CHOICES = {
    'edge': ('nearest', 'first', 'last'),
    'kind': ('kick', 'pulse', 'pressure', 'waveform'),
    'shape': ('burst', 'chirp', 'noise'),
    'quantity': ('torque', 'angle'),
}
_CODES = {
    field: {name: getattr(msg.EdgeCommand, name.upper()) for name in names}
    for field, names in _CHOICES.items()
}
KICK_UNITS = {'kick': 'rad/s', 'pulse': 'N m', 'pressure': 'Pa', 'waveform': 'N m'}
"""Unit of the field `value` for each kind of edge command. For a waveform with the quantity
'angle', the unit is rad instead."""
_KINDS: Mapping[int, type[bool | int | float | str]] = {
    ParameterType.PARAMETER_BOOL: bool,
    ParameterType.PARAMETER_INTEGER: int,
    ParameterType.PARAMETER_DOUBLE: float,
    ParameterType.PARAMETER_STRING: str,
}
_SOLITON = (
    *('rotor', 'position', 'position_deviation', 'velocity', 'velocity_deviation', 'width'),
)
_CYCLE = ('phase', 'phase_deviation', 'completed', 'leg')
_TOPOLOGY = (
    *('winding_before', 'winding_beyond', 'polarisation_before', 'polarisation_beyond'),
    *('charge', 'zero_mode_rotor', 'first_toggled', 'last_toggled', 'first_turns', 'last_turns'),
)


@dataclass(frozen=True)
class NodeReport:
    """Latest report of a node on /diagnostics."""

    node: str
    """Full name of the node: the value of the field `hardware_id` of the report or, if this is
    empty, the value of the field `name` up to the first colon."""
    level: int
    """Level of the report: 0 OK, 1 warning, 2 error, 3 stale."""
    message: str
    figures: Mapping[str, str]

    @property
    def ok(self) -> bool:
        """Whether the level of the report is OK."""
        return self.level == 0


@dataclass(frozen=True)
class AdjustableParameter:
    """Parameter that can be changed while its node is running."""

    name: str
    kind: type[bool | int | float | str]
    value: bool | int | float | str
    description: str
    range: Quantity


def state_numbers(message: msg.SolitonState) -> Numbers:
    """Return the numbers that describe a state and its first soliton, by name.

    Unknown numbers are NaN.
    """
    first = message.solitons[0] if message.solitons else None
    cycle, energies = message.cycle, message.energies
    return {
        'state_stamp': time_from_msg(message.header.stamp) / SECOND,
        'walls': len(message.solitons),
        **{name: getattr(first, name, math.nan) for name in _SOLITON},
        'wall_charge': getattr(first, 'charge', math.nan),
        **{name: getattr(message, name) for name in ('motion', 'status', 'misfit', 'unseen')},
        **{name: getattr(cycle, name) for name in _CYCLE},
        'phase_rate': cycle.rate,
        'cycle_rotor': cycle.rotor,
        'kinetic': energies.kinetic,
        'elastic': energies.elastic,
        'wall_energy': energies.wall,
        'wake_energy': energies.wake,
        **{name: getattr(message.topology, name) for name in _TOPOLOGY},
    }


def reports_from_msg(message: DiagnosticArray) -> list[NodeReport]:
    """Return the node reports of a diagnostics message."""
    return [
        NodeReport(
            status.hardware_id or status.name.partition(':')[0],
            _level(status),
            status.message,
            {pair.key: pair.value for pair in status.values},
        )
        for status in message.status
    ]


def figure(figures: Mapping[str, str], name: str) -> float:
    """Return a value of a report as a number; NaN if the value is missing or not finite."""
    try:
        value = float(figures.get(name, 'nan'))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def number_to_msg(value: float) -> Float64:
    """Return a message with a number, such as a nudge [rad/s] or a tilt [rad]."""
    return Float64(data=_finite('value', value))


def torque_to_msg(joint: str, torque: float) -> JointState:
    """Return the command that applies a torque [N m] to a joint."""
    return JointState(name=[joint], effort=[torque])


def edge_command_of(
    kind: str,
    edge: str,
    value: float,
    duration: float,
    ramp_up: float,
    ramp_down: float,
    *,
    shape: str = 'burst',
    quantity: str = 'torque',
    **numbers: float,
) -> msg.EdgeCommand:
    """Return the message of a command to an edge actuator.

    `kind` is 'kick', 'pressure', 'pulse' or 'waveform'. `edge` is 'first', 'last' or 'nearest',
    the edge that is nearer to the zero-energy mode. The unit of `value` is [rad/s] for a kick,
    [N m] for a pulse and [Pa] for a pressure. For a waveform it is [N m] or, if `quantity` is
    'angle', [rad]. The unit of all times is [s]. Only waveforms use `shape`, `quantity` and the
    additional fields `numbers`. Raises ValueError if a name is unknown or a number is not finite.
    """
    names = {'kind': kind, 'edge': edge, 'shape': shape, 'quantity': quantity}
    numbers |= {'value': value, 'duration': duration, 'ramp_up': ramp_up, 'ramp_down': ramp_down}
    return msg.EdgeCommand(
        **{field: _chosen(field, name, _CODES[field]) for field, name in names.items()},
        **{field: _finite(field, number) for field, number in numbers.items()},
    )


def reset_request(
    state: str, rotor: float, velocity: float, joints: Mapping[str, float] | None = None
) -> Reset.Request:
    """Return a request to reset the chain to a named state.

    Only the state 'soliton' uses `rotor` [rotor spacings] and `velocity` [m/s], and only the state
    'angles' uses the angles of `joints` [rad].
    """
    named = joints or {}
    return Reset.Request(
        state=_chosen('state', state, STATES),
        rotor=_finite('rotor', rotor),
        velocity=_finite('velocity', velocity),
        name=list(named),
        angle=[_finite(f'angle of {name}', angle) for name, angle in named.items()],
    )


def step_request(periods: float) -> Step.Request:
    """Return a request to advance a paused simulation by a number of publishing periods.

    Raises ValueError if the number is not a positive integer.
    """
    if not (_finite('periods', periods) == int(periods) and 1 <= periods < 2**32):
        raise ValueError(f'periods = {periods} must be a whole number of 1 or more')
    return Step.Request(periods=int(periods))


def topics_of(kick: msg.LastKick | None) -> set[str]:
    """Return the topics of the commands of a kick, without their namespaces."""
    return {each.rpartition('/')[2] for each in kick.source.split(', ')} if kick else set()


def describe_kick(kick: msg.LastKick) -> str:
    """Describe the effect of a kick. Raises ValueError if the kick was not executed."""
    if kick.cut_short and not kick.name:
        raise ValueError('the simulator did not execute the command; see its log')
    command = kick.command
    edge = next((e for e, code in _CODES['edge'].items() if code == command.edge), 'nearest')
    kind = next((k for k, code in _CODES['kind'].items() if code == command.kind), 'kick')
    lasting = f' for {kick.duration:.3g} s' if kick.duration else ''
    peak = f', up to {kick.peak_torque:.3g} N m' if kick.peak_torque else ''
    imposed = kind == 'waveform' and command.quantity == msg.EdgeCommand.ANGLE
    unit, where = 'rad' if imposed else KICK_UNITS[kind], command.joint or f'the {edge} edge'
    what = f'a {kind} of {command.value:g} {unit}{lasting} at {where}{peak}'
    if not command.value:
        what = f'torques on {", ".join(kick.name) or "no joint"}{lasting}{peak}'
    parts = [
        what,
        f'an impulse of {math.hypot(*kick.impulse):.3g} N m s and a work of {kick.work:.3g} J, '
        + ('measured by the simulator' if kick.measured else 'estimated by the actuator'),
    ]
    parts += ['less than requested, because the actuator saturated'] if kick.saturated else []
    parts += ['ended early'] if kick.cut_short else []
    return '; '.join(parts)


def move_goal(rotor: float, speed: float) -> MoveSoliton.Goal:
    """Return a goal: a site coordinate [rotor spacings] and a speed [rotor spacings/s]."""
    return MoveSoliton.Goal(rotor=_finite('rotor', rotor), speed=_finite('speed', speed))


def is_adjustable(descriptor: ParameterDescriptor) -> bool:
    """Return whether a parameter can change at run time and has a supported type."""
    own = descriptor.name != 'use_sim_time' and not descriptor.name.startswith('qos_overrides.')
    return bool(own and not descriptor.read_only and descriptor.type in _KINDS)


def adjustable_parameters(
    descriptors: Sequence[ParameterDescriptor], values: Sequence[ParameterValue]
) -> list[AdjustableParameter]:
    """Return the adjustable parameters. Descriptors and values must have the same order."""
    return [
        AdjustableParameter(
            each.name,
            _KINDS[each.type],
            parameter_value_to_python(value),
            each.description,
            limits(each),
        )
        for each, value in zip(descriptors, values, strict=False)
    ]


def parameter_value(parameter: AdjustableParameter, value: Any) -> ParameterValue:
    """Return the message that sets a parameter to a value.

    Raises ValueError if the value has the wrong type or is out of range.
    """
    kind = parameter.kind
    type_ = Parameter.Type.from_parameter_value(kind())
    try:
        converted = kind(value)
        # A message carries only integers of 64 bits.
        fits = kind is not int or (
            float(converted) == float(value) and abs(int(converted)) <= LARGEST_INTEGER
        )
    except (TypeError, ValueError, OverflowError):
        fits = False
    complaint = parameter.range.complaint(converted) if fits else type_complaint(type_, None)
    if complaint:
        raise ValueError(f'parameter {parameter.name} = {value!r} {complaint}; set another value')
    return Parameter(parameter.name, type_, converted).get_parameter_value()


def _level(status: DiagnosticStatus) -> int:
    level = status.level
    return level[0] if isinstance(level, bytes) else int(level)


def _finite(name: str, value: float | str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f'{name} = {value!r} must be a number')
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f'{name} = {number} must be a finite number')
    return number


def _chosen(name: str, value: str, known: Mapping[str, int]) -> int:
    if value not in known:
        raise ValueError(f'{name} = {value!r} must be one of {", ".join(known)}')
    return known[value]
