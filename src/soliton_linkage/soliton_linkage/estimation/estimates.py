# SPDX-License-Identifier: Apache-2.0
"""Estimates of the wall on the orbit, solitons and events: the results that a frame adds up to."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple


class TrackingStatus(enum.Enum):
    """What an estimate rests on."""

    LOST = 'lost'
    """On nothing: no frame has been recognised."""
    ACQUIRED = 'acquired'
    """On one frame, searched along the whole orbit; of the rate only its scale is known."""
    TRACKING = 'tracking'
    """On this frame and those before."""
    COASTING = 'coasting'
    """On frames before; this one was empty or could not be."""


class OrbitEstimate(NamedTuple):
    """Where a chain is on its orbit; NaN, and leg -1, while it is lost.

    time: instant of the estimate [s].
    status: what it rests on.
    arc: arc length along the orbit [rad], which counts cycles.
    rate: rate of the arc length [rad/s].
    arc_deviation: standard deviation of the arc length [rad].
    rate_deviation: standard deviation of the rate [rad/s].
    covariance: covariance of arc length and rate [rad^2/s].
    place: place of the wall [rotor spacings].
    place_rate: rate of the place [rotor spacings / s], 0 while the wall waits at an edge.
    place_deviation: standard deviation of the place [rotor spacings].
    site_rate_deviation: standard deviation of that rate [rotor spacings / s].
    leg: leg of the orbit.
    leg_known: whether it can be no other leg with the wall at the same place. A flipper whose edge
        rotors were not seen may be on two legs or on four, of which leg, arc, rate and phase
        follow one.
    phase: phase of the cycle [rad], 2 pi arc / length from 0 to 2 pi.
    completed_cycles: whole cycles gone round; the phase grows on by 2 pi with each.
    noise: standard deviation of the angles' noise in use [rad], given or estimated.
    misfit: root mean square of what the orbit leaves of the rotors about the wall, of late [rad].
    frame_misfit: the same of this frame alone [rad], NaN for one that was empty.
    upside_down: whether the chain is the image phi -> pi - phi of the orbit's.
    """

    time: float
    status: TrackingStatus
    arc: float = math.nan
    rate: float = math.nan
    arc_deviation: float = math.nan
    rate_deviation: float = math.nan
    covariance: float = math.nan
    site: float = math.nan
    site_rate: float = math.nan
    site_deviation: float = math.nan
    site_rate_deviation: float = math.nan
    leg: int = -1
    leg_known: bool = False
    phase: float = math.nan
    completed_cycles: int = 0
    noise: float = math.nan
    misfit: float = math.nan
    frame_misfit: float = math.nan
    upside_down: bool = False


def lost(time: float, noise: float = math.nan) -> OrbitEstimate:
    """Estimate of an instant [s] at which nothing is known, but for the noise [rad]."""
    return OrbitEstimate(time, TrackingStatus.LOST, noise=noise)


class AnalysedSoliton(NamedTuple):
    """One wall; a quantity that cannot be told is NaN, and so is its standard deviation.

    id: its name for as long as it is followed, from 1 on; 0 where walls are not followed.
    rotor: centre in rotor spacings from rotor 0.
    position: centre [m] from the pivot of rotor 0.
    velocity: of the centre [m/s], positive towards the last rotor.
    width: width w of tanh(x / w) [m]; NaN in chains with deviations.
    theory_width: width that the continuum theory gives a wall of this velocity [m].
    charge: +1: leans right on the side of rotor 0 and left beyond, free at rest; -1: the opposite.
    position_deviation: standard deviation of the position [m].
    velocity_deviation: standard deviation of the velocity [m/s].
    width_deviation: standard deviation of the width [m].
    """

    id: int
    rotor: float
    position: float
    velocity: float
    width: float
    theory_width: float
    charge: int
    position_deviation: float
    velocity_deviation: float
    width_deviation: float


class EventKind(enum.Enum):
    """What happened."""

    FOUND = 'found'
    """A wall that was there before, or of which no frame showed how it came."""
    LOST = 'lost'
    """A wall of which no frame showed how it went."""
    BIRTH_AT_EDGE = 'birth at an edge'
    """A wall came from an edge."""
    DEATH_AT_EDGE = 'death at an edge'
    """A wall went into an edge and did not come back."""
    REFLECTION = 'reflection'
    """A wall came back from an edge."""
    BIRTH_OF_PAIR = 'birth of a pair'
    """A kink and an anti-kink came from one place."""
    ANNIHILATION = 'annihilation'
    """A kink and an anti-kink went up in waves."""
    BOUNCE = 'bounce'
    """A kink and an anti-kink met and parted, each on its side."""
    PASSING = 'passing'
    """A kink and an anti-kink passed through each other and exchanged their charges."""
    BREATHER_FORMED = 'breather formed'
    """A kink and an anti-kink swing about each other."""
    BREATHER_DECAYED = 'breather decayed'
    """They do so no more."""


@dataclass(frozen=True)
class SolitonEvent:
    """An event, told with the frame that made sure of it.

    kind: what happened.
    time: when it did [s], on the clock of the frames from the first on.
    rotor: where it did [rotor spacings].
    ids_before: who took part, from rotor 0 on; for a breather its own.
    ids_after: who was there afterwards.
    charge_before: sum of the charges of those before.
    charge_after: sum of the charges of those afterwards.
    energy_before: energy within reach of those before [J], as they were free; NaN if unknown.
    energy_after: energy within reach of those afterwards [J].
    collisions: how often two overlapped.
    """

    kind: EventKind
    time: float
    rotor: float
    ids_before: tuple[int, ...] = ()
    ids_after: tuple[int, ...] = ()
    charge_before: int = 0
    charge_after: int = 0
    energy_before: float = 0.0
    energy_after: float = 0.0
    collisions: int = 0
