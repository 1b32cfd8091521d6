# SPDX-License-Identifier: Apache-2.0
"""Results of the estimation: orbit estimates, solitons and events."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple


class TrackingStatus(enum.Enum):
    """Basis of an estimate."""

    LOST = 'lost'
    """No frame has been recognised."""
    ACQUIRED = 'acquired'
    """One frame, located by a search along the whole orbit; only the scale of the rate is known.
    """
    TRACKING = 'tracking'
    """This frame and earlier ones."""
    COASTING = 'coasting'
    """Earlier frames only; this one was empty or implausible."""


class OrbitEstimate(NamedTuple):
    """State of a chain on its orbit; NaN, and leg -1, while it is lost.

    time: instant of the estimate [s].
    status: basis of the estimate.
    arc: arc length along the orbit [rad], which counts cycles.
    rate: rate of the arc length [rad/s].
    arc_deviation: standard deviation of the arc length [rad].
    rate_deviation: standard deviation of the rate [rad/s].
    covariance: covariance of arc length and rate [rad^2/s].
    site: site of the wall [rotor spacings].
    site_rate: rate of the site [rotor spacings / s], 0 while the wall waits at an edge.
    site_deviation: standard deviation of the site [rotor spacings].
    site_rate_deviation: standard deviation of the rate of the site [rotor spacings / s].
    leg: leg of the orbit.
    leg_known: whether the frames exclude the other legs with the wall at the same site. Two or
        four legs of a flipper are possible if edge rotors are unseen; leg, arc and rate then
        belong to one of them.
    noise: standard deviation of the noise of an angle [rad], given or estimated.
    misfit: root mean square residual of the rotors near the wall in recent frames [rad].
    frame_misfit: misfit of this frame alone [rad], NaN if the frame is empty.
    upside_down: whether the chain is the mirror image phi -> pi - phi of the chain of the orbit.
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
    """Return the estimate of a lost chain at an instant [s], with the noise [rad] if known."""
    return OrbitEstimate(time, TrackingStatus.LOST, noise=noise)


class AnalysedSoliton(NamedTuple):
    """One wall; an unknown quantity and its standard deviation are NaN.

    id: identifier while the wall is followed, from 1 on; 0 if walls are not followed.
    rotor: centre [rotor spacings] from rotor 0.
    position: centre [m] from the pivot of rotor 0.
    velocity: velocity of the centre [m/s], positive towards the last rotor.
    width: width w of tanh(x / w) [m]; NaN in chains with deviations.
    theory_width: width at this velocity by continuum theory [m].
    charge: +1 if the rotors lean right on the side of rotor 0 and left on the other side, else -1.
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
    """Kind of an event."""

    FOUND = 'found'
    """A wall appeared without a visible origin, or was present in the first frame."""
    LOST = 'lost'
    """A wall disappeared without a visible cause."""
    BIRTH_AT_EDGE = 'birth at an edge'
    """A wall entered from an edge."""
    DEATH_AT_EDGE = 'death at an edge'
    """A wall left through an edge and did not return."""
    REFLECTION = 'reflection'
    """A wall was reflected at an edge."""
    BIRTH_OF_PAIR = 'birth of a pair'
    """A kink and an anti-kink were created at one site."""
    ANNIHILATION = 'annihilation'
    """A kink and an anti-kink annihilated into waves."""
    BOUNCE = 'bounce'
    """A kink and an anti-kink collided and separated, each on its own side."""
    PASSING = 'passing'
    """A kink and an anti-kink passed through each other and exchanged their charges."""
    BREATHER_FORMED = 'breather formed'
    """A kink and an anti-kink formed a bound, oscillating pair."""
    BREATHER_DECAYED = 'breather decayed'
    """The walls of a breather separated or annihilated."""


@dataclass(frozen=True)
class SolitonEvent:
    """Event, reported with the frame that confirmed it.

    kind: kind of the event.
    time: instant of the event since the first frame [s].
    rotor: site of the event [rotor spacings].
    ids_before: identifiers of the walls before the event, from rotor 0 on; a breather has its own
        identifier.
    ids_after: identifiers of the walls after the event.
    charge_before: sum of the charges before the event.
    charge_after: sum of the charges after the event.
    energy_before: energy of the walls before the event, without the wake [J]; NaN if unknown.
    energy_after: the same after the event [J].
    collisions: number of overlaps of two walls.
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
