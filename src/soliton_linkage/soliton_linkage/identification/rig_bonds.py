# SPDX-License-Identifier: Apache-2.0
"""Checks of the lengths of a rig: distances between neighbouring masses, at rest and in motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from soliton_linkage.identification.mounting import MOST_NAMED
from soliton_linkage.linkage.chain import Array, Chain, staggered

RIGHT, DOUBTFUL, WRONG = 'right', 'doubtful', 'wrong'
_LARGEST_STRETCH = 0.02
"""Largest acceptable stretch of a bond, the relative difference of its apparent from its
configured length [1]. An encoder zero error of 0.05 rad causes a larger stretch."""
_LARGEST_OFFSET = 2.9
"""Largest zero error that is tried as a cause of stretches [rad]; half turns are tried, too."""
_LARGEST_CHANGE = 0.3
"""Relative errors of lengths up to this are tried as the cause of the stretches [1]."""
_EXPLAINED = 1 / 3
"""A correction explains stretches if it reduces their root mean square below this fraction [1]."""
_EQUALLY_GOOD = 1.5
"""Besides the best correction, for example of a sign, others are reported if they leave a root
mean square stretch smaller than this times the stretch that the best one leaves [1]."""
NO_CAUSE = 'no single cause explains this'
_MOST_FRAMES = 200
"""Largest number of frames from which the stretches are computed [1]."""
_TURNED = 1.0
"""Rotors that turn by more than this during the check count as turned by a soliton [rad]."""
_TURNED_ROTORS = 0.5
"""Rotor lengths are checked if at least this fraction of the rotors is turned [1]."""
_LENGTH_ERROR = 0.06
"""Smallest relative error of the rotor lengths that is reported [1]. In kicked chains, strained
springs imitate errors of up to 0.05."""
_BETTER = 0.65
"""A length error is reported if it reduces the root mean square variation of bond lengths to this
fraction or less [1]."""


class RigFinding(NamedTuple):
    """Result of one check."""

    verdict: str
    subject: str
    text: str


class Bonds:
    """Distances between the masses of neighbours, from readings at rest [rad], (T, N)."""

    def __init__(self, chain: Chain, angles: Array) -> None:
        self.angles = angles[:: -(-len(angles) // _MOST_FRAMES)]
        self._pivots, self._lengths = chain.pivots, chain.rotor_lengths
        self._rest = chain.rest_lengths[: chain.number_of_rotors - 1]

    def stretches(self, angles: Array, rotor_scale: float | Array = 1.0) -> Array:
        """Return the median stretch of each bond over all frames [1], (N - 1,)."""
        return np.asarray(np.median(self._apart(angles, rotor_scale) / self._rest - 1, axis=0))

    def variations(self, angles: Array, rotor_scale: float | Array = 1.0) -> Array:
        """Return the relative differences of lengths from their values at rest [1], (T, N - 1)."""
        apart = self._apart(angles, rotor_scale)
        return np.asarray(apart / np.median(self._apart(self.angles, rotor_scale), axis=0) - 1)

    def _apart(self, angles: Array, rotor_scale: float | Array) -> Array:
        lengths = self._lengths * rotor_scale
        x = self._pivots + lengths * np.sin(angles)
        apart = np.hypot(np.diff(x, axis=1), np.diff(lengths * np.cos(angles), axis=1))
        return np.asarray(apart)

    def _shifted(self, rotors: float | Array, step: float) -> Array:
        return self.stretches(self.angles - step * rotors)

    def _lengthened(self, rotors: float | Array, step: float) -> Array:
        return self.stretches(self.angles, 1 + step * rotors)

    def corrections(self, names: Sequence[str]) -> Iterator[tuple[Array, str]]:
        """Yield the stretches after each correction that is tried, and its text."""
        angles, ones = self.angles, np.eye(len(names))
        yield self.stretches(angles[:, ::-1]), 'the joints are in the reverse order'
        common, value = _fitted(partial(self._shifted, 1.0), np.pi)
        yield common, f'all readings are too large by {value:.2g} rad'
        for n, one in enumerate(ones):
            yield self.stretches(angles * (1 - 2 * one)), f'{names[n]} has the wrong sign: -phi'
            yield self.stretches(angles - np.pi * one), f'{names[n]} is turned by half a turn'
        for n, other in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[n, other]] = other, n
            text = f'{names[n]} and {names[other]} are exchanged'
            yield self.stretches(angles[:, order]), text
        for n, one in enumerate(ones):
            found, value = _fitted(partial(self._shifted, one), _LARGEST_OFFSET)
            yield found, f'the reading of {names[n]} is too large by {value:.2g} rad'
            found, value = _fitted(partial(self._lengthened, one), _LARGEST_CHANGE)
            yield found, f'the length of {names[n]} differs by {value:+.1%}'
        found, value = _fitted(partial(self._lengthened, 1.0), _LARGEST_CHANGE)
        yield found, f'all rotor lengths or rest lengths differ, rotors by {value:+.1%}'
        now = self.stretches(angles)
        for n in np.flatnonzero(~(np.abs(now) > _LARGEST_CHANGE)).tolist():
            text = f'the rest length of the bond {names[n]} to {names[n + 1]} differs by'
            yield now * (1 - np.eye(len(now))[n]), f'{text} {now[n]:+.1%}'


def is_staggered(chain: Chain, angles: Array) -> bool:
    """Return whether readings [rad], (T, N), fit the chain only as staggered angles."""
    bonds = Bonds(chain, angles)
    now, other = (
        size_of(bonds.stretches(each)) for each in (bonds.angles, staggered(bonds.angles))
    )
    return now > _LARGEST_STRETCH and other < _EXPLAINED * now


def size_of(stretches: Array) -> float:
    """Return the root mean square of the stretches that are known [1]."""
    known = stretches[np.isfinite(stretches)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def _fitted(stretches: Callable[[float], Array], largest: float) -> tuple[Array, float]:
    grid = np.linspace(-largest, largest, 25)
    best = grid[np.argmin([size_of(stretches(float(value))) for value in grid])]
    step = grid[1] - grid[0]
    near = max(best - step, -largest), min(best + step, largest)
    found = minimize_scalar(lambda value: size_of(stretches(value)), bounds=near, method='bounded')
    return stretches(float(found.x)), float(found.x)


def chain_findings(bonds: Bonds, names: Sequence[str]) -> Iterator[RigFinding]:
    """Yield whether the bond lengths at rest agree with the chain."""
    now = bonds.stretches(bonds.angles)
    if not np.isfinite(now).any():
        return
    largest = float(np.nanmax(np.abs(now)))
    if largest < _LARGEST_STRETCH:
        text = f'all bonds fit the configured chain; the largest difference is {largest:.2%}'
        yield RigFinding(RIGHT, 'chain', text)
        return
    n = int(np.nanargmax(np.abs(now)))
    text = f'the bond {names[n]} to {names[n + 1]} differs by {now[n]:+.1%} from the chain'
    corrected = bonds.corrections(names)
    sizes = [(size_of(np.where(np.isnan(to), now, to)), cause) for to, cause in corrected]
    least = max(min(size for size, _ in sizes), _LARGEST_STRETCH / 10)
    if least < _EXPLAINED * size_of(now):
        causes = [cause for size, cause in sizes if size < _EQUALLY_GOOD * least]
        yield RigFinding(WRONG, 'chain', f'{text}: {"; or ".join(causes[:MOST_NAMED])}')
        return
    count = int(np.nansum(np.abs(now) > _LARGEST_STRETCH))
    text += (
        f', and {count} bonds by more than {_LARGEST_STRETCH:.0%}; {NO_CAUSE}: '
        'set the zeros of the encoders, and measure spacing, rotor length and rest angle'
    )
    yield RigFinding(WRONG, 'chain', text)


def length_findings(bonds: Bonds, moving: Array, names: Sequence[str]) -> Iterator[RigFinding]:
    """Yield whether a moving soliton changes bond lengths; readings `moving` [rad], (T, N).

    At rest, rotors of another length have the same angles if the rest lengths are also different.
    While a soliton passes, the bond lengths are constant only for the correct rotor lengths.
    """
    turned = np.ptp(moving, axis=0) > _TURNED
    if not np.isfinite(moving).all() or np.mean(turned) < _TURNED_ROTORS:
        text = (
            'rotor lengths were not checked, because most rotors were not turned by a soliton: at '
            'rest, other rotor lengths with other rest lengths can have the same angles'
        )
        yield RigFinding(DOUBTFUL, 'lengths', text)
        return
    some = moving[:: -(-len(moving) // _MOST_FRAMES)]

    def lengthened(rotors: Array, step: float) -> Array:
        return bonds.variations(some, 1 + step * rotors)

    now = size_of(bonds.variations(some))
    tried, ones = list[tuple[float, float, str]](), np.eye(len(names))
    for cause, rotors in (('', ones.sum(axis=0)), *zip(names, ones, strict=True)):
        found, value = _fitted(partial(lengthened, rotors), _LARGEST_CHANGE)
        tried.append((size_of(found), value, cause))
    least, value, cause = min(tried)
    if least < _BETTER * now and abs(value) > _LENGTH_ERROR:
        whose = f'the length of {cause} differs' if cause else 'all rotor lengths differ'
        text = (
            f'while a soliton moves, the lengths of bonds vary by {now:.1%}: {whose} by about '
            f'{value:+.0%} from the chain; measure the rotors'
        )
        yield RigFinding(WRONG, 'lengths', text)
    elif min(size_of(lengthened(ones.sum(axis=0), step)) for step in (-0.1, 0.1)) > now:
        text = f'while a soliton moves, the lengths of bonds vary by only {now:.1%}'
        yield RigFinding(RIGHT, 'lengths', text)
    else:
        text = (
            'rotor lengths were not checked, because the motion strained the springs, or the '
            'noise is large; turn the rotors slowly'
        )
        yield RigFinding(DOUBTFUL, 'lengths', text)
