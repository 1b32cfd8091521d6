# SPDX-License-Identifier: Apache-2.0
"""Trajectory of a soliton (site as a function of time), and crossings of the chain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Protocol

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.tanh_fit import find_solitons

_EDGE_PART = 0.2
"""Length of the outer region at each end of the chain, in which walls are reflected, as a fraction
of the chain [1]. A crossing does not include the outer regions."""


@dataclass(frozen=True)
class Track:
    """Site and rate of the soliton with the lowest site in each frame; NaN without a soliton.

    If the number of solitons changes, the soliton with the lowest site may be another one.
    """

    times: Array
    """Times of the T frames [s], shape (T,)."""
    sites: Array
    """Site coordinate of the centre of the soliton [rotor spacings], shape (T,)."""
    site_rates: Array
    """Rate of the site coordinate [rotor spacings / s], shape (T,)."""
    site_deviations: Array = field(default_factory=lambda: np.empty(0))
    """Standard deviation of the site [rotor spacings], shape (T,), or (0,) if unknown."""
    site_rate_deviations: Array = field(default_factory=lambda: np.empty(0))
    """Standard deviation of the rate [rotor spacings / s], shape (T,), or (0,) if unknown."""
    others: Array = field(default_factory=lambda: np.empty((0, 0)))
    """Site coordinates of all other solitons in each frame, in increasing order [rotor spacings],
    shape (K, T), NaN where there are fewer."""


@dataclass(frozen=True)
class Crossing:
    """Passage of a soliton from one outer fifth of the chain to the other outer fifth."""

    start: float
    """Time of the last frame with the soliton in the outer fifth at one end [s]."""
    end: float
    """Time of the first frame with the soliton in the outer fifth at the other end [s]."""
    direction: int
    """Direction: +1 towards the last rotor, -1 towards rotor 0."""
    site_rate: float
    """Speed [rotor spacings / s]: absolute slope of a line fitted to the sites of the soliton."""


class MeasuredWall(Protocol):
    """Interface of an estimated wall, with standard deviations."""

    @property
    def rotor(self) -> float:
        """Site coordinate of the centre [rotor spacings]."""

    @property
    def velocity(self) -> float:
        """Velocity of the centre [m/s]."""

    @property
    def position_deviation(self) -> float:
        """Standard deviation of the position of the centre [m]."""

    @property
    def velocity_deviation(self) -> float:
        """Standard deviation of the velocity [m/s]."""


def measured_track(chain: Chain, times: Array, walls: Sequence[Sequence[MeasuredWall]]) -> Track:
    """Return the trajectories of walls.

    `walls` contains the walls in the frame at each of the `times` [s], shape (T,). The walls of a
    frame must be sorted by their sites.
    """
    rows = np.full((len(walls), 4), np.nan)
    others = np.full((max([1, *map(len, walls)]) - 1, len(walls)), np.nan)
    for frame, (row, found) in enumerate(zip(rows, walls, strict=True)):
        if found:
            others[: len(found) - 1, frame] = [wall.rotor for wall in found[1:]]
            wall = found[0]
            row[:] = wall.rotor, wall.velocity, wall.position_deviation, wall.velocity_deviation
    rows[:, 1:] /= chain.spacing
    sites, site_rates, deviations, rate_deviations = rows.T
    return Track(times, sites, site_rates, deviations, rate_deviations, others)


def follow(chain: Chain, recording: Recording) -> Track:
    """Return the trajectory of the soliton with the lowest site in each frame of a recording."""
    rates = recording.rates if len(recording.rates) else [None] * len(recording.times)
    frames = zip(recording.angles, rates, strict=True)
    track = measured_track(
        chain, recording.times, [find_solitons(chain, *each) for each in frames]
    )
    return Track(track.times, track.sites, track.site_rates)


def find_crossings(chain: Chain, track: Track) -> tuple[Crossing, ...]:
    """Return the passages from one outer fifth of the chain to the other, sorted by time."""
    last = chain.number_of_rotors - 1
    side = np.zeros(len(track.times), dtype=np.int8)
    side[track.sites <= _EDGE_PART * last] = -1
    side[track.sites >= (1 - _EDGE_PART) * last] = 1
    crossings = []
    for left, entered in pairwise(np.flatnonzero(side)):
        if side[left] == side[entered]:
            continue
        passage = slice(left, entered + 1)
        found = np.isfinite(track.sites[passage])
        slope = np.polyfit(track.times[passage][found], track.sites[passage][found], 1)[0]
        start, end = float(track.times[left]), float(track.times[entered])
        crossings.append(Crossing(start, end, int(side[entered]), float(abs(slope))))
    return tuple(crossings)
