# SPDX-License-Identifier: Apache-2.0
"""Drive of a single rotor whose torque or angle follows a waveform."""

from __future__ import annotations

import numpy as np

from soliton_linkage.actuation.profile import RESOLUTION, Profile
from soliton_linkage.actuation.waveform import DrivenQuantity
from soliton_linkage.linkage.chain import Array, Chain

_STIFFNESS = 0.3
"""Natural frequency of the angle servo, multiplied by the frame period [1]. For a burst of 40
rad/s, the error of the angle is 0.3 % of the amplitude at 500 frames per second and 3 % at 250
frames per second; at 100 frames per second, the servo fails. These errors do not include the delay
of one frame period (see `ChainDriver`). Sensitivity at 500 frames per second: at half this value,
the error is 0.7 %; at twice this value, it is 0.2 %."""


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
