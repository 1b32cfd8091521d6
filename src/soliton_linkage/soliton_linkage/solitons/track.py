# SPDX-License-Identifier: Apache-2.0
"""The path of a soliton along the chain, and how often and how fast it crossed it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.tanh_fit import find_solitons

_EDGE_SHARE = 0.2
"""Of the chain at each end [1]: swings there, where a wall waits, are no part of a crossing."""


@dataclass(frozen=True)
class Track:
    """Place of the first soliton of each frame and its rate; NaN where there was none."""

    times: Array
    """Instants of the frames [s], shape (T,)."""
    sites: Array
    """Centre of the soliton [rotor spacings], shape (T,)."""
    site_rates: Array
    """Rate of the centre [rotor spacings / s], shape (T,)."""
    site_deviations: Array = field(default_factory=lambda: np.empty(0))
    """Standard deviation of the centre [rotor spacings], shape (T,), or empty where unknown."""
    site_rate_deviations: Array = field(default_factory=lambda: np.empty(0))
    """Standard deviation of the rate [rotor spacings / s], shape (T,), or empty where unknown."""


@dataclass(frozen=True)
class Crossing:
    """One passage of a soliton between the outer fifths of the chain."""

    start: float
    """When it left the fifth that it came from [s]."""
    end: float
    """When it reached the opposite fifth [s]."""
    direction: int
    """+1 towards the last rotor, -1 towards rotor 0."""
    site_rate: float
    """Slope of a straight line through the passage [rotor spacings / s], positive."""


class MovingWall(Protocol):
    """A wall of which place and velocity are known, however they were found."""

    @property
    def rotor(self) -> float:
        """Centre [rotor spacings]."""

    @property
    def velocity(self) -> float:
        """Of the centre [m/s]."""


class MeasuredWall(MovingWall, Protocol):
    """A wall of which it is known how well it is known."""

    @property
    def position_deviation(self) -> float:
        """Standard deviation of the centre [m]."""

    @property
    def velocity_deviation(self) -> float:
        """Standard deviation of the velocity [m/s]."""


def track_point(chain: Chain, solitons: Sequence[MovingWall]) -> tuple[float, float]:
    """Place [rotor spacings] of the first soliton and its rate [rotor spacings / s], or NaN."""
    if not solitons:
        return np.nan, np.nan
    return solitons[0].rotor, solitons[0].velocity / chain.spacing


def measured_track(chain: Chain, times: Array, walls: Sequence[Sequence[MeasuredWall]]) -> Track:
    """Track of the first wall of each frame with its uncertainties; times [s] of shape (T,)."""
    spacing, nothing = chain.spacing, (np.nan,) * 4
    points = [
        (
            found[0].rotor,
            found[0].velocity / spacing,
            found[0].position_deviation / spacing,
            found[0].velocity_deviation / spacing,
        )
        if found
        else nothing
        for found in walls
    ]
    return Track(times, *np.array(points, dtype=np.float64).reshape(-1, 4).T)


def follow(chain: Chain, recording: Recording) -> Track:
    """Find the soliton in every frame of a recording."""
    rates = recording.rates if len(recording.rates) else [None] * len(recording.times)
    points = [
        track_point(chain, find_solitons(chain, angles, rate))
        for angles, rate in zip(recording.angles, rates, strict=True)
    ]
    places = np.array(points, dtype=np.float64).reshape(-1, 2)
    return Track(recording.times, places[:, 0], places[:, 1])


def find_crossings(chain: Chain, track: Track) -> tuple[Crossing, ...]:
    """Return the passages from one outer fifth of the chain to the other, in order of time."""
    last = chain.number_of_rotors - 1
    side = np.zeros(len(track.times), dtype=np.int8)
    side[track.sites <= _EDGE_SHARE * last] = -1
    side[track.sites >= (1 - _EDGE_SHARE) * last] = 1
    outer = np.flatnonzero(side)
    crossings = []
    for left, entered in pairwise(outer):
        if side[left] == side[entered]:
            continue
        passage = slice(left, entered + 1)
        seen = np.isfinite(track.sites[passage])
        slope = np.polyfit(track.times[passage][seen], track.sites[passage][seen], 1)[0]
        crossings.append(
            Crossing(
                start=float(track.times[left]),
                end=float(track.times[entered]),
                direction=int(side[entered]),
                site_rate=float(abs(slope)),
            )
        )
    return tuple(crossings)
