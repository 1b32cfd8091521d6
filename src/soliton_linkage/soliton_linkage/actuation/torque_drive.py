# SPDX-License-Identifier: Apache-2.0
"""Torques of the edge actuators and of the joint actuators as functions of time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.actuation.actuators import Actuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.profile import AT_REST, RESOLUTION, Profile
from soliton_linkage.actuation.waveform import DrivenQuantity
from soliton_linkage.linear.rigidity import Edge, mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain

_REST_LEVEL = 1e-6
"""Threshold of rest: the level of an actuator is set to 0 when it is at most this fraction of the
largest level since the command [1], because an exponential decay never reaches 0."""
_STIFFNESS = 0.3
"""Natural frequency of the angle servo, multiplied by the frame period [1]. For a burst of 40
rad/s, the error of the angle is 0.3 % of the amplitude at 500 frames per second and 3 % at 250
frames per second; at 100 frames per second, the servo fails. These errors do not include the delay
of one frame period (see `ChainDriver`). Sensitivity at 500 frames per second: at half this value,
the error is 0.7 %; at twice this value, it is 0.2 %."""
_SIGNS = {Edge.FIRST: 1.0, Edge.LAST: -1.0}
"""Sign of the torque of each edge actuator [1]; +1 moves a wall towards the last rotor."""


class MeanTorque(NamedTuple):
    """Mean torque along the unit zero mode [N m], and whether a limit reduces it.

    Positive torques move a wall towards the last rotor.
    """

    torque: float
    saturated: bool


class EdgeDrive:
    """Torque of the actuators at both edges and of a torque pulse, as a function of time.

    A command replaces the previous command. The actuator of the previous command returns to rest.
    Times [s] must not decrease.
    """

    def __init__(self, actuator: Actuator) -> None:
        self._ends = {edge: _ActuatorState(actuator) for edge in _SIGNS}
        self.actuator = actuator
        self._pulse: Profile | None = None
        self._sign = 0.0
        self._started = -math.inf
        self._over = -math.inf

    @property
    def active(self) -> bool:
        """Whether a torque acts now or will act later."""
        return any(end.active for end in self._ends.values()) or self._pulse is not None

    @property
    def levels(self) -> tuple[float, float]:
        """Levels of the actuators at the first and the last edge, for example pressures [Pa]."""
        return self._ends[Edge.FIRST].level, self._ends[Edge.LAST].level

    def unfinished(self, time: float) -> bool:
        """Return whether a command with a finite duration is still active at `time` [s]."""
        return time < self._over < math.inf

    def command(self, command: EdgeCommand, side: Edge, time: float) -> None:
        """Start a pulse or pressure at the first or last edge at `time` [s]."""
        self.drop(time)
        profile = command.profile
        if command.kind is CommandKind.PULSE:
            self._pulse, self._sign = profile, _SIGNS[side]
        elif not command.vents:
            self._ends[side].command(profile, time)
        self._started, self._over = time, math.inf if command.held else time + profile.end

    def drop(self, time: float) -> None:
        """Release the actuators and end the pulse at `time` [s]."""
        for end in self._ends.values():
            end.command(AT_REST, time)
        self._pulse, self._over = None, -math.inf

    def mean_torque(self, start: float, end: float) -> MeanTorque:
        """Advance to `start` [s] and return the mean torque from `start` to `end` [s]."""
        torque, saturated = 0.0, False
        for edge, actuated in self._ends.items():
            level = actuated.mean_level(start, end)
            torque += _SIGNS[edge] * float(self.actuator.torque(level))
            saturated |= self.actuator.is_saturated(level)
        since = start - self._started
        if self._pulse is not None and since >= self._pulse.end - RESOLUTION:
            self._pulse = None
        if self._pulse is not None:
            torque += self._sign * float(self._pulse.mean(since, since + end - start))
        return MeanTorque(torque, saturated)


class _ActuatorState:
    def __init__(self, actuator: Actuator) -> None:
        self.level = 0.0
        self._actuator = actuator
        self._time = 0.0
        self._largest = 0.0
        self._started = 0.0
        self._command = AT_REST

    @property
    def active(self) -> bool:
        return self._command is not AT_REST or self.level != 0

    def command(self, profile: Profile, time: float) -> None:
        self._advance(time)
        self._command, self._started = profile, time
        self._largest = abs(self.level)

    def mean_level(self, start: float, end: float) -> float:
        self._advance(start)
        return self._driven(start, end)[1] / (end - start) if self.active else 0.0

    def _advance(self, time: float) -> None:
        if self.active and time > self._time:
            self.level, _ = self._driven(self._time, time)
            self._largest = max(self._largest, abs(self.level))
            if time - self._started >= self._command.end and not self._command.held:
                self._command = AT_REST
            if self._command is AT_REST and abs(self.level) <= _REST_LEVEL * self._largest:
                self.level = 0.0
        self._time = time

    def _driven(self, start: float, end: float) -> tuple[float, float]:
        since = 0.0 if self._command is AT_REST else start - self._started
        return self._actuator.response(self.level, self._command, since, since + end - start)


Rotors = NDArray[np.intp]


@dataclass
class _Command:
    rotors: Rotors
    profile: Profile
    started: float

    @property
    def ends(self) -> float:
        return math.inf if self.profile.held else self.started + self.profile.end


class JointDrive:
    """Torques of the joint actuators as functions of time [s].

    A command replaces the torques of the rotors that it names. After the end of a command, its
    last torques are held for `timeout` [s], or without limit if `timeout` is 0.
    """

    def __init__(self, number_of_rotors: int, timeout: float) -> None:
        self._number = number_of_rotors
        self.timeout = timeout
        self._commands: list[_Command] = []

    @property
    def active(self) -> bool:
        """Whether a torque acts now or will act later."""
        return bool(self._commands)

    def hold(self, rotors: Rotors, torques: Array, time: float) -> None:
        """Apply constant torques [N m], shape (len(rotors),), to `rotors` from `time` [s] on."""
        self._command(rotors, np.zeros(1), torques[None, :], time)

    def follow(self, rotors: Rotors, times: Array, torques: Array, time: float) -> None:
        """Apply a trajectory of torques, linear between its points, from `time` [s] on.

        `times` [s] are relative to `time`; `torques` [N m] have the shape (len(times),
        len(rotors)). If the first of `times` is positive, the torques change linearly from the
        current torques to the first point. If some of `times` are negative, the trajectory has
        started before `time`, and the part before `time` is skipped.
        """
        now = self._now(time)[rotors]
        if times[0] > 0:
            times, torques = np.append(0.0, times), np.vstack([now, torques])
        self._command(rotors, times, torques, time)

    def mean_torques(self, start: float, end: float) -> Array:
        """Return the mean torques from `start` to `end` [N m], shape (N,)."""
        torques = np.zeros(self._number)
        self._commands = [each for each in self._commands if start < each.ends - RESOLUTION]
        for command in self._commands:
            since = start - command.started
            torques[command.rotors] = command.profile.mean(since, since + end - start)
        return torques

    def _now(self, time: float) -> Array:
        torques = np.zeros(self._number)
        for command in self._commands:
            torques[command.rotors] = command.profile.after(time - command.started)
        return torques

    def _command(self, rotors: Rotors, times: Array, torques: Array, time: float) -> None:
        for command in self._commands:
            others = ~np.isin(command.rotors, rotors)
            command.profile = Profile(command.profile.times, command.profile.values[:, others])
            command.rotors = command.rotors[others]
        self._commands = [command for command in self._commands if len(command.rotors)]
        if not np.any(torques):
            return
        if self.timeout:
            last = times[-1] + self.timeout
            times = np.append(times, [last, last])
            torques = np.vstack([torques, torques[-1], np.zeros_like(torques[-1])])
        self._commands.append(_Command(rotors, Profile(times, torques), time))


class RotorDrive:
    """Drive of one rotor by a waveform that starts at the time `started` [s].

    `profile` is a torque [N m] or an angle [rad] as a function of time; `quantity` states which
    one it is. The absolute value of the torque on the rotor is limited to `limit` [N m]. If
    `profile` is an angle q_ref(t), a servo applies the torque tau, so that q follows q_ref. Here q
    is the change of the rotor angle since the start. The other symbols are the moment of inertia
    I, the torque of the springs tau_springs, the frame period T, and the natural frequency w of
    the servo.

        tau = I q_ref'' - tau_springs + I [w^2 (q_ref - q) + 2 w (q_ref' - q')],    w = 0.3 / T.

    A torque that is sent after a frame acts from the next frame on. Therefore tau_springs, q and
    q' are extrapolated to the next frame. But q_ref is taken at the current frame. The rotor
    therefore follows q_ref with a delay of one frame period, the delay of all commands of a
    `ChainDriver`.
    """

    def __init__(
        self,
        chain: Chain,
        profile: Profile,
        quantity: DrivenQuantity,
        rotor: int,
        limit: float,
        started: float,
    ) -> None:
        self._chain = chain
        self._profile, self._rotor, self._limit, self._started = profile, rotor, limit, started
        self._servo: _AngleServo | None = None
        if quantity is DrivenQuantity.ANGLE:
            self._servo = _AngleServo(profile, float(chain.moments_of_inertia[rotor]))

    def unfinished(self, time: float) -> bool:
        """Return whether the waveform continues after the instant `time` [s]."""
        return time < self._started + self._profile.end - RESOLUTION

    def add_torque(self, torques: Array, angles: Array, start: float, end: float) -> bool:
        """Add the torque that is sent after the current frame to `torques` [N m], shape (N,).

        The current frame is at the time `start`, and the next one at the time `end` [s]. If the
        profile is a torque, its mean between these times is added. `angles` [rad] are the angles
        of all rotors in the current frame. Return whether the torque was limited.
        """
        since = start - self._started
        if self._servo is None:
            wanted = float(self._profile.mean(since, since + end - start))
        else:
            springs = float(self._chain.spring_torques(angles)[self._rotor])
            angle = float(angles[self._rotor])
            wanted = self._servo.torque(angle, springs, since, end - start)
        given = min(max(wanted, -self._limit), self._limit)
        torques[self._rotor] += given
        if self._servo is not None:
            self._servo.sent = given
        return given != wanted


class _AngleServo:
    """Torques that impose an angle on a rotor; see `RotorDrive`."""

    def __init__(self, profile: Profile, inertia: float) -> None:
        from scipy.interpolate import CubicSpline  # few commands need scipy, which starts slowly

        # The last two points of the profile are a jump to 0. The servo omits the last point.
        self._reference = CubicSpline(profile.times[:-1], profile.values[:-1])
        self._inertia = inertia
        self._start: float | None = None
        self._before: tuple[float, float] | None = None
        self._acceleration = 0.0
        self.sent = 0.0
        """Torque sent after the previous frame [N m]; it acts from the current frame on."""

    def torque(self, angle: float, springs: float, since: float, period: float) -> float:
        """Return the torque [N m] that acts from the next frame on.

        The current frame is `since` [s] after the start of the waveform, and `period` [s] before
        the next frame. In the current frame, the rotor has the angle `angle` [rad], and the
        springs exert the torque `springs` [N m].
        """
        if self._start is None:
            self._start = angle
        angle_before, springs_before = self._before or (angle, springs)
        self._before = angle, springs
        rate = (angle - angle_before) / period + self._acceleration * period / 2
        slope = springs - springs_before
        self._acceleration = (self.sent + springs + slope / 2) / self._inertia
        angle += period * (rate + self._acceleration * period / 2)
        rate += period * self._acceleration
        instants = np.minimum([since, since + period], self._reference.x[-1])
        first, last = self._reference(instants, 1)
        behind = self._start + float(self._reference(instants[0])) - angle
        stiffness = _STIFFNESS / period
        wanted = stiffness * (stiffness * behind + 2 * (first - rate)) + (last - first) / period
        return self._inertia * float(wanted) - springs - 1.5 * slope


class DriveTorques(NamedTuple):
    """Mean torque on each rotor [N m], (N,), and whether a limit reduced a torque."""

    torques: Array
    saturated: bool


class TorqueDrive:
    """Sum of the torques of edge actuators, joint actuators (see `JointDrive`) and a waveform."""

    def __init__(self, chain: Chain, actuator: Actuator, timeout: float) -> None:
        self.chain = chain
        self.edges = EdgeDrive(actuator)
        self.joints = JointDrive(chain.number_of_rotors, timeout)
        self._rotor: RotorDrive | None = None

    @property
    def active(self) -> bool:
        """Whether a torque acts now or will act later."""
        return self.edges.active or self.joints.active or self._rotor is not None

    def edge_command_unfinished(self, time: float) -> bool:
        """Return whether a finite edge command or a waveform is active at `time` [s]."""
        playing = self._rotor is not None and self._rotor.unfinished(time)
        return playing or self.edges.unfinished(time)

    def command(self, command: EdgeCommand, side: Edge, time: float) -> None:
        """Start an edge command at `time` [s], in place of the previous command or waveform."""
        self._rotor = None
        self.edges.command(command, side, time)

    def play(
        self, profile: Profile, quantity: DrivenQuantity, rotor: int, limit: float, time: float
    ) -> None:
        """Start a `RotorDrive` at `time` [s], in place of the previous command or waveform."""
        self.edges.drop(time)
        self._rotor = RotorDrive(self.chain, profile, quantity, rotor, limit, time)

    def torques(self, angles: Array, start: float, end: float) -> DriveTorques:
        """Return the mean torques from `start` to `end` [s], for the `angles` at `start` [rad]."""
        torques = self.joints.mean_torques(start, end)
        edge = self.edges.mean_torque(start, end)
        if edge.torque:
            torques += edge.torque * mode_towards_last(self.chain, angles)
        if self._rotor is not None and not self._rotor.unfinished(start):
            self._rotor = None
        limited = self._rotor is not None and self._rotor.add_torque(torques, angles, start, end)
        return DriveTorques(torques, edge.saturated or limited)
