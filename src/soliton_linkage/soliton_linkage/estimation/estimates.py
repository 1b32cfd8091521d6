# SPDX-License-Identifier: Apache-2.0
"""Results of the estimation: orbit estimates, solitons and events."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple


class TrackingStatus(enum.Enum):
    """Tracking status: the frames on which an estimate is based."""

    LOST = 'lost'
    """No estimate: no frame has matched the orbit since the start, or since the wall was lost."""
    ACQUIRED = 'acquired'
    """The estimate is based on one frame; the rate is known only to an order of magnitude."""
    TRACKING = 'tracking'
    """The estimate is based on this frame and earlier frames."""
    COASTING = 'coasting'
    """The estimate is based on earlier frames; the current frame is empty or implausible."""


class OrbitEstimate(NamedTuple):
    """Estimated state of a chain on its orbit; unknown quantities are NaN.

    time: time of the estimate, counted from the first frame [s].
    status: tracking status.
    arc: arc length along the orbit [rad]; it increases by the length of the orbit in each cycle.
    rate: rate of change of the arc length [rad/s].
    arc_deviation: standard deviation of the arc length [rad].
    rate_deviation: standard deviation of the rate of the arc length [rad/s].
    covariance: covariance of the arc length and the rate [rad^2/s].
    site: site of the wall [rotor spacings].
    site_rate: rate of change of the site [rotor spacings / s]; 0 while the wall is at an edge.
    site_deviation: standard deviation of the site [rotor spacings].
    site_rate_deviation: standard deviation of the rate of the site [rotor spacings / s].
    leg: number of the current leg (part of the orbit between two reflections of the wall); -1 if
        lost.
    leg_known: whether the frames exclude all other legs in which the wall has the same site.
    noise: standard deviation of the noise of an angle [rad], either given or estimated.
    misfit: root mean square residual of the rotors near the wall in recent frames [rad].
    frame_misfit: root mean square residual in this frame [rad]; NaN if COASTING or LOST.
    upside_down: whether the chain is upside down, so that the angles pi - phi follow the orbit.
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
    noise: float = math.nan
    misfit: float = math.nan
    frame_misfit: float = math.nan
    upside_down: bool = False


def lost(time: float, noise: float = math.nan) -> OrbitEstimate:
    """Return the estimate with status LOST at a time [s]; `noise` is as in `OrbitEstimate`."""
    return OrbitEstimate(time, TrackingStatus.LOST, noise=noise)


class AnalysedSoliton(NamedTuple):
    """Measured wall; an unknown quantity and its standard deviation are NaN.

    id: identifier of the wall, 1 or more; 0 if walls are not tracked from frame to frame.
    rotor: distance from rotor 0 to the centre of the wall [rotor spacings].
    position: distance from the pivot of rotor 0 to the centre of the wall [m].
    velocity: velocity of the centre [m/s], positive towards the last rotor.
    width: measured width w of the profile tanh(x / w) [m]; NaN for a non-uniform chain.
    theory_width: width that continuum theory predicts at this velocity [m].
    charge: +1 if the rotors between rotor 0 and the wall lean towards the last rotor, so that
        sin(phi) > 0, and the rotors beyond the wall towards rotor 0; -1 in the opposite case.
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
    """Kind of event that changes the number, the identity or the motion of walls."""

    FOUND = 'found'
    """A wall was in the first frame, or appeared inside the chain for no visible reason."""
    LOST = 'lost'
    """A wall disappeared inside the chain for no visible reason."""
    BIRTH_AT_EDGE = 'birth at an edge'
    """A wall entered from an edge."""
    DEATH_AT_EDGE = 'death at an edge'
    """A wall disappeared at an edge and did not return."""
    REFLECTION = 'reflection'
    """A wall was reflected at an edge."""
    BIRTH_OF_PAIR = 'birth of a pair'
    """A kink and an anti-kink were created at one site."""
    ANNIHILATION = 'annihilation'
    """A kink and an anti-kink annihilated; their energy was radiated as waves."""
    BOUNCE = 'bounce'
    """A kink and an anti-kink collided, and each returned to the side from which it had come. In
    flippers, the two cases BOUNCE and PASSING are not distinguished, and both are BOUNCE."""
    PASSING = 'passing'
    """A kink and an anti-kink of a spinner collided, and each continued to the other side. A wall
    is recognised by the sense in which the angles turn across it. Charges alternate along a chain.
    Therefore each wall then has the charge that the other one had."""
    BREATHER_FORMED = 'breather formed'
    """A kink and an anti-kink formed a bound, oscillating pair."""
    BREATHER_DECAYED = 'breather decayed'
    """The kink and the anti-kink of a breather separated or annihilated."""


@dataclass(frozen=True)
class SolitonEvent:
    """Event of one or two walls, reported with the frame that has confirmed the event.

    kind: kind of the event.
    time: time of the event, counted from the first frame [s].
    rotor: site of the event [rotor spacings].
    ids_before: identifiers of the walls before the event, sorted by site; a breather has one
        identifier.
    ids_after: identifiers of the walls after the event, sorted by site.
    charge_before: sum of the charges of the walls before the event.
    charge_after: sum of the charges of the walls after the event.
    energy_before: energy of the walls before the event, without the waves around them [J]; NaN if
        unknown.
    energy_after: energy of the walls after the event, without the waves around them [J]; NaN if
        unknown.
    collisions: number of times that the two walls overlapped before this event.
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
