# SPDX-License-Identifier: Apache-2.0
"""How the rotors beside a wall deviate from the uniform states: amplitude, decay and wavelength.

Which rotors to look at is told by a wall at rest, not by the noisy angles, so that none is chosen
for its noise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

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
        self._settings = settings
        tail = exact_tail(chain)
        wavelength = 2 * math.pi / tail.wave_number if tail.wave_number else math.inf
        self._exact = tail.decay_length, wavelength
        self._bars = np.zeros(1, wobble_loops.BARS)
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
        overshoot, lengths = wobble_loops.wobble(
            self._settings.record,
            self._bars,
            angles,
            wall.angles,
            wall.first,
            wall.place,
            noise,
            lasting,
        )
        return Wobble(*overshoot, *lengths, *self._exact)
