# SPDX-License-Identifier: Apache-2.0
"""Reference trajectories of a wall along the orbit, and their adiabatic speed limit.

Let w = ds/dt be the rate of the arc length s of a wall, t(s) the tangent of the orbit, and I the
moment of inertia of a rotor. The wall exerts the torque I w^2 t_n'(s) on rotor n. The vector of
these torques is orthogonal to the orbit. The tangent has the Fourier components
t_n(q) = int t_n e^(iqs) ds. The component q acts on the rotor at the frequency q w, and excites
phonons if this frequency exceeds the phonon gap. While the wall passes rotor n once, phonons of
this frequency then receive about the fraction |q t_n(q)|^2 of the energy of the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings

_SAMPLES = 2048
"""Number of samples of t_n(s) [1], so large that t_n(q) is almost 0 at the highest q."""
_PEAK = 15 / 8
"""Ratio of the largest rate to the mean rate of a trajectory from rest to rest [1]."""
_EXTENSION = 1.1
"""Ratio of each tried duration of a trajectory to the previous one [1]."""


class ReferencePoint(NamedTuple):
    """Reference state of a wall: arc length s [rad], ds/dt [rad/s] and d2s/dt2 [rad/s^2]."""

    arc: float
    rate: float
    acceleration: float


@dataclass(frozen=True)
class ReferenceTrajectory:
    """Reference of the arc length s of a wall: a polynomial of degree five in time.

    s = sum_j c_j x^j with the `coefficients` c_0 to c_5 [rad] and x = (time - start) / duration,
    limited to the range from 0 to 1, so that s is constant after the end. `start` and `duration`
    have the unit s.
    """

    start: float
    duration: float
    coefficients: tuple[float, ...]

    @property
    def goal(self) -> float:
        """Arc length at the end of the trajectory [rad]."""
        return float(sum(self.coefficients))

    @property
    def end(self) -> float:
        """Instant of the end [s]."""
        return self.start + self.duration

    @property
    def max_rate(self) -> float:
        """Largest absolute rate [rad/s]."""
        rates = np.polyval(self._derivative(1), np.linspace(0, 1, 201))
        return float(np.abs(rates).max() / self.duration)

    @property
    def max_acceleration(self) -> float:
        """Largest absolute acceleration [rad/s^2]."""
        accelerations = np.polyval(self._derivative(2), np.linspace(0, 1, 201))
        return float(np.abs(accelerations).max() / self.duration**2)

    def at(self, time: float) -> ReferencePoint:
        """Return the reference at an instant [s]."""
        x = min(max((time - self.start) / self.duration, 0.0), 1.0)
        values = (float(np.polyval(self._derivative(order), x)) for order in range(3))
        return ReferencePoint(*(each / self.duration**order for order, each in enumerate(values)))

    def _derivative(self, order: int) -> Array:
        highest_first = np.array(self.coefficients[::-1])
        return np.polyder(highest_first, order) if order else highest_first


def adiabatic_rate(orbit: Orbit, settings: SteeringSettings = DEFAULTS) -> float:
    """Return the largest rate of the arc length at which a wall radiates little energy [rad/s].

    The result is `adiabatic_fraction` times the rate below which, at each of the two middle rotors
    and each frequency above the phonon gap, the radiated fraction of the energy of the wall is
    below `radiated_share`.
    """
    middle = orbit.arc_at(orbit.middle, 0)
    begin, end = orbit.leg_arcs(0)
    arcs = np.linspace(
        max(begin, middle - orbit.wall_extent), min(end, middle + orbit.wall_extent), _SAMPLES
    )
    rotors = orbit.chain.number_of_rotors // 2 + np.array([-1, 0])
    passages = np.zeros((2, _SAMPLES))
    for sample, arc in enumerate(arcs.tolist()):
        about = orbit.segment(arc)
        within = rotors - about.first
        inside = (within >= 0) & (within < len(about.angles))
        passages[inside, sample] = about.tangent[within[inside]]
    step = float(arcs[1] - arcs[0])
    numbers = 2 * math.pi * np.fft.rfftfreq(_SAMPLES, step)
    # In a short chain, the tangent is not 0 at the ends of the sampled range. Without the window,
    # the jumps at the ends would add spurious high frequencies to the spectrum.
    spectrum = np.fft.rfft(passages * np.hanning(_SAMPLES))
    shares = (np.abs(spectrum) * step * numbers) ** 2
    radiating = np.flatnonzero(shares.max(axis=0) > settings.radiated_share)
    # The spectrum of a wall that jumps from rotor to rotor may exceed the limit at all wave
    # numbers. In this case, the largest wave number is used.
    first_quiet = min(max(radiating, default=0) + 1, len(numbers) - 1)
    return settings.adiabatic_fraction * gap(orbit.chain) / float(numbers[first_quiet])


def bandwidth(orbit: Orbit, period: float, settings: SteeringSettings = DEFAULTS) -> float:
    """Return the bandwidth of the feedback [rad/s]; `period` is the frame period [s] or NaN.

    The bandwidth is far below the phonon gap, so that noise excites few phonons. It is also far
    below the frame rate, so that late frames do not destabilise the feedback.
    """
    limit = settings.bandwidth_share * gap(orbit.chain)
    return limit if math.isnan(period) else min(limit, settings.bandwidth_step / period)


def trajectory_to(
    goal: float, start: float, point: ReferencePoint, rate: float, shortest: float
) -> ReferenceTrajectory:
    """Return a trajectory from a reference point at `start` [s] to rest at `goal` [rad].

    The duration is at least `shortest` [s]. It is so long that the largest rate does not exceed
    the larger one of `rate` [rad/s] and the initial rate of `point`.
    """
    duration = max(shortest, _PEAK * abs(goal - point.arc) / rate)
    limit = max(rate, abs(point.rate)) * (1 + 1e-9)
    trajectory = _joining(goal, start, point, duration)
    while trajectory.max_rate > limit:
        duration *= _EXTENSION
        longer = _joining(goal, start, point, duration)
        if longer.max_rate > trajectory.max_rate:
            break
        trajectory = longer
    return trajectory


def trajectory_to_rest(
    start: float, point: ReferencePoint, shortest: float
) -> ReferenceTrajectory:
    """Return a trajectory from a reference point at `start` [s] to rest after `shortest` [s]."""
    return _joining(point.arc + point.rate * shortest / 2, start, point, shortest)


def _joining(
    goal: float, start: float, point: ReferencePoint, duration: float
) -> ReferenceTrajectory:
    rate, acceleration = point.rate * duration, point.acceleration * duration**2 / 2
    distance = goal - point.arc - rate - acceleration
    change, turn = -rate - 2 * acceleration, -2 * acceleration
    coefficients = (
        point.arc,
        rate,
        acceleration,
        10 * distance - 4 * change + turn / 2,
        -15 * distance + 7 * change - turn,
        6 * distance - 3 * change + turn / 2,
    )
    return ReferenceTrajectory(start, duration, coefficients)
