# SPDX-License-Identifier: Apache-2.0
"""How the rotors beside a wall deviate from the uniform states: amplitude, decay and wavelength.

Which rotors to look at is told by a wall at rest, not by the noisy angles, so that none is chosen
for its noise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from soliton_linkage.estimation.loops import wobble_loops
from soliton_linkage.estimation.settings import DEFAULTS, WobbleSettings
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.tail import exact_tail


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
    place: float
    """Place of the wall [rotor spacings]."""


class WobbleReporter:
    """Reports the wobble of the states of a chain; what all have in common is kept."""

    def __init__(self, chain: Chain, settings: WobbleSettings = DEFAULTS.wobble) -> None:
        """Work out what all states have in common."""
        self.chain = chain
        self._settings = settings
        tail = exact_tail(chain)
        self._exact_decay_length = tail.decay_length
        self._exact_wavelength = 2 * math.pi / tail.wave_number if tail.wave_number else math.inf
        self._ratio = (1 - chain.lean_ratio) / (1 + chain.lean_ratio)
        self._spins = chain.motion is Motion.SPINNER
        self._pitch = chain.spacing / chain.rotor_length
        self._calm = settings.calm * chain.rest_angle

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
        chain = self.chain
        noise = max(noise, self._settings.least_noise)
        low = max(wall.first, 1)
        high = min(wall.first + len(wall.angles), chain.number_of_rotors - 1)
        middle = min(max(math.floor(wall.place) + 1, low), high)
        overshoot, tails, zeros = wobble_loops.wobble(
            self._settings.record,
            angles,
            wall.angles,
            wall.first,
            low,
            middle,
            high,
            self._spins,
            chain.rest_angle,
            chain.rotor_length,
            self._pitch,
            0.0 if chain.lean_ratio > 1 else max(noise, self._calm),
            noise,
            math.hypot(noise, lasting),
        )
        ratio, ratio_deviation = self._ratio + tails[0], tails[1]
        decay, decay_deviation = self._decay_length(ratio, ratio_deviation)
        return Wobble(
            amplitude=overshoot[0],
            amplitude_deviation=overshoot[1],
            rest_amplitude=overshoot[2],
            tail_ratio=ratio,
            tail_ratio_deviation=ratio_deviation,
            decay_length=decay,
            decay_length_deviation=decay_deviation,
            wavelength=2 * chain.spacing * zeros[0],
            wavelength_deviation=2 * chain.spacing * zeros[1],
            exact_decay_length=self._exact_decay_length,
            exact_wavelength=self._exact_wavelength,
        )

    def _decay_length(self, ratio: float, deviation: float) -> tuple[float, float]:
        """Return -a / ln|lambda| and its deviation [m].

        Whether it can be told, to a fifth, is judged by the exact ratio, so that the noise has
        no part in the choice.
        """
        known = abs(self._ratio)
        if not (known > self._settings.certain * deviation and 0 < abs(ratio) < 1):
            return math.nan, math.nan
        if deviation > self._settings.coarsest * known * abs(math.log(known)):
            return math.nan, math.nan
        length = -self.chain.spacing / math.log(abs(ratio))
        return length, length**2 * deviation / (self.chain.spacing * abs(ratio))
