# SPDX-License-Identifier: Apache-2.0
"""How a wall is taken along the orbit: how fast it may go, and when it is to be where.

A wall that moves at the rate w of its arc s pushes each rotor off the orbit with the force
I w^2 t_n'(s), t = dPhi/ds. What of it has a frequency q w beyond the gap omega_0 is radiated: of
the wall's energy about the share |q t_n(q)|^2 at each rotor, t_n(q) = int t_n e^(iqs) ds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings

_SAMPLES = 2048
"""Of the passage of a wall [1]: its spectrum must reach far beyond where it has died out."""
_PEAK = 15 / 8
"""Largest rate of the polynomial from rest to rest over its mean [1]."""
_MORE_TIME = 1.1
"""Factor by which a trajectory is lengthened until it is slow enough [1]: how much too long it
may be."""


@dataclass(frozen=True)
class ReferencePoint:
    """Where a wall is to be at an instant.

    arc: arc length [rad].
    rate: rate of the arc length [rad/s].
    acceleration: rate of the rate [rad/s^2].
    """

    arc: float
    rate: float
    acceleration: float


@dataclass(frozen=True)
class ReferenceTrajectory:
    """A way along the orbit in time, s = sum_j c_j x^j with x = (time - start) / duration.

    A polynomial of degree five in between, at rest at the end and from there on.

    start: instant of its beginning [s].
    duration: time that it takes [s].
    coefficients: c_0 to c_5 [rad].
    """

    start: float
    duration: float
    coefficients: tuple[float, ...]

    @property
    def goal(self) -> float:
        """Arc length at its end [rad]."""
        return float(sum(self.coefficients))

    @property
    def end(self) -> float:
        """Instant at which it ends [s]."""
        return self.start + self.duration

    @property
    def fastest(self) -> float:
        """Largest rate on the way [rad/s]."""
        rates = np.polyval(self._derivative(1), np.linspace(0, 1, 201))
        return float(np.abs(rates).max() / self.duration)

    @property
    def strongest(self) -> float:
        """Largest acceleration on the way [rad/s^2]."""
        accelerations = np.polyval(self._derivative(2), np.linspace(0, 1, 201))
        return float(np.abs(accelerations).max() / self.duration**2)

    def at(self, time: float) -> ReferencePoint:
        """Where the wall is to be at an instant [s]."""
        share = min(max((time - self.start) / self.duration, 0.0), 1.0)
        arc, rate, acceleration = (
            float(np.polyval(self._derivative(order), share)) / self.duration**order
            for order in range(3)
        )
        return ReferencePoint(arc, rate, acceleration)

    def _derivative(self, order: int) -> Array:
        """Coefficients of a derivative with respect to the share, highest first."""
        highest_first = np.array(self.coefficients[::-1])
        return np.polyder(highest_first, order) if order else highest_first


def adiabatic_rate(orbit: Orbit, settings: SteeringSettings = DEFAULTS) -> float:
    """Rate of the arc at which a wall radiates next to nothing [rad/s].

    The `adiabatic_fraction` of the largest at which a rotor in the middle takes less than the
    `radiated_share` of the wall's energy.
    """
    middle = orbit.arc_at(orbit.middle, 0)
    begin, end = orbit.leg_arcs(0)
    arcs = np.linspace(
        max(begin, middle - orbit.wall_extent), min(end, middle + orbit.wall_extent), _SAMPLES
    )
    rotors = orbit.chain.number_of_rotors // 2 + np.array([-1, 0])
    passing = np.zeros((2, _SAMPLES))
    for sample, arc in enumerate(arcs.tolist()):
        about = orbit.segment(arc)
        within = rotors - about.first
        seen = (within >= 0) & (within < len(about.angles))
        passing[seen, sample] = about.tangent[within[seen]]
    step = float(arcs[1] - arcs[0])
    numbers = 2 * math.pi * np.fft.rfftfreq(_SAMPLES, step)
    # Tapered, as in a short chain a rotor feels the wall even at the edges.
    spectrum = np.fft.rfft(passing * np.hanning(_SAMPLES))
    shares = (np.abs(spectrum) * step * numbers) ** 2
    radiating = np.flatnonzero(shares.max(axis=0) > settings.radiated_share)
    # Of a wall that radiates at every number, as it jumps, the samples tell no more.
    first_quiet = min(max(radiating, default=0) + 1, len(numbers) - 1)
    return settings.adiabatic_fraction * gap(orbit.chain) / float(numbers[first_quiet])


def bandwidth(orbit: Orbit, period: float, settings: SteeringSettings = DEFAULTS) -> float:
    """Bandwidth of the feedback [rad/s] for frames that come every period [s], NaN if not known.

    So far below the gap that what noise makes of it wakes no phonons, and so far below the rate
    of the frames that a late one does not matter.
    """
    slow = settings.bandwidth_share * gap(orbit.chain)
    return slow if math.isnan(period) else min(slow, settings.bandwidth_step / period)


def trajectory_to(
    goal: float, start: float, point: ReferencePoint, rate: float, shortest: float
) -> ReferenceTrajectory:
    """From what the wall is to do now to rest at a goal [rad], beginning at an instant [s].

    It takes the shortest time [s], or as much more as keeps it below a rate [rad/s] above 0, or
    below the one that the wall has.
    """
    duration = max(shortest, _PEAK * abs(goal - point.arc) / rate)
    limit = max(rate, abs(point.rate)) * (1 + 1e-9)
    trajectory = _joining(goal, start, point, duration)
    while trajectory.fastest > limit:
        duration *= _MORE_TIME
        longer = _joining(goal, start, point, duration)
        if longer.fastest > trajectory.fastest:
            break
        trajectory = longer
    return trajectory


def trajectory_to_rest(
    start: float, point: ReferencePoint, shortest: float
) -> ReferenceTrajectory:
    """Trajectory that brakes from what it is to do now, within the shortest time [s]."""
    return _joining(point.arc + point.rate * shortest / 2, start, point, shortest)


def _joining(
    goal: float, start: float, point: ReferencePoint, duration: float
) -> ReferenceTrajectory:
    """Polynomial from a reference point to rest at the goal."""
    rate, acceleration = point.rate * duration, point.acceleration * duration**2 / 2
    way = goal - point.arc - rate - acceleration
    change, turn = -rate - 2 * acceleration, -2 * acceleration
    coefficients = (
        point.arc,
        rate,
        acceleration,
        10 * way - 4 * change + turn / 2,
        -15 * way + 7 * change - turn,
        6 * way - 3 * change + turn / 2,
    )
    return ReferenceTrajectory(start, duration, coefficients)
