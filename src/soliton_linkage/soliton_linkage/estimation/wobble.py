# SPDX-License-Identifier: Apache-2.0
"""How the rotors beside a wall deviate from the uniform states: amplitude, decay and wavelength.

Which rotors to look at is told by a wall at rest, not by the noisy angles, so that none is chosen
for its noise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import b1, compiled, const_f8_1d, f8, f8_2d, i8, records
from soliton_linkage.estimation.frames import wrapped
from soliton_linkage.estimation.motion_class import next_deviation, tail_of_side
from soliton_linkage.estimation.settings import DEFAULTS, WobbleSettings, record_dtype
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
"""What a wobble depends on of a chain: lengths [m], rest angle [rad], d and whether it spins."""
_NUMBERS, _BARS = records(record_dtype(WobbleSettings)), records(BARS)
_NOT_TOLD = (math.nan, math.nan, math.nan)
"""The overshoot of a spinner, or of no rotor [m]."""


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
    """Set leans beside a wall less that of the uniform state [rad], outwards, shape (2, n).

    The first row is that of the wall at rest, whose angles are those of rotors from the first on;
    the second is measured. The columns are rotors from a low one on, first those before the
    middle, then those beyond, where the rotors of spinners turn over.
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
    """Number of the rotor that leans the most or, where any is calm [rad], of the first of them.

    Without wobble, for calm > 0, it is the last rotor where none is calm.
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
    """Sums over a tail of e^2, e (e' - F(e)), F'(e), (F'(e) e)^2 and F'(e) e times e before."""
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
    """Distance of the zeros of a tail [rotor spacings] and its variance; NaN for none.

    The tail is drawn straight from rotor to rotor, where it changes its sign at each. Weights
    are those of the noise and of how far a large deviation moves a zero, bend e / theta_bar.
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
    """Overshoot beyond the lean at rest that is measured, its deviation, and that at rest [m]."""
    if not expected.size:
        return _NOT_TOLD
    at = overshooting(expected, rest_angle, calm)
    lean = length * math.sin(rest_angle)
    return (
        length * math.sin(rest_angle + measured[at]) - lean,
        length * abs(math.cos(rest_angle + expected[at])) * error,
        length * math.sin(rest_angle + expected[at]) - lean,
    )


@compiled(_NUMBERS, f8, f8, f8, f8)
def _decay_length(
    settings: Records, ratio: float, deviation: float, exact: float, spacing: float
) -> tuple[float, float]:
    """Decay length -a / ln|lambda| and its deviation [m].

    Whether it can be told, to a fifth, is judged by the exact ratio, so that the noise has no part
    in the choice.
    """
    known = abs(exact)
    if not (known > settings[0]['certain'] * deviation and 0 < abs(ratio) < 1):
        return math.nan, math.nan
    if deviation > settings[0]['coarsest'] * known * abs(math.log(known)):
        return math.nan, math.nan
    length = -spacing / math.log(abs(ratio))
    return length, length * length * deviation / (spacing * abs(ratio))


@compiled(_NUMBERS, _BARS, const_f8_1d, const_f8_1d, i8, f8, f8, f8)
def wobble(
    settings: Records,
    bars: Records,
    angles: Array,
    at_rest: Array,
    first: int,
    site: float,
    noise: float,
    lasting: float,
) -> tuple[Overshoot, Lengths]:
    """Overshoot, tails and zeros beside a wall at a place; see `WobbleReporter.wobble`.

    The wall at rest has angles of its rotors from the first on [rad]. The overshoot is, on the
    side where it is larger at rest, that measured, its deviation, and that at rest [m], NaN of
    spinners and of no rotor. Lengths are the ratio of the tails [1], the decay length [m] and the
    wavelength [m], each with its deviation; NaN where they are not told.
    """
    numbers, bar, rotors = settings[0], bars[0], angles.size
    rest_angle, length, spacing = bar['rest_angle'], bar['rotor_length'], bar['spacing']
    wobbling, spins, k = bar['lean_ratio'] > 1, bar['spins'] > 0, spacing / length
    noise = max(noise, numbers['least_noise'])
    error = math.hypot(noise, lasting)
    calm = 0.0 if wobbling else max(noise, numbers['calm'] * rest_angle)
    low, high = max(first, 1), min(first + at_rest.size, rotors - 1)
    middle = min(max(math.floor(site) + 1, low), high)
    split, count = middle - low, high - low
    leans = np.empty((2, count))
    beside_wall(angles, at_rest, first, low, middle, spins, rest_angle, leans)
    expected, measured = leans[0], leans[1]
    overshoot = _NOT_TOLD
    square, product, variance, weight, distance = 0.0, 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        there = expected[:split] if side == 0 else expected[split:]
        seen = measured[:split] if side == 0 else measured[split:]
        if not spins:
            found = _overshoot(there, seen, rest_angle, length, calm, error)
            if math.isnan(overshoot[2]) or found[2] > overshoot[2]:
                overshoot = found
        large, small = numbers['largest'] * rest_angle, numbers['above_noise'] * noise
        begin, end = tail_of_side(there, large, small)
        sums = tail_sums(seen, begin, min(end, seen.size - 1), rest_angle, k)
        square += sums[0]
        product += sums[1] + sums[2] * noise * noise
        variance += sums[0] + sums[3] - 2 * sums[4]
        half, of_half = half_wavelength(seen, begin, end, rest_angle, error, numbers['bend'])
        if math.isfinite(half):
            weight += 1 / of_half
            distance += half / of_half
    exact = (1 - bar['lean_ratio']) / (1 + bar['lean_ratio'])
    ratio, of_ratio, wave, of_wave = math.nan, math.nan, math.nan, math.nan
    if square > 0:
        ratio, of_ratio = exact + product / square, error * math.sqrt(max(variance, 0.0)) / square
    if weight > 0:
        wave, of_wave = 2 * spacing * distance / weight, 2 * spacing / math.sqrt(weight)
    decay, of_decay = _decay_length(settings, ratio, of_ratio, exact, spacing)
    return overshoot, (ratio, of_ratio, decay, of_decay, wave, of_wave)


class Wobble(NamedTuple):
    """How rotors beside a wall deviate from the uniform states; NaN where it cannot be told.

    amplitude: overshoot of |u| beyond ub [m] of one rotor, on the side of the wall where one at
        rest overshoots more. It is the rotor that leans the most where the wall is at rest;
        without wobble, d <= 1, the nearest that is at rest to within the noise.
    amplitude_deviation: standard deviation of the amplitude [m].
    rest_amplitude: the same overshoot for a wall at rest [m].
    tail_ratio: deviation of a rotor over that of its inner neighbour in the tails [1].
    tail_ratio_deviation: standard deviation of the ratio [1].
    decay_length: distance over which the tails fall by e [m].
    decay_length_deviation: standard deviation of the decay length [m].
    wavelength: twice the distance of the zeros of the tails [m]; NaN where they do not change
        sign.
    wavelength_deviation: standard deviation of the wavelength [m].
    exact_decay_length: theory's decay length, the penetration depth ell [m].
    exact_wavelength: theory's wavelength [m]: 2 a for d > 1, else infinite.
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


class RestingWall(NamedTuple):
    """A wall at rest nearest to that of a state: which rotors are about it, and their angles."""

    first: int
    """Number of the first rotor."""
    angles: Array
    """Actual angles [rad], shape (n,), up to whole turns; as the orbit has them, which the state
    may be upside down."""
    site: float
    """Place of the wall [rotor spacings]."""


class WobbleReporter:
    """Reports the wobble of the states of a chain; what all have in common is kept."""

    def __init__(self, chain: Chain, settings: WobbleSettings = DEFAULTS.wobble) -> None:
        """Work out what all states have in common."""
        self._settings = settings
        tail = exact_tail(chain)
        wavelength = 2 * math.pi / tail.wave_number if tail.wave_number else math.inf
        self._exact = tail.decay_length, wavelength
        self._bars = np.zeros(1, BARS)
        for name in ('rotor_length', 'spacing', 'rest_angle', 'lean_ratio'):
            self._bars[name] = getattr(chain, name)
        self._bars['spins'] = chain.motion is Motion.SPINNER

    def wobble(
        self, angles: Array, wall: RestingWall, noise: float = 0.0, lasting: float = 0.0
    ) -> Wobble:
        """Wobble of a state beside its wall, angles [rad] finite and of shape (N,).

        The ratio lambda is a least-squares fit to the deviations e from rest outwards on both
        sides, e' = F(e) + (lambda - lambda_0) e with F that of relaxed bars and lambda_0 =
        (1 - d) / (1 + d) its slope; the wavelength is that of a straight line through the zeros.
        Of spinners, whose rotors turn over, amplitudes are NaN. Standard deviations are those of
        the noise [rad] of the angles, and of what lasts beside it [rad], as the root mean square
        of what the orbit leaves of a moving wall or one that waves disturb, as if it were noise.
        """
        overshoot, lengths = wobble(
            self._settings.record,
            self._bars,
            angles,
            wall.angles,
            wall.first,
            wall.site,
            noise,
            lasting,
        )
        return Wobble(*overshoot, *lengths, *self._exact)
