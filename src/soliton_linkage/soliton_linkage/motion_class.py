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
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from soliton_linkage.chain import Array, Motion, staggered

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
        weights = [1e-300 + float(each.tails[:, 0, 0].sum()) for each in (self, other)]
        angles = [each.rest_angle for each in (self, other)]
        known = [pair for pair in zip(weights, angles, strict=True) if math.isfinite(pair[1])]
        whole = sum(weight for weight, _ in known)
        mean = sum(weight * angle for weight, angle in known) / whole if known else math.nan
        return MotionEvidence(other.place, flipping, mean, self.tails + other.tails)

    def swapped(self) -> MotionEvidence:
        """Return the same evidence, with the sides exchanged."""
        return MotionEvidence(self.place, self.flipping, self.rest_angle, self.tails[::-1])

    def verdict(self) -> MotionClass:
        """Return the class; unknown where none of the three has a probability of 0.95."""
        ratio, deviation = self.tail_ratio()
        wobbling = float(ndtr(-ratio / deviation)) if math.isfinite(ratio) else 0.5
        spinning = float(expit(-self.flipping - math.log(2)))
        shares = {
            Motion.FLIPPER: (1 - spinning) * (1 - wobbling),
            Motion.WOBBLING_FLIPPER: (1 - spinning) * wobbling,
            Motion.SPINNER: spinning,
        }
        motion = max(shares, key=lambda each: shares[each])
        known = motion if shares[motion] >= _SURE else None
        return MotionClass(known, shares[motion], spinning, ratio, deviation)

    def tail_ratio(self) -> tuple[float, float]:
        """Ratio lambda of the tails and its standard deviation [1]; NaN and infinity if unknown.

        Mean of both sides. Where they differ by more than they should, the deviation is as much
        larger. What springs in motion may do to it counts as 0.01.
        """
        sides = [_solved(sums, self.rest_angle) for sums in self.tails if sums[0, 0] > 0]
        if not sides:
            return math.nan, math.inf
        ratios, variances = np.array(sides).T
        variance = 1 / float(np.sum(1 / variances))
        ratio = variance * float(np.sum(ratios / variances))
        apart = float(np.sum((ratios - ratio) ** 2 / variances))
        return ratio, math.sqrt(variance * max(1.0, apart) + _NEGLECTED**2)


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
        frame = motion_evidence(angles, noise)
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
    theta = staggered(angles)
    bond = _change_of_lean(theta)
    if not _FEWEST < bond < len(theta) - _FEWEST:
        return NO_EVIDENCE
    sides = [_Side(theta[1:bond][::-1]), _Side(theta[bond:-1])]
    if min(each.count for each in sides) < 2:
        return NO_EVIDENCE
    spread = math.sqrt(
        (sides[0].scatter + sides[1].scatter) / (sides[0].freedom + sides[1].freedom)
    )
    noise = max(noise, spread, _FINEST)
    if not _opposed(sides, noise):
        return NO_EVIDENCE
    tails = np.array([each.tail(noise) for each in sides])
    lean = math.pi / 2 - (abs(sides[0].steepness) + abs(sides[1].steepness)) / 2
    return MotionEvidence(_crossing(theta, bond), _flipping(sides, noise), lean, tails)


def next_deviation(deviations: Array, rest_angle: float, ratio: float = 0.0) -> Array:
    """Deviation from rest of the outer neighbour of a rotor on relaxed bars [rad], shape (...).

    With alpha = theta_bar + e the angle by which a rotor leans, alpha' that of its neighbour
    further from the wall and k = a / r, the bar between them has its length where
    cos(alpha + alpha') + k (sin(alpha) - sin(alpha')) = cos(2 theta_bar). The ratio lambda says
    k = 2 sin(theta_bar) / d; F(e) is for lambda = 0.
    """
    k, lean = _pitch(rest_angle, ratio), np.sin(rest_angle + deviations)
    up, across = np.cos(rest_angle + deviations), k + lean
    cosine = (math.cos(2 * rest_angle) - k * lean) / np.hypot(up, across)
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)) - np.arctan2(across, up) - rest_angle)


def slope_of_next(deviations: Array, rest_angle: float, ratio: float = 0.0) -> Array:
    """Derivative of `next_deviation` by the deviation [1], lambda at 0, shape (...)."""
    k, inner = _pitch(rest_angle, ratio), rest_angle + deviations
    outer = rest_angle + next_deviation(deviations, rest_angle, ratio)
    sine = np.sin(inner + outer)
    return np.asarray((k * np.cos(inner) - sine) / (k * np.cos(outer) + sine))


class _Side:
    """The rotors on one side of a wall, outwards from it, without that at the edge."""

    def __init__(self, theta: Array) -> None:
        self._theta = theta
        self._outer = theta[len(theta) // 2 :]
        self._outer = self._outer[np.isfinite(self._outer)]
        self.count = len(self._outer)
        self.mean = float(np.angle(np.exp(1j * self._outer).sum()))
        self.scatter = float(np.sum(wrapped(self._outer - self.mean) ** 2))
        self.freedom = self.count - 1

    @property
    def steepness(self) -> float:
        """Angle of the uniform part above the horizontal [rad]."""
        return math.asin(math.cos(self.mean))

    def tail(self, noise: float) -> Array:
        """Sums of products of (e, e^2, e' - F(e)) over the variance of e', shape (3, 3)."""
        rest = math.pi / 2 - abs(self.steepness)
        if noise > _NOISIEST * rest:
            return np.zeros((3, 3))
        lean = 1 if math.sin(self.mean) > 0 else -1
        upright = 1 if math.cos(self.mean) > 0 else -1
        deviations = lean * upright * wrapped(self._theta - self.mean)
        near = deviations[: len(deviations) // 2 + 1]
        flank = _flank(near, rest, max(_FLAT_IN_NOISE * noise, _FLAT * rest))
        inner, outer = deviations[flank], deviations[flank + 1]
        known = np.isfinite(outer)
        inner, beyond = inner[known], (outer - next_deviation(inner, rest))[known]
        rows = np.stack([inner, inner**2, beyond], axis=1)
        return np.asarray(rows.T @ rows / (noise**2 * (_SPREAD + 1 / self.count)))


def _pitch(rest_angle: float, ratio: float) -> float:
    """Return k = a / r = 2 sin(theta_bar) (1 + lambda) / (1 - lambda)."""
    return 2 * math.sin(rest_angle) * (1 + ratio) / (1 - ratio)


def wrapped(differences: Array) -> Array:
    """Differences of angles, counted from -pi to pi [rad]."""
    return np.asarray(np.remainder(differences + math.pi, 2 * math.pi) - math.pi)


def _change_of_lean(theta: Array) -> int:
    """Number of rotors before the wall: there the means of sin(theta) differ the most."""
    leans = np.where(np.isfinite(theta), np.sin(theta), 0.0)
    before = np.concatenate([[0.0], np.cumsum(leans)])
    return int(np.argmax(np.abs(2 * before - before[-1])))


def _crossing(theta: Array, bond: int) -> float:
    """Place where sin(theta) is 0 between two rotors, or half way where it is not."""
    left, right = np.sin(theta[bond - 1 : bond + 1])
    return bond - 1 + float(left / (left - right) if left * right < 0 else 0.5)


def _opposed(sides: list[_Side], noise: float) -> bool:
    """Whether the two sides lean to opposite sides beyond doubt."""
    leans = [math.sin(each.mean) * math.sqrt(each.count) / noise for each in sides]
    return leans[0] * leans[1] < 0 and min(map(abs, leans)) > _LEANING


def _flipping(sides: list[_Side], noise: float) -> float:
    """Log likelihood of theta_right = -theta_left less that of theta_left + pi, for a frame.

    Where neither is met to within the noise, as in a wake or with deviations, the variance is
    what the better of the two needs.
    """
    left, right = (each.mean for each in sides)
    flipped, spun = wrapped(np.array([right + left, right - left - math.pi])) ** 2
    variance = noise**2 * (1 / sides[0].count + 1 / sides[1].count)
    likelihood = float(spun - flipped) / (2 * max(variance, float(min(flipped, spun))))
    return min(max(likelihood, -_STRONGEST_FRAME), _STRONGEST_FRAME)


def _flank(deviations: Array, rest_angle: float, flat: float) -> NDArray[np.int64]:
    """Rotors from the middle of the wall to where it is flat, outwards without a gap."""
    core = np.flatnonzero(deviations <= -rest_angle)
    start = int(core[-1]) + 1 if len(core) else 0
    over = ~(np.abs(deviations[start:-1]) > flat)
    return start + np.arange(int(np.argmax(over)) if over.any() else len(over))


def _solved(sums: Array, rest_angle: float) -> tuple[float, float]:
    """Ratio lambda [1] and its variance, with the term in e^2 at most about 0.1 / theta_bar."""
    normal = sums[:2, :2] + np.diag([1.0, (rest_angle / _FREEDOM_OF_BEND) ** 2])
    variances = np.linalg.inv(normal)
    return float(variances[0] @ sums[:2, 2]), float(variances[0, 0])
