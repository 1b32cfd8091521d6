# SPDX-License-Identifier: Apache-2.0
"""Preparation of a frame of angles: time stamps, whole turns, impulses, and unseen rotors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import compile_loop, compiled, const_f8_1d, f8, f8_1d
from soliton_linkage.estimation.estimates import OrbitEstimate
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.linkage.chain import Array, Chain, Motion, check_shape, staggered
from soliton_linkage.linkage.quantities import LARGEST_ANGLE
from soliton_linkage.orbit.orbit import Orbit

Flags = NDArray[np.bool_]

_TURN = 2 * math.pi
"""Angle of one turn [rad]."""
_SHARE_OF_A_TURN = 0.5 / math.pi
"""Factor that converts an angle to a number of turns [1/rad]."""


def _wrapped(angle: float) -> float:
    return float(angle - _TURN * np.rint(angle * _SHARE_OF_A_TURN))


wrapped = compile_loop(_wrapped, (f8,), inlined=True)


def rotor_swing(chain: Chain) -> float:
    """Return the swing of a rotor: the change of its angle while a wall passes [rad]."""
    return math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle


@compiled(const_f8_1d, f8_1d, f8_1d, f8_1d)
def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
    """Set `seen` to unwrapped angles [rad], shape (N,), NaN for invalid readings.

    Update `last`, the last valid readings [rad], and `turns`, the numbers of whole turns that are
    added to the readings.
    """
    for n in range(angles.size):
        angle = angles[n]
        if abs(angle) < LARGEST_ANGLE:
            jump = np.rint((angle - last[n]) / _TURN)
            if math.isfinite(jump):
                turns[n] -= jump
            last[n] = angle
            seen[n] = angle + _TURN * turns[n]
        else:
            seen[n] = math.nan


@compiled(const_f8_1d, f8)
def all_within(values: Array, limit: float) -> bool:
    """Return whether all values are finite and no absolute value exceeds a limit."""
    within = True
    for n in range(values.size):
        size = abs(values[n])
        within &= size <= limit and size < math.inf
    return within


_NANOSECOND = 1e-9
"""Duration of one unit of a stamp [s]."""


class FrameClock:
    """Clock that accepts the stamps of frames in ascending order and rejects late stamps."""

    def __init__(self, limit: float = DEFAULTS.tracking.clock_limit) -> None:
        """Start the clock; a stamp more than `limit` [s] before the last one restarts it."""
        self._limit = limit
        self.time = -math.inf
        """Stamp of the last accepted frame minus the stamp of the very first frame [s]. A restart
        does not change the first frame, so that the time is negative if later stamps are earlier
        than the first stamp. It is -inf before the first frame."""
        self.late = 0
        """Number of rejected late frames."""
        self.restarted = False
        """Whether the last frame restarted the clock."""
        self._epoch: int | None = None

    def advance(self, stamp: int) -> bool:
        """Advance the clock to a stamp [ns]; return False if the stamp is rejected as late."""
        if self._epoch is None:
            self._epoch = stamp
        time = (stamp - self._epoch) * _NANOSECOND
        if -self._limit <= time - self.time <= 0:
            self.late += 1
            return False
        self.restarted = time < self.time
        self.time = time
        return True


_NEAR = 3600 * 10**9
"""Two stamps that differ by more than this [ns] are assumed to come from different clocks, because
the zero times of different clocks differ by years."""


class FrameImpulse(NamedTuple):
    """Angular impulses [N m s], shape (N,), that act on the rotors `ago` [s] before a frame."""

    impulses: Array
    ago: float = 0.0


class ImpulseQueue:
    """Queue that keeps impulses until the first frame at or after their time.

    Impulses without a stamp, or with a stamp of another clock, take effect in the next frame.
    """

    def __init__(self) -> None:
        self.late = 0
        """Number of impulses ignored because their stamps were not after the last frame."""
        self._waiting: list[tuple[int | None, Array]] = []
        self._frame: int | None = None

    def add(self, stamp: int | None, impulses: Array) -> None:
        """Add impulses [N m s], shape (N,), with their stamp [ns]; None means an unknown time."""
        after = None if stamp is None or self._frame is None else stamp - self._frame
        if after is not None and -_NEAR < after <= 0:
            self.late += 1
        else:
            known = after is None or after < _NEAR
            self._waiting.append((stamp if known else None, impulses))

    def due(self, stamp: int) -> list[FrameImpulse]:
        """Remove and return the impulses that take effect in the frame with this stamp [ns]."""
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
                due.append(FrameImpulse(impulses, before * _NANOSECOND if before < _NEAR else 0.0))
        self._waiting = later
        return due


def check_noise(noise: float | None) -> None:
    """Raise ValueError for a noise [rad] that is infinite or not above 0; None is valid."""
    if noise is not None and not 0 < noise < math.inf:
        raise ValueError(
            f'noise = {noise:g} rad must be finite and above 0; give None to estimate the noise'
        )


def check_deviations(deviations: Array, rotors: int) -> Array:
    """Return standard deviations [rad] as a contiguous array, shape (N,), NaN if unknown.

    Raises ValueError for another shape, and for values that are infinite or not above 0.
    """
    deviations = np.ascontiguousarray(deviations, dtype=np.float64)
    check_shape(deviations, rotors, 'deviation')
    wrong = np.flatnonzero((deviations <= 0) | np.isinf(deviations))
    if len(wrong):
        rotor = int(wrong[0])
        raise ValueError(
            f'deviation of the angle of rotor {rotor} = {deviations[rotor]:g} rad must be finite '
            'and above 0; give NaN if it is unknown'
        )
    return deviations


class CompletedFrame(NamedTuple):
    """Angles and rates of all rotors of a frame; estimates replace missing values."""

    angles: Array
    """Angles minus encoder offsets [rad], (N,); all NaN if none is known and the chain is lost."""
    rates: Array | None
    """Rates of the rotors [rad/s], shape (N,); None if the rates are unknown."""
    filled: Flags
    """Flags of filled rotors, whose readings are missing or implausible, shape (N,)."""
    from_orbit: bool
    """Whether the angles of filled rotors are taken from the orbit; otherwise they are
    interpolated between neighbouring rotors."""
    others: bool
    """Whether two adjacent rotors both differ from the orbit by more than half a swing, which
    indicates a second wall."""

    number_filled: int
    """Number of filled rotors."""

    @property
    def seen(self) -> Array:
        """Angles [rad], shape (N,), NaN for filled rotors."""
        return np.where(self.filled, np.nan, self.angles) if self.number_filled else self.angles


class OnOrbit(NamedTuple):
    """Angles and rates of all rotors at a point of the orbit, shape (N,) each."""

    angles: Array
    """Predicted angles [rad]; they may differ from unwrapped angles by whole turns."""
    rates: Array
    """Predicted rates [rad/s]."""
    residuals: Array
    """Measured minus predicted angles [rad], from -pi to pi, shape (N,), NaN if unknown."""


def on_orbit(orbit: Orbit, estimate: OrbitEstimate, residuals: Array) -> OnOrbit:
    """Return the angles and rates at the estimated point of the orbit.

    `residuals` [rad], shape (N,), are the differences a - Phi, where Phi are the angles on the
    orbit. Here a is the measured angle phi of a rotor, or pi - phi if the chain is upside down. If
    it is upside down, the results are pi - Phi, and the negative rates and residuals of the orbit.
    """
    angles = orbit.configuration(estimate.arc)
    rates = orbit.tangent(estimate.arc) * estimate.rate
    if estimate.upside_down:
        return OnOrbit(math.pi - angles, -rates, -residuals)
    return OnOrbit(angles, rates, residuals)


class Unwrapper:
    """Unwrapper that removes jumps by whole turns between the angles of successive frames."""

    def __init__(self, number_of_rotors: int) -> None:
        self._turns = np.zeros(number_of_rotors)
        self._last = np.full(number_of_rotors, np.nan)

    @property
    def last(self) -> Array:
        """Last valid unwrapped angle of each rotor [rad], shape (N,), NaN if never valid."""
        return np.asarray(self._last + 2 * math.pi * self._turns)

    def unwrapped(self, angles: Array) -> Array:
        """Return unwrapped angles [rad], shape (N,), NaN for invalid readings."""
        seen = np.empty(len(self._last))
        read = np.ascontiguousarray(angles, dtype=np.float64)
        unwrap(read, self._last, self._turns, seen)
        return seen


def complete(
    chain: Chain, angles: Array, rates: Array | None, expected: OnOrbit | None, last: Array
) -> CompletedFrame:
    """Replace missing angles [rad] and rates [rad/s], shape (N,), by values of the orbit.

    An angle also counts as missing if it differs from the orbit by more than half a swing while
    both neighbouring rotors do not. The values of the orbit are `expected`. Whole turns are added
    to its angles so that they are nearest to `last`, the last valid angles [rad]. If `expected` is
    None, missing angles are interpolated between neighbouring rotors, and the rates are discarded
    unless all of them are known.
    """
    unseen = ~np.isfinite(angles)
    if expected is None:
        known = rates is not None and np.isfinite(rates).all()
        return CompletedFrame(
            _like_neighbours(angles),
            rates if known else None,
            unseen,
            False,
            False,
            int(np.count_nonzero(unseen)),
        )
    elsewhere = np.abs(expected.residuals) > rotor_swing(chain) / 2
    others = elsewhere[1:] & elsewhere[:-1]
    filled = unseen | elsewhere
    filled[1:] &= unseen[1:] | ~others
    filled[:-1] &= unseen[:-1] | ~others
    turns = np.rint((last - expected.angles) / (2 * math.pi))
    there = expected.angles + 2 * math.pi * np.where(np.isfinite(turns), turns, 0.0)
    moving = None
    if rates is not None:
        moving = np.where(filled | ~np.isfinite(rates), expected.rates, rates)
    return CompletedFrame(
        np.where(filled, there, angles),
        moving,
        filled,
        True,
        bool(others.any()),
        int(np.count_nonzero(filled)),
    )


def _like_neighbours(angles: Array) -> Array:
    unseen = np.isnan(angles)
    if not unseen.any() or unseen.all():
        return angles
    rotors, theta = np.arange(len(angles)), staggered(angles)
    leans = [np.interp(rotors, rotors[~unseen], each(theta[~unseen])) for each in (np.sin, np.cos)]
    return np.where(unseen, staggered(np.arctan2(*leans)), angles)
