# SPDX-License-Identifier: Apache-2.0
"""How a wall moves, told from the angles alone, without the parameters of their chain.

A wall lies where u = r sin(phi) changes its sign. On its two sides the chain leans to the right
and to the left by the same angle: rotors of a flipper pass from one to the other through the
top or through the bottom, theta_right = -theta_left, and their staggered cosines have the same
sign; those of a spinner turn over, theta_right = theta_left + pi, and they have opposite signs.

A flipper that wobbles leans over by more than its angle at rest beside the wall. Outwards from
one rotor to the next its deviation e from rest goes over, for bars of fixed length and d = 1,
into F(e), `next_deviation`, which has a maximum of 0 at e = 0; for any d the slope there is

    lambda = (1 - d) / (1 + d),    e' = F(e) + lambda e + ...,

so that a chain wobbles where lambda is below 0. Springs in motion keep the sign of lambda ahead
of the wall, and may bend the rest, for which a term in e^2 stands. Behind a fast wall phonons
disturb both: where its two sides differ by more than the noise, the deviation grows with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.estimation.loops import tail_arrays
from soliton_linkage.estimation.loops.frame_arrays import FrameSines, sines_of
from soliton_linkage.estimation.loops.tail_arrays import tail_loops
from soliton_linkage.linkage.chain import Array, Motion

_SURE = 0.95


@dataclass(frozen=True)
class MotionClass:
    """Class of motion that the angles speak for."""

    motion: Motion | None
    """None where the data cannot tell: there is no wall, or too much noise."""
    confidence: float
    """Probability of the likeliest class, 0 to 1; the three are equally likely without data."""
    spinning: float
    """Probability that the rotors spin, 0 to 1."""
    tail_ratio: float
    """Deviation of a rotor over that of its inner neighbour, lambda [1]; NaN where unknown."""
    tail_ratio_deviation: float
    """Standard deviation of lambda [1], infinite where it is unknown."""


@dataclass(frozen=True)
class MotionEvidence:
    """What frames say of the motion; evidence of independent frames adds."""

    place: float
    """Where u changes its sign [rotor spacings], in the last frame; NaN without a wall."""
    flipping: float
    """Log likelihood of a flipper less that of a spinner [1]."""
    rest_angle: float
    """Mean angle that the uniform parts lean by [rad]; NaN without a wall."""
    tails: Array
    """Sums of products of (e, e^2, e' - F(e)) over their variance, left and right, (2, 3, 3)."""

    def __add__(self, other: MotionEvidence) -> MotionEvidence:
        """Return the evidence of both, other being the later; whoever contradicts is heard.

        The sum of log likelihoods is limited, for errors that stay the same in all frames.
        """
        sums = np.empty((2, 3, 3))
        flipping, rest_angle = tail_loops().add_evidence(
            self.flipping,
            self.rest_angle,
            self.tails,
            other.flipping,
            other.rest_angle,
            other.tails,
            sums,
        )
        return MotionEvidence(other.place, flipping, rest_angle, sums)

    def swapped(self) -> MotionEvidence:
        """Return the same evidence, with the sides exchanged."""
        tails = self.tails[::-1].copy()
        return MotionEvidence(self.place, self.flipping, self.rest_angle, tails)

    def verdict(self) -> MotionClass:
        """Return the class; unknown where none of the three has a probability of 0.95."""
        ratio, deviation = self.tail_ratio()
        scaled = ratio / deviation if math.isfinite(ratio) else 0.0
        wobbling = math.erfc(scaled / math.sqrt(2)) / 2
        spinning = 1 / (1 + 2 * math.exp(self.flipping))
        share, motion = (1 - spinning) * (1 - wobbling), Motion.FLIPPER
        if (1 - spinning) * wobbling > share:
            share, motion = (1 - spinning) * wobbling, Motion.WOBBLING_FLIPPER
        if spinning > share:
            share, motion = spinning, Motion.SPINNER
        known = motion if share >= _SURE else None
        return MotionClass(known, share, spinning, ratio, deviation)

    def tail_ratio(self) -> tuple[float, float]:
        """Ratio lambda of the tails and its standard deviation [1]; NaN and infinity if unknown.

        Mean of both sides. Where they differ by more than they should, the deviation is as much
        larger. What springs in motion may do to it counts as 0.01.
        """
        found: tuple[float, float] = tail_loops().tail_ratio(self.tails, self.rest_angle)
        return found


NO_EVIDENCE = MotionEvidence(math.nan, 0.0, math.nan, np.zeros((2, 3, 3)))


class MotionObserver:
    """Adds up the evidence of the frames since the start or the last restart.

    Of a wall that moves the sides are those ahead of it and behind it.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all frames, as where the source of the angles has been started anew."""
        self.evidence = NO_EVIDENCE
        self._anchor = math.nan
        self._forwards = False

    def observe(self, angles: Array, noise: float = 0.0) -> MotionClass:
        """Add a frame to the evidence and return the class; arguments as `motion_evidence`."""
        return self._add(motion_evidence(angles, noise))

    def observe_sines(self, frame: FrameSines, noise: float) -> MotionClass:
        """The same of a frame whose sines and cosines are known."""
        return self._add(evidence_of(frame, noise))

    def _add(self, frame: MotionEvidence) -> MotionClass:
        if math.isfinite(frame.place) and not abs(frame.place - self._anchor) < 1:
            self._forwards = frame.place > self._anchor
            self._anchor = frame.place
        self.evidence += frame.swapped() if self._forwards else frame
        return self.evidence.verdict()


def motion_evidence(angles: Array, noise: float = 0.0) -> MotionEvidence:
    """Evidence of one frame of angles [rad], shape (N,), NaN where unknown, whole turns apart.

    The noise [rad], where it is known, is a lower bound of what the uniform parts show. A frame
    without a wall, with the wall within four rotors of an edge or with too few angles known
    says nothing. Raises ValueError for a noise that is negative or not finite, and for angles
    that are not one row.
    """
    if np.ndim(angles) != 1:
        raise ValueError(f'angles of shape {np.shape(angles)} must be one row, an angle a rotor')
    if not (math.isfinite(noise) and noise >= 0):
        raise ValueError(f'noise = {noise} rad must be a finite number of 0 or more')
    frame = sines_of(np.ascontiguousarray(angles, dtype=np.float64))
    return evidence_of(frame, noise)


def evidence_of(frame: FrameSines, noise: float) -> MotionEvidence:
    """The same, with sines and cosines."""
    tails = np.zeros((2, 3, 3))
    place, flipping, rest_angle = tail_loops().evidence(
        frame.angles, frame.sines, frame.cosines, noise, tails
    )
    if math.isnan(place):
        return NO_EVIDENCE
    return MotionEvidence(place, flipping, rest_angle, tails)


def next_deviation(deviations: Array, rest_angle: float, ratio: float = 0.0) -> Array:
    """Deviation from rest of the outer neighbour of a rotor on relaxed bars [rad], shape (...).

    With alpha = theta_bar + e the angle by which a rotor leans, alpha' that of its neighbour
    further from the wall and k = a / r, the bar between them has its length where
    cos(alpha + alpha') + k (sin(alpha) - sin(alpha')) = cos(2 theta_bar). The ratio lambda says
    k = 2 sin(theta_bar) / d; F(e) is for lambda = 0.
    """
    return tail_arrays.next_deviation(deviations, rest_angle, _pitch(rest_angle, ratio))[0]


def slope_of_next(deviations: Array, rest_angle: float, ratio: float = 0.0) -> Array:
    """Derivative of `next_deviation` by the deviation [1], lambda at 0, shape (...)."""
    return tail_arrays.next_deviation(deviations, rest_angle, _pitch(rest_angle, ratio))[1]


def _pitch(rest_angle: float, ratio: float) -> float:
    """Return k = a / r = 2 sin(theta_bar) (1 + lambda) / (1 - lambda)."""
    return 2 * math.sin(rest_angle) * (1 + ratio) / (1 - ratio)
