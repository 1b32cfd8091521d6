# SPDX-License-Identifier: Apache-2.0
"""Class of motion of a wall from the angles alone, without the parameters of the chain.

A wall is where the horizontal displacement u = r sin(phi) of the rotor tips changes its sign. The
staggered angle theta is phi for rotors 0, 2, ... and pi - phi for the others. Far from the wall,
it has the same value theta_left for all rotors on one side and theta_right for all rotors on the
other: theta_right = -theta_left in a flipper, and theta_right = theta_left + pi in a spinner.

In a wobbling flipper, rotors beside the wall lean by more than the rest angle theta_bar. Let a
rotor deviate by e from the rest angle, and its outer neighbour, the next rotor away from the wall,
by e'. With the rotor length r and the spacing a, the lean ratio is d = 2 r sin(theta_bar) / a. Let
F(e) be the deviation e' in a chain with d = 1, which `next_deviation` computes. Then

    e' = F(e) + lambda e + ...,    lambda = (1 - d) / (1 + d),

and the chain wobbles if lambda < 0. Extended springs add a term in e^2 to e' - F(e), but do not
change the sign of lambda in a kink. The tails of an anti-kink are not used, because its springs
are extended too much. Motors and other forces deform a wall, which causes an error of lambda.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    compiled,
    const_f8_1d,
    const_f8_2d,
    f8,
    f8_2d,
    i8,
    named_tuple,
    records,
)
from soliton_linkage.estimation.frames import wrapped
from soliton_linkage.estimation.settings import DEFAULTS, LEAST_NOISE, MotionSettings, record_dtype
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage.linkage.springs import TINY

Records = NDArray[np.void]

_NUMBERS = records(record_dtype(MotionSettings))
_LEANING = 3.0
"""A frame shows a wall only if sin(theta_left) and sin(theta_right) have opposite signs and
absolute values above this number of their standard deviations [1]."""
_FLAT = 2.0
"""A tail consists of rotors on one side of a wall, whose deviations from the rest angle decrease
with the distance from the wall. It ends where the deviation is at most this number of standard
deviations of the noise [1]."""
_BEND = 0.1
"""Prior standard deviation of the coefficient of e^2 in e' - F(e), multiplied by the rest angle
[1]."""
_LEAST_LEVER = 1e-9
"""`next_deviation` computes a slope by a division by the derivative of the left side of its
equation with respect to alpha'. The derivative is 0 if the spring and the outer rotor are in line.
It is then replaced by this [1]."""
_NO_EVIDENCE = (math.nan, 0.0, math.nan)
"""Site, log likelihood ratio and rest angle of a frame without information."""


@compiled(f8, f8, f8)
def next_deviation(inner: float, rest_angle: float, k: float) -> tuple[float, float]:
    """Return F(e), the deviation of the outer neighbour [rad], and its slope F'(e) [1].

    `inner` is e, and k = a / r is the ratio of the rotor spacing to the rotor length. With the
    rest angle theta_bar, a rotor leans by alpha = theta_bar + e and its outer neighbour by alpha'
    = theta_bar + F(e). The spring between them has its rest length if

        cos(alpha + alpha') + k (sin(alpha) - sin(alpha')) = cos(2 theta_bar).

    The lean ratio is d = 2 sin(theta_bar) / k. For the function F of the module docstring, with
    d = 1, the argument `k` must therefore be 2 sin(theta_bar).
    """
    lean, up = math.sin(rest_angle + inner), math.cos(rest_angle + inner)
    across = k + lean
    cosine = (math.cos(2 * rest_angle) - k * lean) / math.hypot(up, across)
    outer = math.acos(min(max(cosine, -1.0), 1.0)) - math.atan2(across, up)
    sine = math.sin(rest_angle + inner + outer)
    lever = k * math.cos(outer) + sine
    return outer - rest_angle, (k * up - sine) / (lever if lever else _LEAST_LEVER)


@compiled(const_f8_1d)
def bond_of_wall(sines: Array) -> tuple[int, float, float]:
    """Return the number b of rotors before the wall, and sin(phi) of the rotors b - 1 and b.

    `sines` are sin(phi) of all rotors, NaN if unknown.
    """
    whole, running, most, bond = 0.0, 0.0, -1.0, 0
    for n in range(sines.size):
        whole += sines[n] if math.isfinite(sines[n]) else 0.0
    for n in range(sines.size):
        running += sines[n] if math.isfinite(sines[n]) else 0.0
        apart = abs(running - whole / 2)
        if apart > most:
            most, bond = apart, n + 1
    if not 0 < bond < sines.size:
        return bond, 0.0, 0.0
    left, right = sines[bond - 1], sines[bond]
    return (bond, left if math.isfinite(left) else 0.0, right if math.isfinite(right) else 0.0)


@compiled(const_f8_1d, i8)
def _staggered(angles: Array, n: int) -> float:
    return float(math.pi - angles[n] if n % 2 else angles[n])


class UniformPart(NamedTuple):
    """Statistics of the outer half of the rotors on one side of a wall."""

    known: float
    """Number of rotors with known angles."""
    sine: float
    """Sum of sin(theta)."""
    cosine: float
    """Sum of cos(theta)."""
    mean: float
    """Mean angle theta [rad]."""
    scatter: float
    """Sum of the squared differences between theta and `mean` [rad^2]."""


_PART = named_tuple(UniformPart, f8)


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, i8, i8)
def uniform_part(
    angles: Array, sines: Array, cosines: Array, nearest: int, edge: int
) -> UniformPart:
    """Return statistics of the outer half of the rotors from `nearest` to `edge`.

    Rotor `nearest` is beside the wall, and rotor `edge` is at an edge of the chain.
    """
    way = 1 if edge > nearest else -1
    inner = nearest + way * (abs(edge - nearest) // 2)
    low, high = (inner, edge) if way > 0 else (edge + 1, inner + 1)
    count, sine, cosine = 0, 0.0, 0.0
    for n in range(low, high):
        if math.isfinite(sines[n]):
            count += 1
            sine += sines[n]
            cosine += -cosines[n] if n % 2 else cosines[n]
    mean, scatter = math.atan2(sine, cosine), 0.0
    for n in range(low, high):
        apart = wrapped(_staggered(angles, n) - mean)
        if math.isfinite(apart):
            scatter += apart * apart
    return UniformPart(float(count), sine, cosine, mean, scatter)


@compiled(const_f8_1d, f8, f8)
def tail_of_side(deviations: Array, large: float, small: float) -> tuple[int, int]:
    """Return the indices at which a tail in `deviations` [rad] begins and ends.

    The deviations are sorted by the distance from the wall. The tail begins after the last
    absolute deviation above `large` [rad]. It ends before the next absolute deviation that is not
    above `small` [rad].
    """
    begin = 0
    for n in range(deviations.size):
        if abs(deviations[n]) > large:
            begin = n + 1
    end = begin
    while end < deviations.size and abs(deviations[end]) > small:
        end += 1
    return begin, end


@compiled(const_f8_1d, i8, i8, _PART, f8, f8_2d)
def tail_products(
    angles: Array, nearest: int, edge: int, part: UniformPart, noise: float, sums: Array
) -> None:
    """Add to `sums`, shape (3, 3), the pairwise products of e, e^2 and e' - F(e) in a tail.

    Each product is divided by the variance of e' - F(e). `part` is the `uniform_part` of the same
    side of the wall.
    """
    mean, handed = part.mean, 1.0 if (part.sine > 0) == (part.cosine > 0) else -1.0
    rest_angle = math.pi / 2 - abs(math.asin(math.cos(mean)))
    way, half = 1 if edge > nearest else -1, abs(edge - nearest) // 2
    deviations = np.empty(half + 1)
    for n in range(half + 1):
        deviations[n] = handed * wrapped(_staggered(angles, nearest + way * n) - mean)
    begin, end = tail_of_side(deviations, rest_angle, _FLAT * noise)
    k = 2 * math.sin(rest_angle)
    variance = noise * noise * (1 + 1 / part.known)
    for n in range(begin, min(end, half)):
        e, outer = deviations[n], deviations[n + 1]
        if math.isfinite(outer):
            row = (e, e * e, outer - next_deviation(e, rest_angle, k)[0])
            for i in range(3):
                for j in range(3):
                    sums[i, j] += row[i] * row[j] / variance


@compiled(f8, f8, f8)
def _flipping(left: float, right: float, variance: float) -> float:
    """Return the log likelihood ratio of a flipper against a spinner.

    `left` and `right` are theta_left and theta_right [rad], and `variance` is the variance of
    their difference [rad^2].
    """
    flipped, spun = wrapped(right + left), wrapped(right - left - math.pi)
    flipped, spun = flipped * flipped, spun * spun
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return likelihood


@compiled(_NUMBERS, const_f8_1d, const_f8_1d, const_f8_1d, f8, f8_2d)
def evidence(
    settings: Records, angles: Array, sines: Array, cosines: Array, noise: float, tails: Array
) -> tuple[float, float, float]:
    """Return the site of the wall, the result of `_flipping` and the rest angle of a frame.

    The `tail_products` of both tails of the wall are added to `tails`.
    """
    rotors, fewest = angles.size, settings[0]['fewest_rotors']
    bond, before, beyond = bond_of_wall(sines)
    if not fewest < bond < rotors - fewest:
        return _NO_EVIDENCE
    left = uniform_part(angles, sines, cosines, bond - 1, 0)
    right = uniform_part(angles, sines, cosines, bond, rotors - 1)
    if min(left.known, right.known) < 2:
        return _NO_EVIDENCE
    spread = math.sqrt((left.scatter + right.scatter) / (left.known + right.known - 2))
    noise = max(noise, spread, LEAST_NOISE)
    lefts = math.sin(left.mean) * math.sqrt(left.known) / noise
    rights = math.sin(right.mean) * math.sqrt(right.known) / noise
    if not (lefts * rights < 0 and min(abs(lefts), abs(rights)) > _LEANING):
        return _NO_EVIDENCE
    inner = bond - 1
    if lefts > 0:
        tail_products(angles, inner, 0, left, noise, tails)
        tail_products(angles, bond, rotors - 1, right, noise, tails)
    rises = abs(math.asin(math.cos(left.mean))) + abs(math.asin(math.cos(right.mean)))
    lean = math.pi / 2 - rises / 2
    crossing = inner + (before / (before - beyond) if before * beyond < 0 else 0.5)
    variance = noise * noise * (1 / left.known + 1 / right.known)
    limit = settings[0]['strongest_frame']
    flipping = min(max(_flipping(left.mean, right.mean, variance), -limit), limit)
    return crossing, flipping, lean


@compiled(const_f8_2d, f8, f8)
def tail_ratio(tails: Array, rest_angle: float, deformation: float) -> tuple[float, float]:
    """Return lambda and its standard deviation [1]; NaN and inf if unknown.

    `tails` are sums of `tail_products`, and `deformation` is the standard deviation of the angles
    near the wall due to forces [rad].
    """
    if tails[0, 0] <= 0:
        return math.nan, math.inf
    first, both = tails[0, 0] + 1, tails[0, 1]
    second = tails[1, 1] + (rest_angle / _BEND) ** 2
    determinant = first * second - both * both
    ratio = (second * tails[0, 2] - both * tails[1, 2]) / determinant
    by_forces = deformation**2 * tails[0, 0] / tails[1, 1]
    return ratio, math.sqrt(second / determinant + by_forces)


@compiled(_NUMBERS, const_f8_1d, f8, f8, f8, f8, f8_2d)
def observe(
    settings: Records,
    angles: Array,
    noise: float,
    deformation: float,
    flipping: float,
    rest_angle: float,
    tails: Array,
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Add the evidence of a frame to the evidence of the earlier frames.

    `flipping`, `rest_angle` and `tails` summarise the earlier frames; `tails` is updated in place.
    Return two tuples. The first one has the site in this frame and the updated `flipping` and
    `rest_angle`. The second one is the result of `tail_ratio`.
    """
    known = tails[0, 0]
    sines, cosines = np.full(angles.size, math.nan), np.full(angles.size, math.nan)
    for n in range(angles.size):
        if math.isfinite(angles[n]):
            sines[n], cosines[n] = math.sin(angles[n]), math.cos(angles[n])
    site, more, lean = evidence(settings, angles, sines, cosines, noise, tails)
    limit = settings[0]['strongest']
    flipping = min(max(flipping + more, -limit), limit)
    if math.isfinite(lean) and math.isfinite(rest_angle):
        # The weight of a frame is the information in its tails.
        rest_angle += (1 - known / max(tails[0, 0], TINY)) * (lean - rest_angle)
    elif math.isfinite(lean):
        rest_angle = lean
    return (site, flipping, rest_angle), tail_ratio(tails, rest_angle, deformation)


class MotionClass(NamedTuple):
    """Class of motion, determined from the angles.

    motion: class of motion; None if no class is probable enough, for example before a frame has
        shown a wall.
    confidence: probability of the likeliest class; the prior probability of each class is 1/3.
    spinning: probability that the chain is a spinner.
    """

    motion: Motion | None
    confidence: float
    spinning: float


class MotionEvidence(NamedTuple):
    """Evidence about the class of motion from all frames.

    site: site of the wall in the last frame [rotor spacings]; NaN without a wall.
    flipping: log likelihood ratio of a flipper against a spinner, limited by `strongest` of the
        settings [1].
    rest_angle: mean lean of the rotors far from the wall [rad]; NaN if no frame has shown a wall.
    tails: sums of the pairwise products of e, e^2 and e' - F(e), divided by the variance of e' -
        F(e), shape (3, 3).
    tail_ratio: ratio lambda of the deviations of neighbouring rotors [1]; NaN if unknown.
    tail_ratio_deviation: standard deviation of the tail ratio [1]; infinite if unknown.
    """

    site: float
    flipping: float
    rest_angle: float
    tails: Array
    tail_ratio: float
    tail_ratio_deviation: float

    def verdict(self, settings: MotionSettings = DEFAULTS.motion) -> MotionClass:
        """Return the class of motion; `motion` is None below the `least_probability`."""
        determined = math.isfinite(self.tail_ratio)
        scaled = self.tail_ratio / self.tail_ratio_deviation if determined else 0.0
        wobbling = math.erfc(scaled / math.sqrt(2)) / 2
        spinning = 1 / (1 + 2 * math.exp(self.flipping))
        probability, motion = max(
            ((1 - spinning) * (1 - wobbling), Motion.FLIPPER),
            ((1 - spinning) * wobbling, Motion.WOBBLING_FLIPPER),
            (spinning, Motion.SPINNER),
            key=lambda pair: pair[0],
        )
        known = motion if probability >= settings.least_probability else None
        return MotionClass(known, probability, spinning)


NO_EVIDENCE = MotionEvidence(math.nan, 0.0, math.nan, np.zeros((3, 3)), math.nan, math.inf)
"""Evidence before the first frame."""


class MotionObserver:
    """Observer of the class of motion; it ignores frames in which a wall is near an edge."""

    def __init__(
        self, settings: MotionSettings = DEFAULTS.motion, deformation: float = 0.0
    ) -> None:
        """Start without evidence.

        `deformation` is the standard deviation of the angles near a wall due to forces [rad].
        """
        self._settings, self._deformation = settings, deformation
        self.restart()

    def restart(self) -> None:
        """Discard the evidence of all frames, for example after a restart of the encoders."""
        self.evidence = NO_EVIDENCE

    def observe(self, angles: Array, noise: float = 0.0) -> MotionClass:
        """Add the evidence of a frame, and return the class of motion.

        Angles [rad], shape (N,), are NaN if unknown. `noise` is a lower bound of their standard
        deviation [rad]. Raises ValueError if `angles` have more than one dimension, or if `noise`
        is negative or not finite.
        """
        angles = np.asarray(angles, dtype=np.float64, order='C')
        if angles.ndim != 1:
            raise ValueError(
                f'angles have the shape {angles.shape}; give one row with an angle per rotor'
            )
        if not (math.isfinite(noise) and noise >= 0):
            raise ValueError(f'noise = {noise} rad must be a finite number of 0 or more')
        before, tails = self.evidence, self.evidence.tails.copy()
        found, ratio = observe(
            self._settings.record,
            angles,
            noise,
            self._deformation,
            before.flipping,
            before.rest_angle,
            tails,
        )
        self.evidence = MotionEvidence(*found, tails, *ratio)
        return self.evidence.verdict(self._settings)
