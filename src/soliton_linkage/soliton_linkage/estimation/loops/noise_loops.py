# SPDX-License-Identifier: Apache-2.0
"""Sums over frames that tell noise from what lasts, for `FrameNoise`: one record, shape (1,)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import COUNT, NUMBER, READ, YES, compiled, records
from soliton_linkage.estimation.loops.frame_loops import products_in_time
from soliton_linkage.estimation.settings import NoiseSettings, record_dtype
from soliton_linkage.linkage.chain import Array

Records = NDArray[np.void]
Estimate = tuple[float, float, float, float, float, float]
"""As `estimate` returns it."""

_SQUARES = ('squares', 'freedoms', 'recent_squares', 'recent_freedoms')
PAIRS = ('products', 'pairs', 'wall', 'wall_share', 'wall_chance')
NOISE = np.dtype([(name, np.float64) for name in (*_SQUARES, *PAIRS)])
"""Fading sums: of squares [rad^2] and their degrees of freedom [1], of all frames and of late; of
products of frames apart [rad^2] and how many they are [1], the same by t^2, the weights of these
and the squares of the weights [1]."""
_SUMS = records(NOISE, writable=True)
_READ_SUMS = records(NOISE)
_NUMBERS = records(record_dtype(NoiseSettings))


@compiled(NUMBER, NUMBER, NUMBER, NUMBER)
def _by_chance(
    square: float, squared_weights: float, largest: float, significance: float
) -> float:
    """Bernstein's bound of a sum of weighted products of noise [rad^2], 17 / 9 as variable."""
    deviation = significance * math.sqrt(17 / 9 * squared_weights)
    return square * (deviation + significance**2 / 2 * largest)


@compiled(_READ_SUMS, _NUMBERS, NUMBER)
def estimate(noise: Records, settings: Records, given: float) -> Estimate:
    """Variance of the noise [rad^2], by the sums so far and by the one that is given.

    Returns it and what of it is noise for sure, what frames have of late with what lasts, what
    lasts of all rotors, and of the wall [rad^2], and the degrees of freedom of the sums [1].
    """
    sums, significance = noise[0], settings[0]['significance']
    freedoms, recent = sums['freedoms'], sums['recent_freedoms']
    whole = sums['squares'] / freedoms if freedoms else 0.0
    scatter = sums['recent_squares'] / recent if recent else 0.0
    chance = _by_chance(whole, sums['pairs'], 1.0, significance)
    sure = sums['products'] > chance and chance > 0
    lasting = sums['products'] / sums['pairs'] if sure else 0.0
    sure = sums['wall'] > _by_chance(whole, sums['wall_chance'], 0.25, significance)
    excess = sums['wall'] / sums['wall_share'] if sure else 0.0
    white = max(whole - lasting, settings[0]['least_noise'] ** 2)
    doubt = 1 + significance * math.sqrt(2 / max(freedoms, 1.0))
    variance = white if white > given * doubt else given
    most = (sums['products'] + chance) / sums['pairs'] if sums['pairs'] else whole
    least = variance if given else max(whole - most, 0.0)
    return variance, least, scatter, lasting, excess, freedoms


@compiled(
    *(_SUMS, _NUMBERS, NUMBER, NUMBER, YES, READ, COUNT, READ, COUNT),
    *(READ, COUNT, READ, COUNT, NUMBER),
)
def learn(
    noise: Records,
    settings: Records,
    elapsed: float,
    given: float,
    third: bool,
    oldest: Array,
    oldest_freedoms: int,
    older: Array,
    older_freedoms: int,
    left: Array,
    freedoms: int,
    tangent: Array,
    first: int,
    squares: float,
) -> Estimate:
    """Take in what is left of a frame, a time [s] after the last; returns the `estimate`.

    What is left of rotors [rad], (N,), has so many degrees of freedom, in this frame and in the
    two before, which count where it is the third; the tangent begins at a first rotor.
    """
    sums, numbers = noise[0], settings[0]
    fade = 1 - 1 / numbers['memory']
    sums['squares'] = fade * sums['squares'] + squares
    sums['freedoms'] = fade * sums['freedoms'] + freedoms
    recent = math.exp(-min(elapsed / numbers['recent_time'], 1 / numbers['recent_frames']))
    sums['recent_squares'] = recent * sums['recent_squares'] + squares
    sums['recent_freedoms'] = recent * sums['recent_freedoms'] + freedoms
    if third:
        whole, wall, free, chance = products_in_time(oldest, older, left, tangent, first)
        pairs = min(oldest_freedoms, older_freedoms, freedoms)
        sums['products'] = fade * sums['products'] + whole
        sums['pairs'] = fade * sums['pairs'] + pairs
        sums['wall'] = fade * sums['wall'] + wall
        sums['wall_share'] = fade * sums['wall_share'] + free
        sums['wall_chance'] = fade**2 * sums['wall_chance'] + chance
    return estimate(noise, settings, given)
