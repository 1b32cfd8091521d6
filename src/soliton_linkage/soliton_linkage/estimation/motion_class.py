# SPDX-License-Identifier: Apache-2.0
"""How a wall moves, told from the angles alone, without the parameters of their chain.

A wall lies where u = r sin(phi) changes its sign. On its two sides the chain leans to the right
and to the left by the same angle: rotors of a flipper pass from one to the other through the
top or through the bottom, theta_right = -theta_left, and their staggered cosines have the same
sign; those of a spinner turn over, theta_right = theta_left + pi, and they have opposite signs.

A flipper that wobbles leans over by more than its angle at rest beside the wall. Outwards from
one rotor to the next its deviation e from rest goes over, for bars of fixed length and d = 1,
into F(e), `next_deviation`, which has a maximum of 0 at e = 0; for any d the slope
there is

    lambda = (1 - d) / (1 + d),    e' = F(e) + lambda e + ...,

so that a chain wobbles where lambda is below 0. Springs in motion keep the sign of lambda, and may
bend the rest, for which a term in e^2 stands.
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
_LEAST_LEVER = 1e-9
"""In place of the lever 0 of a bar in line with its outer rotor [1]: a slope without bounds."""
_LEAST_WEIGHT = 1e-300
"""Weight of an angle at rest of which the tails tell nothing [1/rad^2]: never quite 0."""
_NO_EVIDENCE = (math.nan, 0.0, math.nan)
"""Place, flipping and angle at rest of a frame that says nothing."""


@compiled(f8, f8, f8)
def next_deviation(inner: float, rest_angle: float, k: float) -> tuple[float, float]:
    """Deviation F of the outer neighbour on relaxed bars [rad], and its slope [1].

    With alpha = theta_bar + e the angle by which a rotor leans, alpha' that of its neighbour
    further from the wall and k = a / r, the bar between them has its length where
    cos(alpha + alpha') + k (sin(alpha) - sin(alpha')) = cos(2 theta_bar). The ratio lambda, the
    slope at e = 0, says k = 2 sin(theta_bar) / d = 2 sin(theta_bar) (1 + lambda) / (1 - lambda).
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
    """Number of rotors before the wall, and the sines of its two rotors, 0 where unknown.

    There the means of sin(theta) before and beyond differ the most.
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
    """Staggered angle of rotor n [rad]."""
    return float(math.pi - angles[n] if n % 2 else angles[n])


class UniformPart(NamedTuple):
    """Outer half of the rotors on one side of a wall."""

    known: float
    """Number of rotors that are known."""
    sine: float
    """Sum of sin(theta)."""
    cosine: float
    """Sum of cos(theta)."""
    mean: float
    """Mean angle theta [rad]."""
    scatter: float
    """Sum of the squares of what they differ from it [rad^2]."""


_PART = named_tuple(UniformPart, f8)


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, i8, i8)
def uniform_part(
    angles: Array, sines: Array, cosines: Array, nearest: int, edge: int
) -> UniformPart:
    """Return the outer half of the rotors from the nearest to a wall to an edge, without that."""
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
    """First rotor beyond all whose deviation is large [rad], and the next one that is small."""
    begin = 0
    for n in range(deviations.size):
        if abs(deviations[n]) > large:
            begin = n + 1
    end = begin
    while end < deviations.size and abs(deviations[end]) > small:
        end += 1
    return begin, end


@compiled(f8, f8)
def _handed(sine: float, cosine: float) -> float:
    """Sign of the deviations of a side, with the sums of its sines and cosines."""
    return 1.0 if (sine > 0) == (cosine > 0) else -1.0


@compiled(f8)
def _steepness(mean: float) -> float:
    """Angle of a uniform part above or below the horizontal [rad]."""
    return abs(math.asin(math.cos(mean)))


@compiled(_NUMBERS, const_f8_1d, i8, i8, _PART, f8, f8_2d)
def tail_products(
    settings: Records,
    angles: Array,
    nearest: int,
    edge: int,
    part: UniformPart,
    noise: float,
    sums: Array,
) -> None:
    """Set products of (e, e^2, e' - F(e)) outwards from a wall, over the variance of e', (3, 3).

    The deviation e of a rotor is theta less the mean of its side, or its opposite [rad]; they
    count from the middle of the wall on, as far as they are not flat, in the inner half of the
    rotors up to an edge. Sums are 0, and stay so where noise hides the tail.
    """
    mean, handed = part.mean, _handed(part.sine, part.cosine)
    rest_angle = math.pi / 2 - _steepness(mean)
    if noise > settings[0]['noisiest'] * rest_angle:
        return
    flat = max(settings[0]['flat_in_noise'] * noise, settings[0]['flat'] * rest_angle)
    way, half = 1 if edge > nearest else -1, abs(edge - nearest) // 2
    deviations = np.empty(half + 1)
    for n in range(half + 1):
        deviations[n] = handed * wrapped(_staggered(angles, nearest + way * n) - mean)
    begin, end = tail_of_side(deviations, rest_angle, flat)
    k = 2 * math.sin(rest_angle)
    variance = noise * noise * (settings[0]['spread'] + 1 / part.known)
    for n in range(begin, min(end, half)):
        e, outer = deviations[n], deviations[n + 1]
        if math.isfinite(outer):
            row = (e, e * e, outer - next_deviation(e, rest_angle, k)[0])
            for i in range(3):
                for j in range(3):
                    sums[i, j] += row[i] * row[j] / variance


@compiled(f8, f8, f8)
def _flipping(left: float, right: float, variance: float) -> float:
    """Log likelihood of theta_right = -theta_left less that of theta_left + pi, for a frame.

    Where neither is met to within the noise, as in a wake or with deviations, the variance is
    what the better of the two needs.
    """
    flipped, spun = wrapped(right + left), wrapped(right - left - math.pi)
    flipped, spun = flipped * flipped, spun * spun
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return likelihood


@compiled(f8, f8)
def _limited(value: float, limit: float) -> float:
    """Value from -limit to limit."""
    return min(max(value, -limit), limit)


@compiled(_NUMBERS, const_f8_1d, const_f8_1d, const_f8_1d, f8, f8_2d)
def evidence(
    settings: Records, angles: Array, sines: Array, cosines: Array, noise: float, tails: Array
) -> tuple[float, float, float]:
    """Place, flipping and angle at rest of `MotionEvidence` of one frame; see there.

    The noise is a lower bound [rad]. To tails, shape (3, 3), those of the frame are added.
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
    noise = max(noise, spread, settings[0]['least_noise'])
    lefts = math.sin(left.mean) * math.sqrt(left.known) / noise
    rights = math.sin(right.mean) * math.sqrt(right.known) / noise
    if not (lefts * rights < 0 and min(abs(lefts), abs(rights)) > settings[0]['leaning']):
        return _NO_EVIDENCE
    inner = bond - 1
    tail_products(settings, angles, inner, 0, left, noise, tails)
    tail_products(settings, angles, bond, rotors - 1, right, noise, tails)
    lean = math.pi / 2 - (_steepness(left.mean) + _steepness(right.mean)) / 2
    crossing = inner + (before / (before - beyond) if before * beyond < 0 else 0.5)
    variance = noise * noise * (1 / left.known + 1 / right.known)
    flipping = _limited(_flipping(left.mean, right.mean, variance), settings[0]['strongest_frame'])
    return crossing, flipping, lean


@compiled(_NUMBERS, const_f8_2d, f8)
def tail_ratio(settings: Records, tails: Array, rest_angle: float) -> tuple[float, float]:
    """Ratio lambda of the tails and its standard deviation [1]; NaN and infinity if unknown.

    The term in e^2 is at most about the bend over theta_bar.
    """
    if tails[0, 0] <= 0:
        return math.nan, math.inf
    first, both = tails[0, 0] + 1, tails[0, 1]
    second = tails[1, 1] + (rest_angle / settings[0]['bend']) ** 2
    determinant = first * second - both * both
    ratio = (second * tails[0, 2] - both * tails[1, 2]) / determinant
    return ratio, math.sqrt(second / determinant + settings[0]['neglected'] ** 2)


@compiled(_NUMBERS, const_f8_1d, f8, f8, f8, f8_2d)
def observe(
    settings: Records,
    angles: Array,
    noise: float,
    flipping: float,
    rest_angle: float,
    tails: Array,
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Add the `evidence` of a frame to that of those before, whose tails are brought up to date.

    Returns place, flipping and angle at rest, and the `tail_ratio` of all.
    """
    known = tails[0, 0]
    sines, cosines = np.full(angles.size, math.nan), np.full(angles.size, math.nan)
    for n in range(angles.size):
        if math.isfinite(angles[n]):
            sines[n], cosines[n] = math.sin(angles[n]), math.cos(angles[n])
    site, more, lean = evidence(settings, angles, sines, cosines, noise, tails)
    flipping = _limited(flipping + more, settings[0]['strongest'])
    if math.isfinite(lean) and math.isfinite(rest_angle):
        # Each weighs as much as the tails tell, never quite nothing.
        added = tails[0, 0] - known + _LEAST_WEIGHT
        rest_angle += added / (known + added) * (lean - rest_angle)
    elif math.isfinite(lean):
        rest_angle = lean
    return (site, flipping, rest_angle), tail_ratio(settings, tails, rest_angle)


class MotionClass(NamedTuple):
    """Class of motion that the angles speak for.

    motion: none where the data cannot tell: there is no wall, or too much noise.
    confidence: probability of the likeliest class, 0 to 1; the three are equally likely without
        data.
    spinning: probability that the rotors spin, 0 to 1.
    """

    motion: Motion | None
    confidence: float
    spinning: float


class MotionEvidence(NamedTuple):
    """What frames say of the motion together.

    place: where u changes its sign [rotor spacings], in the last frame; NaN without a wall.
    flipping: log likelihood of a flipper less that of a spinner [1], limited for errors that stay
        the same in all frames.
    rest_angle: mean angle that the uniform parts lean by [rad]; NaN without a wall.
    tails: sums of products of (e, e^2, e' - F(e)) over their variance, shape (3, 3).
    tail_ratio: deviation of a rotor over that of its inner neighbour, lambda [1]; NaN where
        unknown.
    tail_ratio_deviation: its standard deviation [1], with what springs in motion may do to it;
        infinite where unknown.
    """

    site: float
    flipping: float
    rest_angle: float
    tails: Array
    tail_ratio: float
    tail_ratio_deviation: float

    def verdict(self, settings: MotionSettings = DEFAULTS.motion) -> MotionClass:
        """Return the class; unknown where none of the three is sure."""
        told = math.isfinite(self.tail_ratio)
        scaled = self.tail_ratio / self.tail_ratio_deviation if told else 0.0
        wobbling = math.erfc(scaled / math.sqrt(2)) / 2
        spinning = 1 / (1 + 2 * math.exp(self.flipping))
        share, motion = (1 - spinning) * (1 - wobbling), Motion.FLIPPER
        if (1 - spinning) * wobbling > share:
            share, motion = (1 - spinning) * wobbling, Motion.WOBBLING_FLIPPER
        if spinning > share:
            share, motion = spinning, Motion.SPINNER
        known = motion if share >= settings.sure else None
        return MotionClass(known, share, spinning)


NO_EVIDENCE = MotionEvidence(math.nan, 0.0, math.nan, np.zeros((3, 3)), math.nan, math.inf)
"""Of no frame."""


class MotionObserver:
    """Adds up the evidence of the frames since the start or the last restart.

    A frame without a wall, with the wall within four rotors of an edge or with too few angles
    known says nothing.
    """

    def __init__(self, settings: MotionSettings = DEFAULTS.motion) -> None:
        """Begin without any frame."""
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Forget all frames, as where the source of the angles has been started anew."""
        self.evidence = NO_EVIDENCE

    def observe(self, angles: Array, noise: float = 0.0) -> MotionClass:
        """Add a frame of angles [rad], shape (N,), NaN where unknown, and return the class.

        Angles may be whole turns apart; the noise [rad], where it is known, is a lower bound of
        what the uniform parts show. Raises ValueError for a noise that is negative or not finite,
        and for angles that are not one row.
        """
        angles = np.asarray(angles, dtype=np.float64, order='C')
        if angles.ndim != 1:
            raise ValueError(f'angles of shape {angles.shape} must be one row, an angle a rotor')
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
