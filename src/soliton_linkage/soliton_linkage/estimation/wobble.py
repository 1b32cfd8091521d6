# SPDX-License-Identifier: Apache-2.0
"""Wobble of the rotors beside a wall.

A computed wall at rest determines which rotors are used.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import b1, compiled, const_f8_1d, f8, f8_2d, i8, records
from soliton_linkage.estimation.frames import wrapped
from soliton_linkage.estimation.motion_class import next_deviation, tail_of_side
from soliton_linkage.linear.bands import exact_tail
from soliton_linkage.linkage.chain import Array, Chain, Motion

Records = NDArray[np.void]
Overshoot = tuple[float, float, float]
Lengths = tuple[float, float, float, float, float, float]

BARS = np.dtype(
    [
        (name, np.float64)
        for name in ('rotor_length', 'spacing', 'rest_angle', 'lean_ratio', 'spins')
    ]
)
"""Parameters of a chain that determine the wobble; `spins` is 1 for spinners, else 0."""
_BARS = records(BARS)
_CALM, _LARGEST, _ABOVE_NOISE = 1e-3, 0.5, 4.0
"""A rotor beside a wall at rest is calm if it deviates from the uniform state by less than `_CALM`
times the rest angle, or by less than the noise. A rotor is in a tail if its deviation is at most
`_LARGEST` times the rest angle and at least `_ABOVE_NOISE` standard deviations of the noise."""
_BEND = 0.3
"""Assumed error of the position of a zero of a tail [rotor spacings], if the nearest rotor between
the zero and the wall deviates by the rest angle. The error is proportional to this deviation."""
_ROUNDING = 1e-12
"""Lower limit of the noise [rad], of the order of rounding errors."""
_COARSEST = 0.2
"""The decay length is unknown if the relative standard deviation of the fitted tail ratio, or of
the decay length that follows from it, is above this [1]."""
_NO_OVERSHOOT = (math.nan, math.nan, math.nan)


@compiled(const_f8_1d, const_f8_1d, i8, i8, i8, b1, f8, f8_2d)
def beside_wall(
    angles: Array,
    at_rest: Array,
    first: int,
    low: int,
    middle: int,
    spins: bool,
    rest_angle: float,
    leans: Array,
) -> None:
    """Set `leans` [rad], (2, n): deviations of rotors beside a wall from their uniform states.

    Row 0 is for the wall at rest, and row 1 for the measured angles. The first columns are for the
    rotors before `middle`, sorted by the distance from the wall. The other columns are for the
    rotors from `middle` on, sorted in the same way.
    """
    expected, measured = leans[0], leans[1]
    high = low + expected.size
    alike = 0.0
    for n in range(low, high):
        alike += math.cos(angles[n]) * math.cos(at_rest[n - first])
    for n in range(low, high):
        before, odd = n < middle, n % 2 == 1
        site = middle - 1 - n if before else n - low
        handed = -1.0 if odd else 1.0
        phase = (math.pi if odd else 0.0) - rest_angle
        if not before:
            handed = handed if spins else -handed
            phase += math.pi if spins else 0.0
        there = at_rest[n - first]
        apart = (math.pi - angles[n] if alike < 0 else angles[n]) - there
        lean = wrapped(handed * there + phase)
        expected[site] = lean
        measured[site] = lean + handed * wrapped(apart)


@compiled(const_f8_1d, f8, f8)
def overshooting(expected: Array, rest_angle: float, calm: float) -> int:
    """Return the index of the rotor that leans most, which has the largest sine of its angle.

    If `calm` [rad] is above 0, return instead the index of the first rotor whose deviation from
    the uniform state is below `calm`, or of the last rotor if there is none.
    """
    at, most = 0, -math.inf
    for n in range(expected.size):
        if calm > 0:
            at = n
            if abs(expected[n]) < calm:
                break
        elif math.sin(rest_angle + expected[n]) > most:
            at, most = n, math.sin(rest_angle + expected[n])
    return at


@compiled(const_f8_1d, i8, i8, f8, f8)
def tail_sums(
    measured: Array, begin: int, end: int, rest_angle: float, k: float
) -> tuple[float, float, float, float, float]:
    """Return five sums over the rotors of a tail, for the fit of the tail ratio.

    The summands are e^2, e (e' - F(e)), F'(e), (F'(e) e)^2 and F'(e) e e_inner. A rotor deviates
    by e from the uniform state [rad], its outer neighbour by e', and its inner neighbour by
    e_inner. F is the `next_deviation`, which defines `k`, and F' is its derivative.
    """
    square, product, slopes, squares, both = 0.0, 0.0, 0.0, 0.0, 0.0
    share = 0.0
    for n in range(begin, end):
        following, slope = next_deviation(measured[n], rest_angle, k)
        e = measured[n]
        square += e * e
        product += e * (measured[n + 1] - following)
        slopes += slope
        if n > begin:
            both += slope * e * measured[n - 1]
        share = slope * e
        squares += share * share
    return square, product, slopes, squares, both


@compiled(const_f8_1d, i8, i8, f8, f8, f8)
def half_wavelength(
    measured: Array, begin: int, end: int, rest_angle: float, error: float, bend: float
) -> tuple[float, float]:
    """Return the mean distance between the zeros of a tail [rotor spacings], and its variance.

    `error` is the standard deviation of the angles [rad], and `bend` is `_BEND`.
    """
    start = max(end - 1, begin)
    while start > begin and measured[start - 1] * measured[start] < 0:
        start -= 1
    count = end - start - 1
    if count < 2:
        return math.nan, math.nan
    whole, centre = 0.0, 0.0
    zeros = np.empty((5, count))
    for n in range(count):
        inner, outer = measured[start + n], measured[start + n + 1]
        step = inner - outer
        by_inner, by_outer = -outer / (step * step), inner / (step * step)
        bent = (bend * inner / rest_angle) ** 2
        weight = 1 / (error * error * (by_inner * by_inner + by_outer * by_outer) + bent)
        zeros[0, n], zeros[1, n], zeros[2, n] = n + inner / step, by_inner, by_outer
        zeros[3, n], zeros[4, n] = bent, weight
        whole += weight
        centre += n * weight
    centre /= whole
    distance, scale, variance, of_rotor = 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        share = (n - centre) * zeros[4, n]
        distance += share * zeros[0, n]
        scale += share * (n - centre)
        variance += (error * (of_rotor + share * zeros[1, n])) ** 2 + share * share * zeros[3, n]
        of_rotor = share * zeros[2, n]
    variance += (error * of_rotor) ** 2
    return distance / scale, variance / (scale * scale)


@compiled(const_f8_1d, const_f8_1d, f8, f8, f8, f8)
def _overshoot(
    expected: Array, measured: Array, rest_angle: float, length: float, calm: float, error: float
) -> tuple[float, float, float]:
    """Return `amplitude`, `amplitude_deviation` and `rest_amplitude` of `Wobble` [m]."""
    if not expected.size:
        return _NO_OVERSHOOT
    at = overshooting(expected, rest_angle, calm)
    lean = length * math.sin(rest_angle)
    return (
        length * math.sin(rest_angle + measured[at]) - lean,
        length * abs(math.cos(rest_angle + expected[at])) * error,
        length * math.sin(rest_angle + expected[at]) - lean,
    )


@compiled(f8, f8, f8, f8)
def _decay_length(
    ratio: float, deviation: float, exact: float, spacing: float
) -> tuple[float, float]:
    """Return the decay length -a / ln|ratio| (spacing a), and its standard deviation [m]."""
    known = abs(exact)
    if not (known > 0 and 0 < abs(ratio) < 1):
        return math.nan, math.nan
    if deviation > _COARSEST * known * min(abs(math.log(known)), 1.0):
        return math.nan, math.nan
    length = -spacing / math.log(abs(ratio))
    return length, length * length * deviation / (spacing * abs(ratio))


@compiled(_BARS, const_f8_1d, const_f8_1d, i8, f8, f8, f8)
def wobble(
    bars: Records,
    angles: Array,
    at_rest: Array,
    first: int,
    site: float,
    noise: float,
    persistent: float,
) -> tuple[Overshoot, Lengths]:
    """Return the overshoot and the lengths of the wobble beside a wall.

    The overshoot [m] (see `_overshoot`) is measured on that side of the wall on which a wall at
    rest has the larger overshoot. The lengths are the tail ratio [1], the decay length [m] and the
    wavelength [m], each followed by its standard deviation. Unknown values are NaN.
    """
    bar, rotors = bars[0], angles.size
    rest_angle, length, spacing = bar['rest_angle'], bar['rotor_length'], bar['spacing']
    wobbling, spins, k = bar['lean_ratio'] > 1, bar['spins'] > 0, spacing / length
    noise = max(noise, _ROUNDING)
    error = math.hypot(noise, persistent)
    calm = 0.0 if wobbling else max(noise, _CALM * rest_angle)
    low, high = max(first, 1), min(first + at_rest.size, rotors - 1)
    middle = min(max(math.floor(site) + 1, low), high)
    split, count = middle - low, high - low
    leans = np.empty((2, count))
    beside_wall(angles, at_rest, first, low, middle, spins, rest_angle, leans)
    expected, measured = leans[0], leans[1]
    overshoot = _NO_OVERSHOOT
    square, product, variance, weight, distance = 0.0, 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        there = expected[:split] if side == 0 else expected[split:]
        seen = measured[:split] if side == 0 else measured[split:]
        if not spins:
            found = _overshoot(there, seen, rest_angle, length, calm, error)
            if math.isnan(overshoot[2]) or found[2] > overshoot[2]:
                overshoot = found
        large, small = _LARGEST * rest_angle, _ABOVE_NOISE * noise
        begin, end = tail_of_side(there, large, small)
        sums = tail_sums(seen, begin, min(end, seen.size - 1), rest_angle, k)
        square += sums[0]
        product += sums[1] + sums[2] * noise * noise
        variance += sums[0] + sums[3] - 2 * sums[4]
        half, of_half = half_wavelength(seen, begin, end, rest_angle, error, _BEND)
        if math.isfinite(half):
            weight += 1 / of_half
            distance += half / of_half
    exact = (1 - bar['lean_ratio']) / (1 + bar['lean_ratio'])
    ratio, of_ratio, wave, of_wave = math.nan, math.nan, math.nan, math.nan
    if square > 0:
        ratio, of_ratio = exact + product / square, error * math.sqrt(max(variance, 0.0)) / square
    if weight > 0:
        wave, of_wave = 2 * spacing * distance / weight, 2 * spacing / math.sqrt(weight)
    decay, of_decay = _decay_length(ratio, of_ratio, exact, spacing)
    return overshoot, (ratio, of_ratio, decay, of_decay, wave, of_wave)


class Wobble(NamedTuple):
    """Wobble: deviations of the rotors beside a wall from the uniform states; NaN if unknown.

    amplitude: overshoot |u| - ub of one rotor [m], with its lean |u| and its lean ub in the
        uniform state. The rotor is selected in a wall at rest, on the side with the larger
        overshoot. For a lean ratio d > 1 it is the rotor that leans most; for d <= 1 it is the
        nearest rotor in the uniform state.
    amplitude_deviation: standard deviation of the amplitude [m].
    rest_amplitude: overshoot of the same rotor for a wall at rest [m].
    tail_ratio: deviation of a rotor in the tails, divided by the deviation of its neighbour nearer
        to the wall [1].
    tail_ratio_deviation: standard deviation of the tail ratio [1].
    decay_length: distance over which the tails decrease by a factor e [m].
    decay_length_deviation: standard deviation of the decay length [m].
    wavelength: twice the mean distance between successive zeros of the tails [m].
    wavelength_deviation: standard deviation of the wavelength [m].
    exact_decay_length: decay length by theory, the penetration depth ell [m].
    exact_wavelength: wavelength by theory [m]; 2 rotor spacings for d > 1, otherwise infinite.
    """

    amplitude: float
    amplitude_deviation: float
    rest_amplitude: float
    tail_ratio: float
    tail_ratio_deviation: float
    decay_length: float
    decay_length_deviation: float
    wavelength: float
    wavelength_deviation: float
    exact_decay_length: float
    exact_wavelength: float


class WobbleReporter:
    """Reporter of the wobble of one chain."""

    def __init__(self, chain: Chain) -> None:
        tail = exact_tail(chain)
        wavelength = 2 * math.pi / tail.wave_number if tail.wave_number else math.inf
        self._exact = tail.decay_length, wavelength
        self._bars = np.zeros(1, BARS)
        for name in ('rotor_length', 'spacing', 'rest_angle', 'lean_ratio'):
            self._bars[name] = getattr(chain, name)
        self._bars['spins'] = chain.motion is Motion.SPINNER

    def wobble(
        self,
        angles: Array,
        first: int,
        at_rest: Array,
        site: float,
        noise: float = 0.0,
        persistent: float = 0.0,
    ) -> Wobble:
        """Return the wobble beside a wall at `site`, given finite angles [rad], shape (N,).

        `at_rest` are the angles of a computed wall at rest at the same site, from rotor `first`
        on, in the orientation of the orbit [rad], shape (n,). They may differ from the measured
        angles by whole turns.

        A rotor deviates by e from the uniform state, and its outer neighbour by e'. Without waves,
        e' = F(e), which `next_deviation` computes with the rotor spacing and the rotor length of
        the chain. The slope F'(0) is then lambda_0 = (1 - d) / (1 + d) for the lean ratio d. With
        waves, the tail ratio lambda is fitted to e' = F(e) + (lambda - lambda_0) e on both sides
        of the wall. The wavelength is fitted to the zeros of the tails.
        `noise` is the standard deviation of the angles [rad], and `persistent` is the rms of the
        persistent differences from the orbit [rad].
        """
        overshoot, lengths = wobble(self._bars, angles, at_rest, first, site, noise, persistent)
        return Wobble(*overshoot, *lengths, *self._exact)
