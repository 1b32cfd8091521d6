# SPDX-License-Identifier: Apache-2.0
"""Frames of angles: stamps, turns of rotors, impulses that wait, and rotors that are not seen."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import compile_loop, compiled, const_f8_1d, f8, f8_1d
from soliton_linkage.estimation.estimates import OrbitEstimate
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.linkage.chain import Array, Chain, Motion, check_shape, staggered
from soliton_linkage.orbit.orbit import Orbit

Flags = NDArray[np.bool_]

LARGEST_ANGLE = 1e9
"""Angle [rad] from which on none is told: a double is then 1e-7 rad apart from the next."""

_WHOLE = 2 * math.pi
"""A turn [rad]."""
_SHARE_OF_A_TURN = 0.5 / math.pi
"""One radian in turns [1/rad]."""


def _wrapped(angle: float) -> float:
    """Angle from -pi to pi [rad]."""
    return float(angle - _WHOLE * np.rint(angle * _SHARE_OF_A_TURN))


wrapped = compile_loop(_wrapped, (f8,), inlined=True)


def swing_of(chain: Chain) -> float:
    """Angle that a rotor turns by as a wall passes [rad]."""
    return math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle


@compiled(const_f8_1d, f8_1d, f8_1d, f8_1d)
def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
    """Set angles as read without jumps [rad], as seen; NaN where they are not finite or too large.

    The last that were read [rad] and their turns, each of shape (N,), are brought up to date.
    """
    for n in range(angles.size):
        angle = angles[n]
        if abs(angle) < LARGEST_ANGLE:
            jump = np.rint((angle - last[n]) / _WHOLE)
            if math.isfinite(jump):
                turns[n] -= jump
            last[n] = angle
            seen[n] = angle + _WHOLE * turns[n]
        else:
            seen[n] = math.nan


@compiled(const_f8_1d, f8)
def all_within(values: Array, limit: float) -> bool:
    """Whether the absolute values of a row are all known, finite and no more than a limit."""
    within = True
    for n in range(values.size):
        size = abs(values[n])
        within &= size <= limit and size < math.inf
    return within


_NANOSECOND = 1e-9
"""Unit of stamps [s]."""


class FrameClock:
    """Takes the stamps of frames, and refuses those that are late."""

    def __init__(self, limit: float = DEFAULTS.tracking.clock_limit) -> None:
        """Begin at the first stamp; one that goes back by more than the limit [s] starts anew."""
        self._limit = limit
        self.time = -math.inf
        """Instant of the last frame that was taken, from the first on [s]."""
        self.late = 0
        """Number of frames that were refused."""
        self.restarted = False
        """Whether the last one was by a clock that had been set back."""
        self._epoch: int | None = None

    def advance(self, stamp: int) -> bool:
        """Go on to a stamp [ns]; False where it is not later than the last, by up to the limit."""
        if self._epoch is None:
            self._epoch = stamp
        time = (stamp - self._epoch) * _NANOSECOND
        if -self._limit <= time - self.time <= 0:
            self.late += 1
            return False
        self.restarted = time < self.time
        self.time = time
        return True


_NANOSECOND = 1e-9
"""Unit of stamps [s]."""
_NEAR = 3600 * 10**9
"""Farthest that a stamp may be from that of the latest frame to be of the same clock [ns]: who
analyses is behind by seconds or minutes, and clocks of another beginning differ by years."""


class FrameImpulse(NamedTuple):
    """Impulses that act on the rotors of a chain at one instant.

    impulses: angular impulses [N m s], shape (N,).
    ago: time from that instant to the frame that they act from [s].
    """

    impulses: Array
    ago: float = 0.0


class ImpulseQueue:
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

    def due(self, stamp: int) -> list[FrameImpulse]:
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
                due.append(FrameImpulse(impulses, before * _NANOSECOND if before < _NEAR else 0.0))
        self._waiting = later
        return due


def check_deviations(deviations: Array, rotors: int) -> Array:
    """Deviations of readings [rad], shape (N,), NaN where unknown, as a contiguous array.

    Raises ValueError for another shape, and where one is infinite or not above 0.
    """
    deviations = np.ascontiguousarray(deviations, dtype=np.float64)
    check_shape(deviations, rotors, 'deviation')
    wrong = np.flatnonzero((deviations <= 0) | np.isinf(deviations))
    if len(wrong):
        rotor = int(wrong[0])
        raise ValueError(
            f'deviation of the angle of rotor {rotor} = {deviations[rotor]:g} rad must be finite '
            'and above 0; give NaN where it is not known'
        )
    return deviations


class CompletedFrame(NamedTuple):
    """Angles and rates of all rotors of a frame."""

    angles: Array
    """Actual angles [rad], shape (N,); all NaN where no rotor was seen, nor the orbit known."""
    rates: Array | None
    """Rates [rad/s], shape (N,); None where they are not known."""
    filled: Flags
    """Rotors that were not seen or could not be where they said, shape (N,)."""
    placed: bool
    """Whether the filled ones are where the orbit has them, rather than like their neighbours."""
    others: bool
    """Whether rotors side by side are further from the orbit than half of what they turn."""

    number_filled: int
    """Number of rotors that were filled in."""

    @property
    def seen(self) -> Array:
        """Angles [rad], shape (N,), NaN where they were filled in."""
        return np.where(self.filled, np.nan, self.angles) if self.number_filled else self.angles


class OnOrbit(NamedTuple):
    """Where an orbit has the rotors of a frame, each of shape (N,)."""

    angles: Array
    """Actual angles [rad], up to whole turns."""
    rates: Array
    """Rates [rad/s]."""
    residuals: Array
    """Angles of the frame less these [rad], from -pi to pi, NaN where they are not known."""


def on_orbit(orbit: Orbit, estimate: OrbitEstimate, residuals: Array) -> OnOrbit:
    """Return where an estimate has the rotors, with the residuals of a frame [rad], (N,)."""
    angles = orbit.configuration(estimate.arc)
    rates = orbit.tangent(estimate.arc) * estimate.rate
    if estimate.upside_down:
        return OnOrbit(math.pi - angles, -rates, -residuals)
    return OnOrbit(angles, rates, residuals)


class Unwrapper:
    """Takes whole turns out of the steps of angles from frame to frame."""

    def __init__(self, number_of_rotors: int) -> None:
        """Begin without any frame."""
        self._turns = np.zeros(number_of_rotors)
        self._last = np.full(number_of_rotors, np.nan)

    @property
    def last(self) -> Array:
        """Angle at which each rotor was last seen [rad], shape (N,), NaN where it never was."""
        return np.asarray(self._last + 2 * math.pi * self._turns)

    def unwrapped(self, angles: Array) -> Array:
        """Angles [rad], shape (N,), NaN where they are not finite or too large to be any."""
        seen = np.empty(len(self._last))
        read = np.ascontiguousarray(angles, dtype=np.float64)
        unwrap(read, self._last, self._turns, seen)
        return seen


def complete(
    chain: Chain, angles: Array, rates: Array | None, expected: OnOrbit | None, last: Array
) -> CompletedFrame:
    """Fill in what a frame lacks, from the orbit or, without one, from neighbours.

    Angles [rad] and rates [rad/s] of shape (N,), NaN where they are not known, and the last
    angles of each rotor, which tell its turns. One rotor alone that the orbit has elsewhere, by
    more than half of what a rotor turns as a wall passes, is taken for not seen.
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
    elsewhere = np.abs(expected.residuals) > swing_of(chain) / 2
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


def whole_frame(
    chain: Chain, angles: Array, rates: Array | None, largest: float
) -> CompletedFrame | None:
    """Return a frame whose residuals are small, by the largest of them [rad], else None."""
    if not largest <= swing_of(chain) / 2:
        return None
    return CompletedFrame(angles, rates, np.zeros(len(angles), dtype=np.bool_), True, False, 0)


def _like_neighbours(angles: Array) -> Array:
    """Angles with those that are NaN between the leans of the nearest that are not."""
    unseen = np.isnan(angles)
    if not unseen.any() or unseen.all():
        return angles
    rotors, theta = np.arange(len(angles)), staggered(angles)
    leans = [np.interp(rotors, rotors[~unseen], each(theta[~unseen])) for each in (np.sin, np.cos)]
    return np.where(unseen, staggered(np.arctan2(*leans)), angles)
