# SPDX-License-Identifier: Apache-2.0
"""What is known of where a chain is on its orbit, and on what that rests."""

from __future__ import annotations

import enum
import math
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
    place_rate_deviation: standard deviation of that rate [rotor spacings / s].
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
    place: float = math.nan
    place_rate: float = math.nan
    place_deviation: float = math.nan
    place_rate_deviation: float = math.nan
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
