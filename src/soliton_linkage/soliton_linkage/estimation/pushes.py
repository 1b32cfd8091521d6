# SPDX-License-Identifier: Apache-2.0
"""Pushes that an analyser is told of: from which frame on each acts, and what it does to a wall.

Along its orbit Phi(s) a chain of rotors of the inertia I has the momentum I w at the rate w, were
its bars rigid. Springs give way by -I w^2 K^-1 Phi'' to what moves a rotor off its path, so that
with mu = I Phi'' . K^-1 Phi'' the momentum is

    p / I = w + 2 mu w^3,

to the lowest order in what is off the orbit. Impulses J add t . J, t = dPhi/ds.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import dynamical_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

_REACH = 6.0
"""Beside a wall in chains that have all of its momentum [rotor spacings], and"""
_REACH_IN_DEPTHS = 4.0
"""as much again in penetration depths: no more than e^-8 of it is beyond."""
_LONGEST = 60.0
"""Of this reach [rotor spacings]: equations of 120 rotors take 10 ms."""
_SAMPLES = 8
"""Places in a rotor spacing of which the mean is taken: walls of wobblers yield unevenly."""
_STEP = 1e-3
"""Arc over which the tangent is differentiated [rad]: an error of 1e-6."""
_NANOSECOND = 1e-9
"""Unit of stamps [s]."""
_NEAR = 10**9
"""Farthest that a stamp may be from that of the latest frame to be of the same clock [ns]: walls
are followed for seconds, and clocks that differ do so by more."""


class Push(NamedTuple):
    """Impulses that act on the rotors of a chain at one instant.

    impulses: angular impulses [N m s], shape (N,).
    ago: time from that instant to the frame that they act from [s].
    """

    impulses: Array
    ago: float = 0.0


class WaitingPushes:
    """Pushes that wait for the first frame that is not earlier than they are.

    One without a stamp, or with that of another clock, waits for the next frame.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.late = 0
        """Number of pushes that came after the frame that they acted from."""
        self._waiting: list[tuple[int | None, Array]] = []
        self._frame: int | None = None

    def add(self, stamp: int | None, impulses: Array) -> None:
        """Have impulses wait that were made at an instant [ns], None where that is not known."""
        after = None if stamp is None or self._frame is None else stamp - self._frame
        if after is not None and -_NEAR < after <= 0:
            self.late += 1
        else:
            known = after is None or after < _NEAR
            self._waiting.append((stamp if known else None, impulses))

    def due(self, stamp: int) -> list[Push]:
        """Take those that act from the frame of a stamp [ns] on."""
        if self._frame is not None and stamp < self._frame:
            self._waiting.clear()
        self._frame = stamp
        if not self._waiting:
            return []
        due, later = [], []
        for made, impulses in self._waiting:
            before = 0 if made is None else stamp - made
            if -_NEAR < before < 0:
                later.append((made, impulses))
            else:
                due.append(Push(impulses, before * _NANOSECOND if before < _NEAR else 0.0))
        self._waiting = later
        return due


def yielding(chain: Chain) -> float:
    """Mean of mu over the places of a wall between two rotors, without deviations [s^2]."""
    depth = penetration_depth(chain) / chain.spacing
    rotors = 2 * math.ceil(min(_REACH + _REACH_IN_DEPTHS * depth, _LONGEST))
    orbit = UniformOrbit(replace(chain, number_of_rotors=rotors, deviations=NO_DEVIATIONS))
    found = []
    for share in range(_SAMPLES):
        arc = orbit.arc_at(orbit.middle + share / _SAMPLES, 0)
        bend = (orbit.tangent(arc + _STEP) - orbit.tangent(arc - _STEP)) / (2 * _STEP)
        matrix = dynamical_matrix(orbit.chain, orbit.configuration(arc)).toarray()
        found.append(bend @ np.linalg.lstsq(matrix, bend, rcond=1e-9)[0])
    return float(np.mean(found))


def pushed_rate(rate: float, momentum: float, mu: float) -> float:
    """Rate after a momentum p / I [rad/s] was added, of a wall that yields by mu [s^2]."""
    whole = rate + 2 * mu * rate**3 + momentum
    scale = math.sqrt(6 * mu)
    return 2 / scale * math.sinh(math.asinh(1.5 * scale * whole) / 3)
