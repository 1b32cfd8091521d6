# SPDX-License-Identifier: Apache-2.0
"""How the rotors beside a wall deviate from the uniform states: amplitude, decay and wavelength.

Which rotors to look at is told by a wall at rest, not by the noisy angles, so that none is chosen
for its noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.chain import Array, Chain, Motion
from soliton_linkage.continuum import exact_tail
from soliton_linkage.cycle import Cycle
from soliton_linkage.deviations import NO_DEVIATIONS
from soliton_linkage.frame_arrays import frame_loops
from soliton_linkage.state_report import energy_reach
from soliton_linkage.static_wall import static_wall

_ABOVE_NOISE = 4.0
_LARGEST = 0.5
_FLAT = 1e-3
_BEND = 0.3
_ROUNDING = 1e-12
_CERTAIN = 3.0
_COARSEST = 0.2


@dataclass(frozen=True)
class Wobble:
    """How rotors beside a wall deviate from the uniform states; NaN where it cannot be told."""

    amplitudes: tuple[float, float]
    """Overshoot of |u| beyond ub [m] before the wall and beyond it, each of one rotor.

    It is the rotor that leans the most where the wall is at rest; without wobble, d <= 1, the
    nearest that is at rest to within the noise.
    """
    amplitude_deviations: tuple[float, float]
    """Standard deviations of the amplitudes [m]."""
    rest_amplitudes: tuple[float, float]
    """The same overshoots for a wall at rest [m]."""
    tail_ratio: float
    """Deviation of a rotor over that of its inner neighbour in the tails [1]."""
    tail_ratio_deviation: float
    """Standard deviation of the ratio [1]."""
    decay_length: float
    """Distance over which the tails fall by e [m]."""
    decay_length_deviation: float
    """Standard deviation of the decay length [m]."""
    wavelength: float
    """Twice the distance of the zeros of the tails [m]; NaN where they do not change sign."""
    wavelength_deviation: float
    """Standard deviation of the wavelength [m]."""
    exact_decay_length: float
    """Theory's decay length, the penetration depth ell [m]."""
    exact_wavelength: float
    """Theory's wavelength [m]: 2 a for d > 1, else infinite."""

    @property
    def amplitude(self) -> float:
        """Amplitude on the side where a wall at rest overshoots more [m]."""
        return self.amplitudes[self._larger]

    @property
    def amplitude_deviation(self) -> float:
        """Standard deviation of that amplitude [m]."""
        return self.amplitude_deviations[self._larger]

    @property
    def rest_amplitude(self) -> float:
        """The same overshoot for a wall at rest [m]."""
        return self.rest_amplitudes[self._larger]

    @property
    def _larger(self) -> int:
        before, beyond = self.rest_amplitudes
        return int(math.isnan(before) or beyond > before)


@dataclass(frozen=True)
class Wall:
    """A wall at rest nearest to that of a state: which rotors are about it, and their angles."""

    first: int
    """Number of the first rotor."""
    angles: Array
    """Actual angles [rad], shape (n,), up to whole turns; as the cycle has them, which the state
    may be upside down."""
    place: float
    """Place of the wall [rotor spacings]."""


def wall_at(chain: Chain, place: float) -> Wall:
    """Wall at rest at a place [rotor spacings], half a spacing or more from both ends.

    Without deviations, and with edge rotors that have not toggled. Raises ValueError for a place
    nearer to an end, and as `static_wall` does.
    """
    last_place = chain.number_of_rotors - 1.5
    if not 0.5 <= place <= last_place:
        raise ValueError(
            f'place = {place} must lie from 0.5 to the number of rotors less 1.5 = {last_place}; '
            'take the wall at an edge from the cycle'
        )
    beside = math.ceil(energy_reach(chain))
    nearest = round(place)
    first, last = max(nearest - beside, 0), min(nearest + beside, chain.number_of_rotors - 1)
    window = replace(
        chain, number_of_rotors=2 * beside + 4, periodic=False, deviations=NO_DEVIATIONS
    )
    before = beside + 1 + (nearest - beside - 1) % 2
    angles = static_wall(window, place - nearest + before)
    shift = before - nearest
    return Wall(first, angles[first + shift : last + shift + 1], place)


def wall_on_cycle(cycle: Cycle, arc: float) -> Wall:
    """Wall at rest at an arc length [rad] of a cycle."""
    about = cycle.stretch(arc)
    return Wall(about.first, about.angles, cycle.place(arc))


class WobbleReporter:
    """Reports the wobble of the states of a chain; what all have in common is kept."""

    def __init__(self, chain: Chain) -> None:
        """Work out what all states have in common."""
        self.chain = chain
        tail = exact_tail(chain)
        self._exact_decay_length = tail.decay_length
        self._exact_wavelength = 2 * math.pi / tail.wave_number if tail.wave_number else math.inf
        self._ratio = (1 - chain.lean_ratio) / (1 + chain.lean_ratio)
        self._loops = frame_loops()

    def wobble(
        self, angles: ArrayLike, wall: Wall, noise: float = 0.0, lasting: float = 0.0
    ) -> Wobble:
        """Wobble of a state beside its wall, angles [rad] of shape (N,).

        The ratio lambda is a least-squares fit to the deviations e from rest outwards on both
        sides, e' = F(e) + (lambda - lambda_0) e with F that of relaxed bars and lambda_0 =
        (1 - d) / (1 + d) its slope; the wavelength is that of a straight line through the zeros.
        Of spinners, whose rotors turn over, amplitudes are NaN. Standard deviations are those of
        the noise [rad] of the angles, and of what lasts beside it [rad], as the root mean square
        of what the orbit leaves of a moving wall or one that waves disturb, as if it were noise.
        """
        checked = np.ascontiguousarray(self.chain.check_angles(angles))
        noise = max(noise, _ROUNDING)
        error = math.hypot(noise, lasting)
        sides = self._sides(checked, wall, noise)
        before, beyond = (self._overshoot(side, noise, error) for side in sides)
        ratio, ratio_deviation = self._ratio_of_tails(sides, noise, error)
        decay, decay_deviation = self._decay_length(ratio, ratio_deviation)
        wavelength, wavelength_deviation = self._wavelength(sides, error)
        return Wobble(
            amplitudes=(before[0], beyond[0]),
            amplitude_deviations=(before[1], beyond[1]),
            rest_amplitudes=(before[2], beyond[2]),
            tail_ratio=ratio,
            tail_ratio_deviation=ratio_deviation,
            decay_length=decay,
            decay_length_deviation=decay_deviation,
            wavelength=wavelength,
            wavelength_deviation=wavelength_deviation,
            exact_decay_length=self._exact_decay_length,
            exact_wavelength=self._exact_wavelength,
        )

    def _sides(self, angles: Array, wall: Wall, noise: float) -> list[_Side]:
        """Deviations before the wall and beyond it, outwards, without the edges of the chain.

        The angle of leaning is theta before the wall; beyond it is -theta for flippers, and
        theta - pi for spinners.
        """
        low = max(wall.first, 1)
        high = min(wall.first + len(wall.angles), self.chain.number_of_rotors - 1)
        middle = min(max(math.floor(wall.place) + 1, low), high)
        expected, measured = np.empty(high - low), np.empty(high - low)
        self._loops.beside_wall(
            angles,
            np.ascontiguousarray(wall.angles),
            wall.first,
            low,
            middle,
            high,
            self.chain.motion is Motion.SPINNER,
            self.chain.rest_angle,
            expected,
            measured,
        )
        before = middle - low
        return [
            self._side(expected[:before], measured[:before], noise),
            self._side(expected[before:], measured[before:], noise),
        ]

    def _side(self, expected: Array, measured: Array, noise: float) -> _Side:
        """Tell the tail, above the noise, from the core, where deviations are large."""
        large, small = _LARGEST * self.chain.rest_angle, _ABOVE_NOISE * noise
        return _Side(expected, measured, *self._loops.tail_of_side(expected, large, small))

    def _overshoot(self, side: _Side, noise: float, error: float) -> tuple[float, float, float]:
        """Overshoot of one rotor [m]: measured, its deviation, and that at rest; else NaN."""
        rest, length = self.chain.rest_angle, self.chain.rotor_length
        if self.chain.motion is Motion.SPINNER or not len(side.expected):
            return math.nan, math.nan, math.nan
        calm = 0.0 if self.chain.lean_ratio > 1 else max(noise, _FLAT * rest)
        at = self._loops.overshooting(side.expected, rest, calm)
        measured, expected = rest + float(side.measured[at]), rest + float(side.expected[at])
        lean = length * math.sin(rest)
        return (
            length * math.sin(measured) - lean,
            length * abs(math.cos(expected)) * error,
            length * math.sin(expected) - lean,
        )

    def _ratio_of_tails(
        self, sides: list[_Side], noise: float, error: float
    ) -> tuple[float, float]:
        """Ratio lambda of the tails on both sides, and its deviation [1].

        From the sums of e (e' - F(e)) and e^2. Noise in e itself makes the first less by the
        slopes times its variance, put back here.
        """
        rest, pitch = self.chain.rest_angle, self.chain.spacing / self.chain.rotor_length
        square = product = shares = both = 0.0
        for side in sides:
            end = min(side.end, len(side.measured) - 1)
            of_side = self._loops.tail_sums(side.measured, side.begin, end, rest, pitch)
            square += of_side[0]
            product += of_side[1] + of_side[2] * noise**2
            shares += of_side[3]
            both += of_side[4]
        if square <= 0:
            return math.nan, math.nan
        variance = error**2 * (square + shares - 2 * both)
        return self._ratio + product / square, math.sqrt(max(variance, 0.0)) / square

    def _decay_length(self, ratio: float, deviation: float) -> tuple[float, float]:
        """Return -a / ln|lambda| and its deviation [m].

        Whether it can be told, to a fifth, is judged by the exact ratio, so that the noise has
        no part in the choice.
        """
        known = abs(self._ratio)
        if not (known > _CERTAIN * deviation and 0 < abs(ratio) < 1):
            return math.nan, math.nan
        if deviation > _COARSEST * known * abs(math.log(known)):
            return math.nan, math.nan
        length = -self.chain.spacing / math.log(abs(ratio))
        return length, length**2 * deviation / (self.chain.spacing * abs(ratio))

    def _wavelength(self, sides: list[_Side], error: float) -> tuple[float, float]:
        """Twice the distance of the zeros on both sides, and its deviation [m]."""
        found = [side.half_wavelength(self.chain.rest_angle, error) for side in sides]
        known = [each for each in found if math.isfinite(each[0])]
        if not known:
            return math.nan, math.nan
        weight = sum(1 / variance for _, variance in known)
        mean = sum(each / variance for each, variance in known) / weight
        return 2 * self.chain.spacing * mean, 2 * self.chain.spacing / math.sqrt(weight)


@dataclass(frozen=True)
class _Side:
    """Angles of leaning of the rotors on one side of a wall, less that of the uniform state."""

    expected: Array
    """Of the wall at rest, outwards [rad], shape (n,)."""
    measured: Array
    """As measured, outwards [rad], shape (n,)."""
    begin: int
    """The first of them in the tail."""
    end: int
    """The first beyond it in the noise."""

    def half_wavelength(self, rest_angle: float, error: float) -> tuple[float, float]:
        """Distance of the zeros of the tail [rotor spacings] and its variance; NaN for none.

        The tail is drawn straight from rotor to rotor, where it changes its sign at each.
        Weights are those of the noise and of how far a large deviation moves a zero, 0.3 e /
        theta_bar.
        """
        e: list[float] = self.measured[self.begin : self.end].tolist()
        start = max(len(e) - 1, 0)
        while start > 0 and e[start - 1] * e[start] < 0:
            start -= 1
        if len(e) - start < 3:
            return math.nan, math.nan
        zeros = []
        for n, (inner, outer) in enumerate(pairwise(e[start:])):
            step = inner - outer
            by_inner, by_outer = -outer / step**2, inner / step**2
            bend = (_BEND * inner / rest_angle) ** 2
            weight = 1 / (error**2 * (by_inner**2 + by_outer**2) + bend)
            zeros.append((n, n + inner / step, by_inner, by_outer, bend, weight))
        whole = sum(weight for *_, weight in zeros)
        centre = sum(n * weight for n, *_, weight in zeros) / whole
        distance = scale = variance = of_rotor = 0.0
        for n, zero, by_inner, by_outer, bend, weight in zeros:
            share = (n - centre) * weight
            distance += share * zero
            scale += share * (n - centre)
            variance += (error * (of_rotor + share * by_inner)) ** 2 + share**2 * bend
            of_rotor = share * by_outer
        variance += (error * of_rotor) ** 2
        return distance / scale, variance / scale**2
