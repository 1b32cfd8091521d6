# SPDX-License-Identifier: Apache-2.0
"""Frames as encoders give them, made whole: without jumps of turns, offsets and gaps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.loops import frame_loops
from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.estimation.places.frame_view import FrameView, swing_of
from soliton_linkage.estimation.places.orbit_estimate import OrbitEstimate
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.orbit.orbit import Orbit


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


def on_orbit(orbit: Orbit, estimate: OrbitEstimate, view: FrameView | None) -> OnOrbit:
    """Where an estimate has the rotors, and how a frame, as it was viewed, differs from that."""
    angles = orbit.configuration(estimate.arc)
    rates = orbit.tangent(estimate.arc) * estimate.rate
    residuals = np.full_like(angles, np.nan) if view is None else view.residuals
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
        frame_loops.unwrap(read, self._last, self._turns, seen)
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
    chain: Chain, angles: Array, rates: Array | None, view: FrameView | None
) -> CompletedFrame | None:
    """A frame whose rates are known and angles as the orbit has them, by its view, else None."""
    if view is None or not view.largest <= swing_of(chain) / 2:
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
