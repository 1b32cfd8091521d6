# SPDX-License-Identifier: Apache-2.0
"""Class of motion of a wall from the angles alone, without parameters of the chain.

A wall is located where u = r sin(phi) changes its sign. Its two sides lean right and left by the
same angle. The rotors of a flipper pass through the top or the bottom: theta_right = -theta_left,
and the staggered cosines on both sides have the same sign. The rotors of a spinner turn over:
theta_right = theta_left + pi, and the cosines have opposite signs.

A wobbling flipper leans over by more than its rest angle beside the wall. The deviation e from
rest maps outwards from rotor to rotor by F(e), for bars of fixed length and d = 1
(`next_deviation`), with a maximum of 0 at e = 0. For any d the slope there is

    lambda = (1 - d) / (1 + d),    e' = F(e) + lambda e + ...,

so that a chain wobbles for lambda < 0. Extended springs do not change the sign of lambda; a term
in e^2 models their change of curvature.
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
from soliton_linkage.estimation.settings import DEFAULTS, MotionSettings, record_dtype
from soliton_linkage.linkage.chain import Array, Motion

Records = NDArray[np.void]

_NUMBERS = records(record_dtype(MotionSettings))
_LEAST_NOISE = 1e-6
"""Lower limit of the noise of a frame [rad]."""
_LEANING = 3.0
"""Smallest lean of either side of a wall, in its standard deviations [1]."""
_FLAT, _FLAT_IN_NOISE, _NOISIEST = 0.02, 2.0, 0.15
"""Limits of tails [1]: smallest deviation relative to the rest angle and to the noise, and largest
noise relative to the rest angle."""
_BEND, _NEGLECTED = 0.1, 0.01
"""Prior standard deviation of the coefficient of e^2, multiplied by the rest angle [1], and error
of the tail ratio due to extended springs [1]."""
_SPREAD = 1.2
"""Ratio of the variance of e' - F(e) to the variance of the noise [1]."""
_LEAST_LEVER = 1e-9
"""Replacement for the zero lever of a bar in line with its outer rotor [1]; the slope would be
infinite."""
_LEAST_WEIGHT = 1e-300
"""Weight of a rest angle without information from the tails [1/rad^2]; positive, so that means
exist."""
_NO_EVIDENCE = (math.nan, 0.0, math.nan)
"""Site, log likelihood ratio and rest angle of a frame without information."""


@compiled(f8, f8, f8)
def next_deviation(inner: float, rest_angle: float, k: float) -> tuple[float, float]:
    """Return the deviation F of the outer neighbour on relaxed bars [rad], and its slope [1].

    A rotor leans by alpha = theta_bar + e; its neighbour further from the wall leans by alpha'.
    The bar between them keeps its length if, with k = a / r, cos(alpha + alpha') + k (sin(alpha) -
    sin(alpha')) = cos(2 theta_bar). The slope lambda at e = 0 gives k = 2 sin(theta_bar) / d = 2
    sin(theta_bar) (1 + lambda) / (1 - lambda).
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
    """Return the number of rotors before the wall and the sines of the two nearest rotors.

    The sines are 0 if unknown. The wall is where the means of sin(theta) on the two sides differ
    most.
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
    return (
        bond,
        left if math.isfinite(left) else 0.0,
        right if math.isfinite(right) else 0.0,
    )


@compiled(const_f8_1d, i8)
def _staggered(angles: Array, n: int) -> float:
    return float(math.pi - angles[n] if n % 2 else angles[n])


class UniformPart(NamedTuple):
    """Outer half of the rotors on one side of a wall."""

    known: float
    """Number of known rotors."""
    sine: float
    """Sum of sin(theta)."""
    cosine: float
    """Sum of cos(theta)."""
    mean: float
    """Mean angle theta [rad]."""
    scatter: float
    """Sum of squared differences from the mean [rad^2]."""


_PART = named_tuple(UniformPart, f8)


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, i8, i8)
def uniform_part(
    angles: Array, sines: Array, cosines: Array, nearest: int, edge: int
) -> UniformPart:
    """Return the outer half of the rotors between a wall and an edge, without the edge rotor."""
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
    """Return the first rotor beyond all deviations above `large` [rad], and the end of the tail.

    The tail ends at the first later rotor with a deviation of at most `small` [rad].
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
    angles: Array,
    nearest: int,
    edge: int,
    part: UniformPart,
    noise: float,
    sums: Array,
) -> None:
    """Add products of (e, e^2, e' - F(e)), divided by the variance of e', to sums, shape (3, 3).

    The deviation e is theta minus the mean of its side [rad], positive for a larger lean. The tail
    starts in the middle of the wall and ends where it is flat, within the inner half of the
    rotors. If the noise exceeds a limit, the sums do not change.
    """
    mean, handed = part.mean, 1.0 if (part.sine > 0) == (part.cosine > 0) else -1.0
    rest_angle = math.pi / 2 - abs(math.asin(math.cos(mean)))
    if noise > _NOISIEST * rest_angle:
        return
    flat = max(_FLAT_IN_NOISE * noise, _FLAT * rest_angle)
    way, half = 1 if edge > nearest else -1, abs(edge - nearest) // 2
    deviations = np.empty(half + 1)
    for n in range(half + 1):
        deviations[n] = handed * wrapped(_staggered(angles, nearest + way * n) - mean)
    begin, end = tail_of_side(deviations, rest_angle, flat)
    k = 2 * math.sin(rest_angle)
    variance = noise * noise * (_SPREAD + 1 / part.known)
    for n in range(begin, min(end, half)):
        e, outer = deviations[n], deviations[n + 1]
        if math.isfinite(outer):
            row = (e, e * e, outer - next_deviation(e, rest_angle, k)[0])
            for i in range(3):
                for j in range(3):
                    sums[i, j] += row[i] * row[j] / variance


@compiled(f8, f8, f8)
def _flipping(left: float, right: float, variance: float) -> float:
    """Return the log likelihood ratio of theta_right = -theta_left against theta_left + pi.

    If neither holds within the noise, for example in a wake, the smaller square replaces the
    variance.
    """
    flipped, spun = wrapped(right + left), wrapped(right - left - math.pi)
    flipped, spun = flipped * flipped, spun * spun
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return likelihood


@compiled(_NUMBERS, const_f8_1d, const_f8_1d, const_f8_1d, f8, f8_2d)
def evidence(
    settings: Records, angles: Array, sines: Array, cosines: Array, noise: float, tails: Array
) -> tuple[float, float, float]:
    """Return site, log likelihood ratio and rest angle of a frame; add its tails, shape (3, 3).

    The noise is a lower bound [rad]; see `MotionEvidence`.
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
    noise = max(noise, spread, _LEAST_NOISE)
    lefts = math.sin(left.mean) * math.sqrt(left.known) / noise
    rights = math.sin(right.mean) * math.sqrt(right.known) / noise
    if not (lefts * rights < 0 and min(abs(lefts), abs(rights)) > _LEANING):
        return _NO_EVIDENCE
    inner = bond - 1
    tail_products(angles, inner, 0, left, noise, tails)
    tail_products(angles, bond, rotors - 1, right, noise, tails)
    rises = abs(math.asin(math.cos(left.mean))) + abs(math.asin(math.cos(right.mean)))
    lean = math.pi / 2 - rises / 2
    crossing = inner + (before / (before - beyond) if before * beyond < 0 else 0.5)
    variance = noise * noise * (1 / left.known + 1 / right.known)
    limit = settings[0]['strongest_frame']
    flipping = min(max(_flipping(left.mean, right.mean, variance), -limit), limit)
    return crossing, flipping, lean


@compiled(const_f8_2d, f8)
def tail_ratio(tails: Array, rest_angle: float) -> tuple[float, float]:
    """Return the ratio lambda of the tails and its standard deviation [1].

    They are NaN and infinity if unknown. The prior standard deviation of the coefficient of e^2 is
    `_BEND` / theta_bar.
    """
    if tails[0, 0] <= 0:
        return math.nan, math.inf
    first, both = tails[0, 0] + 1, tails[0, 1]
    second = tails[1, 1] + (rest_angle / _BEND) ** 2
    determinant = first * second - both * both
    ratio = (second * tails[0, 2] - both * tails[1, 2]) / determinant
    return ratio, math.sqrt(second / determinant + _NEGLECTED**2)


@compiled(_NUMBERS, const_f8_1d, f8, f8, f8, f8_2d)
def observe(
    settings: Records,
    angles: Array,
    noise: float,
    flipping: float,
    rest_angle: float,
    tails: Array,
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Add the `evidence` of a frame to the evidence of earlier frames and update the tails.

    Returns site, log likelihood ratio and rest angle, and the `tail_ratio` of all frames.
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
        # The weight is the information of the tails, and never 0.
        added = tails[0, 0] - known + _LEAST_WEIGHT
        rest_angle += added / (known + added) * (lean - rest_angle)
    elif math.isfinite(lean):
        rest_angle = lean
    return (site, flipping, rest_angle), tail_ratio(tails, rest_angle)


class MotionClass(NamedTuple):
    """Class of motion from the angles.

    motion: class of motion; None if there is no wall or too much noise.
    confidence: probability of the likeliest class, from 0 to 1; the prior of all three is equal.
    spinning: probability that the rotors spin, from 0 to 1.
    """

    motion: Motion | None
    confidence: float
    spinning: float


class MotionEvidence(NamedTuple):
    """Evidence about the class of motion from all frames.

    site: crossing of u through 0 in the last frame [rotor spacings]; NaN without a wall.
    flipping: log likelihood ratio of a flipper against a spinner [1], limited because errors may
        persist in all frames.
    rest_angle: mean lean of the uniform parts [rad]; NaN without a wall.
    tails: sums of products of (e, e^2, e' - F(e)) over their variance, shape (3, 3).
    tail_ratio: ratio lambda of the deviations of neighbouring rotors [1]; NaN if unknown.
    tail_ratio_deviation: standard deviation of this ratio [1], including the effect of extended
        springs; infinite if unknown.
    """

    site: float
    flipping: float
    rest_angle: float
    tails: Array
    tail_ratio: float
    tail_ratio_deviation: float

    def verdict(self, settings: MotionSettings = DEFAULTS.motion) -> MotionClass:
        """Return the class of motion, None unless one class is probable enough."""
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
    """Observer that adds up the evidence of all frames since the last restart.

    A frame has no information if it has no wall, if the wall is within four rotors of an edge, or
    if too few angles are known.
    """

    def __init__(self, settings: MotionSettings = DEFAULTS.motion) -> None:
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Discard all frames, for example after the source of the angles has restarted."""
        self.evidence = NO_EVIDENCE

    def observe(self, angles: Array, noise: float = 0.0) -> MotionClass:
        """Add a frame of angles [rad], shape (N,), NaN if unknown, and return the class of motion.

        Angles may be wrapped or unwrapped. The noise [rad] is a lower bound of the scatter of the
        uniform parts. Raises ValueError for a negative or infinite noise and for angles that are
        not one-dimensional.
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
            before.flipping,
            before.rest_angle,
            tails,
        )
        self.evidence = MotionEvidence(*found, tails, *ratio)
        return self.evidence.verdict(self._settings)
