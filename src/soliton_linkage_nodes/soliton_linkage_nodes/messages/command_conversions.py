# SPDX-License-Identifier: Apache-2.0
"""Commands and what became of them: messages to physics types and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from trajectory_msgs.msg import JointTrajectory

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.kick_record import DeliveryTotals, KickReport
from soliton_linkage.actuation.torque_drive import Rotors
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain, check_names
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg

_EDGES = {getattr(msg.EdgeCommand, edge.name): edge for edge in Edge}
_KINDS = {getattr(msg.EdgeCommand, kind.name): kind for kind in CommandKind}


@dataclass(frozen=True)
class JointActuators:
    """Joints that carry an actuator of their own, and the largest torque of each [N m]."""

    names: tuple[str, ...]
    rotors: Rotors
    limits: Array

    def checked(self, source: str, names: Sequence[str], torques: Array) -> tuple[Rotors, Array]:
        """Rotors of the named joints, and torques [N m] of shape (..., named) within limits.

        Raises ValueError unless each joint is named once and carries an actuator, and each has
        a torque that is finite and within its limit.
        """
        check_names(source, names)
        places = {name: place for place, name in enumerate(self.names)}
        for name in names:
            if name not in places:
                raise ValueError(
                    f'{source} names joint {name!r}, which has no actuator; those of '
                    f'{self.names[0]!r} to {self.names[-1]!r} have, or list it in joints'
                )
        if torques.shape[-1] != len(names):
            raise ValueError(
                f'{source} has {torques.shape[-1]} efforts for {len(names)} joints; give each '
                'one effort'
            )
        order = np.array([places[name] for name in names], dtype=np.intp)
        for name, limit, column in zip(names, self.limits[order], torques.T, strict=True):
            worst = np.atleast_1d(column)[np.argmax(~(np.abs(np.atleast_1d(column)) <= limit))]
            if not np.isfinite(worst):
                raise ValueError(f'{source} of {name} = {worst} N m must be a finite number')
            if abs(worst) > limit:
                raise ValueError(
                    f'{source} of {name} = {worst:g} N m must lie in the range {-limit:g} to '
                    f'{limit:g} N m; ask for less or raise its torque limit'
                )
        return self.rotors[order], torques


def joint_actuators(
    named: NamedChain, names: Sequence[str], limit_of: Callable[[str], float]
) -> JointActuators:
    """Actuators of the named joints, or of all; raises ValueError for what is no joint."""
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
    """Command to the actuator at an edge; raises ValueError where the message is none."""
    for name, known in (('edge', _EDGES), ('kind', _KINDS)):
        code = getattr(message, name)
        if code not in known:
            raise ValueError(f'{name} = {code} must be one of {", ".join(map(str, known))}')
    return EdgeCommand(
        _EDGES[message.edge],
        _KINDS[message.kind],
        message.value,
        message.duration,
        message.ramp_up,
        message.ramp_down,
    )


def edge_command_to_msg(command: EdgeCommand) -> msg.EdgeCommand:
    """Command to the actuator at an edge as a message."""
    return msg.EdgeCommand(
        edge=next(code for code, edge in _EDGES.items() if edge is command.edge),
        kind=next(code for code, kind in _KINDS.items() if kind is command.kind),
        value=command.value,
        duration=command.duration,
        ramp_up=command.ramp_up,
        ramp_down=command.ramp_down,
    )


def efforts_from_msg(
    actuators: JointActuators, source: str, message: JointState
) -> tuple[Rotors, Array]:
    """Rotors and torques [N m] of the topic `source`; ValueError unless all are acceptable."""
    if message.position or message.velocity:
        raise ValueError(
            f'{source} asks for positions or velocities; the actuators take effort alone'
        )
    if not message.name:
        raise ValueError(f'{source} names no joint; name those that it is for')
    efforts = np.asarray(message.effort, dtype=np.float64)
    return actuators.checked(f'{source}.effort', message.name, efforts)


def efforts_from_array(
    actuators: JointActuators, source: str, message: Float64MultiArray
) -> tuple[Rotors, Array]:
    """Rotors and their torques [N m] in the order of the actuators; ValueError if any is wrong."""
    torques = np.asarray(message.data, dtype=np.float64)
    return actuators.checked(f'{source}.data', actuators.names, torques)


def trajectory_from_msg(
    actuators: JointActuators, source: str, message: JointTrajectory
) -> tuple[Rotors, Array, Array]:
    """Rotors, instants from the start [s] and torques [N m] of shape (points, named).

    Raises ValueError unless all are acceptable.
    """
    if not message.joint_names:
        raise ValueError(f'{source} has points but no joints; name those that they are for')
    for number, point in enumerate(message.points):
        if len(point.positions) or len(point.velocities) or len(point.accelerations):
            raise ValueError(
                f'point {number} of {source} asks for positions, velocities or '
                'accelerations; the actuators take effort alone'
            )
        if len(point.effort) != len(message.joint_names):
            raise ValueError(
                f'point {number} of {source} has {len(point.effort)} efforts for '
                f'{len(message.joint_names)} joints; give each one effort'
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
    """What was delivered to the chain as a message."""
    return msg.Delivery(
        header=Header(stamp=time_to_msg(delivered.stamp), frame_id=FRAME),
        impulses=delivered.impulses,
        work_of_impulses=delivered.work_of_impulses,
        torques_act=delivered.torques_act,
        work_of_torques=delivered.work_of_torques,
        impulse_of_torques=delivered.impulse_of_torques.tolist(),
    )


def delivery_from_msg(message: msg.Delivery) -> DeliveryTotals:
    """What was delivered to the chain."""
    return DeliveryTotals(
        time_from_msg(message.header.stamp),
        message.impulses,
        message.work_of_impulses,
        message.torques_act,
        message.work_of_torques,
        np.asarray(message.impulse_of_torques, dtype=np.float64),
    )


def last_kick_to_msg(named: NamedChain, kick: KickReport) -> msg.LastKick:
    """Kick that is over as a message; joints that got nothing are left out."""
    acted_on = np.flatnonzero(kick.impulse)
    return msg.LastKick(
        header=Header(stamp=time_to_msg(kick.stamp), frame_id=FRAME),
        source=kick.source,
        asked=msg.EdgeCommand() if kick.command is None else edge_command_to_msg(kick.command),
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
    """Which stamps and durations commands may have; a stamp of 0 means now.

    oldest: age of a command [s], 0 for as old as it may be long.
    longest: time that a command may last or lie ahead [s].
    """

    oldest: float
    longest: float

    def check_at_once(self, source: str, stamp: int, now: int) -> None:
        """Raise ValueError for a command to be carried out at once, of a stamp and time [ns]."""
        age = self._age(stamp, now)
        limit = self.oldest or self.longest
        if age > limit:
            raise ValueError(
                f'{source} is {age:.3g} s old, the limit is {limit:g} s; send it in time, or with '
                'a stamp of 0, which means now, or raise command_timeout'
            )
        if -age > limit:
            raise ValueError(
                f'{source} is of {-age:.3g} s ahead, the limit is {limit:g} s; set the clocks, or '
                'send it with a stamp of 0, which means now'
            )

    def delay(self, source: str, stamp: int, now: int, duration: float) -> float:
        """Time until a command begins that lasts for a duration [s]; ValueError where refused."""
        delay = -self._age(stamp, now)
        if delay + duration < 0:
            raise ValueError(
                f'{source} was over {-duration - delay:.3g} s ago; send it in time, or with a '
                'stamp of 0, which means now'
            )
        self.check_length(source, max(delay, 0.0) + duration)
        return delay

    def check_length(self, source: str, ends: float) -> None:
        """Raise ValueError for a command that ends too late after now [s]."""
        if ends > self.longest:
            raise ValueError(
                f'{source} ends {ends:.3g} s from now, the limit is {self.longest:g} s; send '
                'shorter ones, or raise longest_command'
            )

    @staticmethod
    def _age(stamp: int, now: int) -> float:
        return (now - stamp) / SECOND if stamp else 0.0
