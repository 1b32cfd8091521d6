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

from soliton_linkage import frame_arrays
from soliton_linkage.chain import Array, Motion
from soliton_linkage.frame_arrays import FrameSines, frame_loops, sines_of

_SURE = 0.95
_FEWEST = 4
_LEANING = 3.0
_FINEST = 1e-6
_STRONGEST_FRAME = 10.0
_STRONGEST = 30.0
_FLAT = 0.02
_FLAT_IN_NOISE = 2.0
_NOISIEST = 0.15
_FREEDOM_OF_BEND = 0.1
_SPREAD = 1.2
_NEGLECTED = 0.01


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
        flipping = min(max(self.flipping + other.flipping, -_STRONGEST), _STRONGEST)
        known = [each for each in (self, other) if math.isfinite(each.rest_angle)]
        whole = sum(each._weight for each in known)
        turned = sum(each._weight * each.rest_angle for each in known)
        mean = turned / whole if known else math.nan
        return MotionEvidence(other.place, flipping, mean, self.tails + other.tails)

    def swapped(self) -> MotionEvidence:
        """Return the same evidence, with the sides exchanged."""
        return MotionEvidence(self.place, self.flipping, self.rest_angle, self.tails[::-1])

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
        sums: list[list[list[float]]] = self.tails.tolist()
        sides = [_solved(each, self.rest_angle) for each in sums if each[0][0] > 0]
        if not sides:
            return math.nan, math.inf
        variance = 1 / sum(1 / of_side for _, of_side in sides)
        ratio = variance * sum(each / of_side for each, of_side in sides)
        apart = sum((each - ratio) ** 2 / of_side for each, of_side in sides)
        return ratio, math.sqrt(variance * max(1.0, apart) + _NEGLECTED**2)

    @property
    def _weight(self) -> float:
        """How much the tails tell; never quite nothing."""
        return 1e-300 + float(self.tails[0, 0, 0]) + float(self.tails[1, 0, 0])


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
    rotors = len(frame.angles)
    bond, before, beyond = frame_loops().bond_of_wall(frame.sines)
    if not _FEWEST < bond < rotors - _FEWEST:
        return NO_EVIDENCE
    left = _Side(frame, bond - 1, 0)
    right = _Side(frame, bond, rotors - 1)
    if min(left.count, right.count) < 2:
        return NO_EVIDENCE
    spread = math.sqrt((left.scatter + right.scatter) / (left.count + right.count - 2))
    noise = max(noise, spread, _FINEST)
    if not _opposed(left, right, noise):
        return NO_EVIDENCE
    tails = np.zeros((2, 3, 3))
    left.add_tail(noise, tails[0])
    right.add_tail(noise, tails[1])
    lean = math.pi / 2 - (abs(left.steepness) + abs(right.steepness)) / 2
    crossing = bond - 1 + (before / (before - beyond) if before * beyond < 0 else 0.5)
    return MotionEvidence(crossing, _flipping(left, right, noise), lean, tails)


def next_deviation(deviations: Array, rest_angle: float, ratio: float = 0.0) -> Array:
    """Deviation from rest of the outer neighbour of a rotor on relaxed bars [rad], shape (...).

    With alpha = theta_bar + e the angle by which a rotor leans, alpha' that of its neighbour
    further from the wall and k = a / r, the bar between them has its length where
    cos(alpha + alpha') + k (sin(alpha) - sin(alpha')) = cos(2 theta_bar). The ratio lambda says
    k = 2 sin(theta_bar) / d; F(e) is for lambda = 0.
    """
    return frame_arrays.next_deviation(deviations, rest_angle, _pitch(rest_angle, ratio))[0]


def slope_of_next(deviations: Array, rest_angle: float, ratio: float = 0.0) -> Array:
    """Derivative of `next_deviation` by the deviation [1], lambda at 0, shape (...)."""
    return frame_arrays.next_deviation(deviations, rest_angle, _pitch(rest_angle, ratio))[1]


class _Side:
    """The rotors on one side of a wall, without that at the edge."""

    def __init__(self, frame: FrameSines, nearest: int, edge: int) -> None:
        self._angles, self._nearest, self._edge = frame.angles, nearest, edge
        self.count, sine, cosine, self.mean, self.scatter = frame_loops().uniform_part(
            frame.angles, frame.sines, frame.cosines, nearest, edge
        )
        self._handed = (1 if sine > 0 else -1) * (1 if cosine > 0 else -1)

    @property
    def steepness(self) -> float:
        """Angle of the uniform part above the horizontal [rad]."""
        return math.asin(math.cos(self.mean))

    def add_tail(self, noise: float, sums: Array) -> None:
        """Add products of (e, e^2, e' - F(e)) over the variance of e', shape (3, 3)."""
        rest = math.pi / 2 - abs(self.steepness)
        if noise > _NOISIEST * rest:
            return
        flat = max(_FLAT_IN_NOISE * noise, _FLAT * rest)
        frame_loops().tail_products(
            self._angles, self._nearest, self._edge, self.mean, self._handed, rest, flat, sums
        )
        sums /= noise**2 * (_SPREAD + 1 / self.count)


def _pitch(rest_angle: float, ratio: float) -> float:
    """Return k = a / r = 2 sin(theta_bar) (1 + lambda) / (1 - lambda)."""
    return 2 * math.sin(rest_angle) * (1 + ratio) / (1 - ratio)


def _opposed(left: _Side, right: _Side, noise: float) -> bool:
    """Whether the two sides lean to opposite sides beyond doubt."""
    leans = [math.sin(each.mean) * math.sqrt(each.count) / noise for each in (left, right)]
    return leans[0] * leans[1] < 0 and min(map(abs, leans)) > _LEANING


def _flipping(left: _Side, right: _Side, noise: float) -> float:
    """Log likelihood of theta_right = -theta_left less that of theta_left + pi, for a frame.

    Where neither is met to within the noise, as in a wake or with deviations, the variance is
    what the better of the two needs.
    """
    flipped = math.remainder(right.mean + left.mean, 2 * math.pi) ** 2
    spun = math.remainder(right.mean - left.mean - math.pi, 2 * math.pi) ** 2
    variance = noise**2 * (1 / left.count + 1 / right.count)
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return float(min(max(likelihood, -_STRONGEST_FRAME), _STRONGEST_FRAME))


def _solved(sums: list[list[float]], rest_angle: float) -> tuple[float, float]:
    """Ratio lambda [1] and its variance, with the term in e^2 at most about 0.1 / theta_bar."""
    first, both = sums[0][0] + 1, sums[0][1]
    second = sums[1][1] + (rest_angle / _FREEDOM_OF_BEND) ** 2
    determinant = first * second - both**2
    ratio = (second * sums[0][2] - both * sums[1][2]) / determinant
    return ratio, second / determinant
