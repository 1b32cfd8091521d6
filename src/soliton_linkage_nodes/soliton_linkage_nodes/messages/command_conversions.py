# SPDX-License-Identifier: Apache-2.0
"""Conversions between messages and physics types, for commands and reports of their effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from trajectory_msgs.msg import JointTrajectory

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.kick_record import DeliveryTotals, KickReport
from soliton_linkage.actuation.torque_drive import Rotors
from soliton_linkage.actuation.waveform import DrivenQuantity, Waveform, WaveShape, WaveWindow
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain, check_names
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg

_ENUMS = {'edge': Edge, 'kind': CommandKind}
_WAVE_ENUMS = {'quantity': DrivenQuantity, 'shape': WaveShape, 'window': WaveWindow}
_CODES: dict[str, dict[int, Any]] = {
    name: {getattr(msg.EdgeCommand, each.name): each for each in choices}
    for name, choices in (_ENUMS | _WAVE_ENUMS).items()
}
_FIELDS = ('value', 'duration', 'ramp_up', 'ramp_down')
_WAVE_FIELDS = ('joint', 'frequency', 'last_frequency', 'cycles', 'seed')
_DELIVERY = ('impulses', 'work_of_impulses', 'torques_act', 'work_of_torques')


@dataclass(frozen=True)
class JointActuators:
    """Names, rotors and torque limits [N m] of the joints that have an actuator."""

    names: tuple[str, ...]
    rotors: Rotors
    limits: Array

    def checked(self, source: str, names: Sequence[str], torques: Array) -> tuple[Rotors, Array]:
        """Return the rotors of the joints `names`, and their torques [N m].

        The last axis of `torques` has one entry for each name. Raises ValueError if a joint occurs
        twice or has no actuator, if the numbers of names and torques differ, or if a torque is not
        finite or exceeds its limit. `source` is the name of the torques in the error text.
        """
        check_names(source, names)
        index_of = {name: index for index, name in enumerate(self.names)}
        for name in names:
            if name not in index_of:
                raise ValueError(
                    f'{source} names joint {name!r}, which has no actuator; choose from '
                    f'{self.names[0]!r} to {self.names[-1]!r}, or add it to the parameter joints'
                )
        if torques.shape[-1] != len(names):
            raise ValueError(
                f'{source} has {torques.shape[-1]} efforts for {len(names)} joints; give '
                'one effort for each joint'
            )
        order = np.array([index_of[name] for name in names], dtype=np.intp)
        for name, limit, column in zip(names, self.limits[order], torques.T, strict=True):
            worst = np.atleast_1d(column)[np.argmax(~(np.abs(np.atleast_1d(column)) <= limit))]
            if not np.isfinite(worst):
                raise ValueError(f'{source} of {name} = {worst} N m must be a finite number')
            if abs(worst) > limit:
                raise ValueError(
                    f'{source} of {name} = {worst:g} N m must lie in the range {-limit:g} to '
                    f'{limit:g} N m; reduce it or raise the torque limit of the joint'
                )
        return self.rotors[order], torques


def joint_actuators(
    named: NamedChain, names: Sequence[str], limit_of: Callable[[str], float]
) -> JointActuators:
    """Return the actuators of the joints `names`, or of all joints if `names` is empty.

    `limit_of` returns the torque limit of a joint [N m]. Raises ValueError if a joint is unknown.
    """
    chosen = tuple(names) or named.joint_names
    for name in chosen:
        if name not in named.numbers:
            raise ValueError(
                f'parameter joints names {name!r}, which is none of {named.joint_names[0]!r} to '
                f'{named.joint_names[-1]!r}; list joints of the chain'
            )
    return JointActuators(
        chosen,
        np.array([named.numbers[name] for name in chosen], dtype=np.intp),
        np.array([limit_of(name) for name in chosen]),
    )


def edge_command_from_msg(message: msg.EdgeCommand) -> EdgeCommand:
    """Return the command in a message. Raises ValueError if a field is invalid."""
    chosen: dict[str, Any] = {}
    for name, known in _CODES.items():
        code = getattr(message, name)
        if code not in known:
            raise ValueError(f'{name} = {code} must be one of {", ".join(map(str, known))}')
        chosen[name] = known[code]
    edge, kind = chosen.pop('edge'), chosen.pop('kind')
    waveform = None
    if kind is CommandKind.WAVEFORM:
        given = {name: getattr(message, name) for name in _WAVE_FIELDS}
        waveform = Waveform(**chosen, **given, samples=tuple(message.samples))
    numbers = {name: getattr(message, name) for name in _FIELDS}
    return EdgeCommand(edge, kind, **numbers, waveform=waveform)


def edge_command_to_msg(command: EdgeCommand) -> msg.EdgeCommand:
    """Return the message that describes a command to an edge actuator."""
    waveform = command.waveform
    given = {name: _code(command, name) for name in _ENUMS}
    given |= {name: getattr(command, name) for name in _FIELDS}
    if waveform is not None:
        given |= {name: _code(waveform, name) for name in _WAVE_ENUMS}
        given |= {name: getattr(waveform, name) for name in _WAVE_FIELDS}
        given['samples'] = list(waveform.samples)
    return msg.EdgeCommand(**given)


def _code(command: EdgeCommand | Waveform, name: str) -> Any:
    return getattr(msg.EdgeCommand, getattr(command, name).name)


def efforts_from_msg(
    actuators: JointActuators, source: str, message: JointState
) -> tuple[Rotors, Array]:
    """Return the rotors and their torques [N m] in a message.

    Raises ValueError if the message contains positions or velocities, if it names no joint, or if
    `JointActuators.checked` rejects the torques. `source` is the name of the message in the error
    text.
    """
    if message.position or message.velocity:
        raise ValueError(
            f'{source} commands positions or velocities; the actuators accept only effort'
        )
    if not message.name:
        raise ValueError(f'{source} has an empty field name; list the joints of the efforts in it')
    efforts = np.asarray(message.effort, dtype=np.float64)
    return actuators.checked(f'{source}.effort', message.name, efforts)


def efforts_from_array(
    actuators: JointActuators, source: str, message: Float64MultiArray
) -> tuple[Rotors, Array]:
    """Return all rotors that have an actuator, and their torques [N m] in a message.

    Raises ValueError if `JointActuators.checked` rejects the torques. `source` is the name of the
    message in the error text.
    """
    torques = np.asarray(message.data, dtype=np.float64)
    return actuators.checked(f'{source}.data', actuators.names, torques)


def trajectory_from_msg(
    actuators: JointActuators, source: str, message: JointTrajectory
) -> tuple[Rotors, Array, Array]:
    """Return the rotors, times [s] and torques [N m], shape (times, rotors), of a trajectory.

    Raises ValueError if the trajectory names no joint, if a point contains positions, velocities
    or accelerations, if the times are negative or do not increase, or if the torques are invalid
    as in `JointActuators.checked`. `source` is the name of the message in the error text.
    """
    if not message.joint_names:
        raise ValueError(f'{source} has points but no joints; fill joint_names')
    for number, point in enumerate(message.points):
        if len(point.positions) or len(point.velocities) or len(point.accelerations):
            raise ValueError(
                f'point {number} of {source} commands positions, velocities or '
                'accelerations; the actuators accept only effort'
            )
        if len(point.effort) != len(message.joint_names):
            raise ValueError(
                f'point {number} of {source} has {len(point.effort)} efforts for '
                f'{len(message.joint_names)} joints; give one effort for each joint'
            )
    instants = np.array([time_from_msg(point.time_from_start) for point in message.points])
    if instants[0] < 0 or np.any(np.diff(instants) <= 0):
        raise ValueError(
            f'time_from_start of the points of {source} must be 0 or more and increase'
        )
    torques = np.array([point.effort for point in message.points], dtype=np.float64)
    rotors, torques = actuators.checked(f'{source}.points.effort', message.joint_names, torques)
    return rotors, instants / SECOND, torques


def delivery_to_msg(delivered: DeliveryTotals) -> msg.Delivery:
    """Return the message with the totals of impulses and torques since the simulator started."""
    return msg.Delivery(
        header=Header(stamp=time_to_msg(delivered.stamp), frame_id=FRAME),
        **{name: getattr(delivered, name) for name in _DELIVERY},
        impulse_of_torques=delivered.impulse_of_torques.tolist(),
    )


def delivery_from_msg(message: msg.Delivery) -> DeliveryTotals:
    """Return the totals of impulses and torques since the simulator started, from a message."""
    impulse = np.asarray(message.impulse_of_torques, dtype=np.float64)
    totals = {name: getattr(message, name) for name in _DELIVERY}
    stamp = time_from_msg(message.header.stamp)
    return DeliveryTotals(stamp, **totals, impulse_of_torques=impulse)


def last_kick_to_msg(named: NamedChain, kick: KickReport) -> msg.LastKick:
    """Return the message about a finished kick. It lists only joints that received an impulse."""
    acted_on = np.flatnonzero(kick.impulse)
    return msg.LastKick(
        header=Header(stamp=time_to_msg(kick.stamp), frame_id=FRAME),
        source=kick.source,
        command=msg.EdgeCommand() if kick.command is None else edge_command_to_msg(kick.command),
        duration=kick.duration,
        name=[named.joint_names[rotor] for rotor in acted_on],
        impulse=kick.impulse[acted_on].tolist(),
        work=kick.work,
        peak_torque=kick.peak_torque,
        saturated=kick.saturated,
        cut_short=kick.cut_short,
        measured=kick.measured,
    )


@dataclass(frozen=True)
class StampRule:
    """Limits for the stamps of commands. A stamp of 0 means the present time."""

    oldest: float
    """Largest difference between the present time and the stamp of a command that is executed at
    once [s]. If it is 0, `longest` is used instead."""
    longest: float
    """Largest time from now to the end of a command [s]."""

    def check_at_once(self, source: str, stamp: int, now: int) -> None:
        """Check the stamp [ns] of a command that is executed at once, at the time `now` [ns].

        Raises ValueError if the stamp is earlier or later than `now` by more than `oldest` or, if
        `oldest` is 0, by more than `longest`.
        """
        age = self._age(stamp, now)
        limit = self.oldest or self.longest
        if age > limit:
            raise ValueError(
                f'{source} is {age:.3g} s old, the limit is {limit:g} s; send it earlier, or with '
                'stamp 0, which means now, or raise command_timeout'
            )
        if -age > limit:
            raise ValueError(
                f'{source} has a stamp {-age:.3g} s in the future, the limit is {limit:g} s; '
                'synchronise the clocks, or send it with stamp 0, which means now'
            )

    def delay(self, source: str, stamp: int, now: int, duration: float) -> float:
        """Return the time from `now` [ns] to the start of a command [s].

        The time is negative if the start of the command was before `now`. Raises ValueError if the
        command, which lasts `duration` [s], has already ended or ends too late.
        """
        delay = -self._age(stamp, now)
        if delay + duration < 0:
            raise ValueError(
                f'{source} ended {-duration - delay:.3g} s ago; send it earlier, or with stamp 0, '
                'which means now'
            )
        self.check_length(source, max(delay, 0.0) + duration)
        return delay

    def check_length(self, source: str, ends: float) -> None:
        """Raise ValueError if a command ends too late. `ends` is the time until its end [s]."""
        if ends > self.longest:
            raise ValueError(
                f'{source} ends {ends:.3g} s from now, the limit is {self.longest:g} s; send '
                'a shorter command, or raise longest_command'
            )

    @staticmethod
    def _age(stamp: int, now: int) -> float:
        return (now - stamp) / SECOND if stamp else 0.0
