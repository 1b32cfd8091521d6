# SPDX-License-Identifier: Apache-2.0
"""What the analysis of a frame computes rotor by rotor, in numpy; `frame_kernels` compiles it.

The functions of both modules are the same but for rounding. Frames are actual angles [rad],
shape (N,), NaN where unknown, with their sines and cosines. Rows of springs are extensions [m]
and levers A and B [m/rad], shape (3, springs).
"""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from soliton_linkage.linkage.chain import Array, springs_between, wrapped

Flags = NDArray[np.bool_]

_LARGEST_ANGLE = 1e9
_LEAST_LEVER = 1e-9
_LEAST_LOGARITHM = -600.0
_TINY = float(np.finfo(np.float64).tiny)


class FrameSines(NamedTuple):
    """Actual angles of a frame [rad], NaN where unknown, sines and cosines, shape (N,) each."""

    angles: Array
    sines: Array
    cosines: Array


def sines_of(angles: Array) -> FrameSines:
    """Sines and cosines of the angles of a frame [rad], contiguous, shape (N,)."""
    sines, cosines = np.empty_like(angles), np.empty_like(angles)
    frame_loops().sines_and_cosines(angles, sines, cosines)
    return FrameSines(angles, sines, cosines)


@cache
def frame_loops() -> Any:
    """Return the module `frame_kernels` or, where numba is absent, this one."""
    try:
        from soliton_linkage.estimation.loops import frame_kernels
    except ImportError:
        from soliton_linkage.estimation.loops import frame_arrays

        return frame_arrays
    return frame_kernels


def median(values: Array) -> float:
    """Median of numbers of which none is NaN, whose order is lost: numpy's takes far longer."""
    half = len(values) // 2
    if len(values) % 2:
        values.partition(half)
        return float(values[half])
    values.partition((half - 1, half))
    return (float(values[half - 1]) + float(values[half])) / 2


def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
    """Angles as read without jumps [rad], as seen; NaN where they are not finite or too large.

    The last that were read [rad] and their turns, each of shape (N,), are brought up to date.
    """
    readable = np.isfinite(angles) & (np.abs(angles) < _LARGEST_ANGLE)
    read = np.where(readable, angles, np.nan)
    jumps = np.rint((read - last) / (2 * math.pi))
    turns -= np.where(np.isfinite(jumps), jumps, 0.0)
    last[readable] = read[readable]
    seen[:] = read + 2 * math.pi * turns


def all_within(values: Array, limit: float) -> bool:
    """Whether the absolute values of a row are all known, finite and no more than a limit."""
    largest = float(np.abs(values).max())
    return largest <= limit and largest < math.inf


def compare(
    angles: Array,
    corrections: Array,
    upside_down: bool,
    before: Array,
    about: Array,
    beyond: Array,
    first: int,
    differences: Array,
) -> None:
    """Differences of angles less corrections from those of a wall, -pi to pi [rad], shape (N,).

    The wall has angles about it from the first of its rotors on, and before and beyond them
    those of a background, shape (N,) each.
    """
    end = first + len(about)
    expected = np.concatenate([before[:first], about, beyond[end:]])
    read = angles - corrections
    differences[:] = wrapped((math.pi - read if upside_down else read) - expected)


def look(
    differences: Array,
    first: int,
    tangent: Array,
    limit: float,
    spread: float,
    least: float,
    doubtful: Flags,
    outlying: Flags,
    used: Flags,
    left: Array,
) -> tuple[tuple[int, int, int], bool, tuple[float, float, float], float]:
    """Find the arc that a frame shows, and what it leaves; see `FrameView`.

    Takes what the arc explains off the differences [rad], shape (N,). Outlying are those whose
    square is above the limit and spread t^2 [rad^2], and the doubtful, shape (N,) or (0,). Of
    the rotors about the wall those are used, shape (n,), that are known and not outlying, unless
    these hold no more than the least share of t^2; of them something is left [rad], shape (n,).
    Returns the numbers known, outlying and used about the wall; whether any is outlying at all;
    the information [1], how far ahead the arc is [rad], the sum of squares of left [rad^2]; and
    the largest difference that then remains [rad], infinite where one is not known.
    """
    window = slice(first, first + len(tangent))
    about = differences[window]
    squares = differences * differences
    squares[window] -= spread * tangent**2
    outlying[:] = squares > limit
    if len(doubtful):
        outlying |= doubtful
    used[:] = np.isfinite(about)
    known, excluded = int(np.count_nonzero(used)), int(np.count_nonzero(outlying[window]))
    if excluded:
        kept = used & ~outlying[window]
        if np.sum(tangent[kept] ** 2) > least * np.sum(tangent[used] ** 2):
            used[:] = kept
    weights = np.where(used, tangent, 0.0)
    information = float(weights @ weights)
    ahead = float(weights @ np.where(used, about, 0.0)) / information if information else 0.0
    about -= ahead * tangent
    left[:] = np.where(used, about, 0.0)
    counted = int(np.count_nonzero(used))
    squared = float(left @ left)
    largest = float(np.abs(differences).max())
    largest = largest if math.isfinite(largest) else math.inf
    strange = bool(outlying.any())
    return (known, excluded, counted), strange, (information, ahead, squared), largest


def sines_and_cosines(angles: Array, sines: Array, cosines: Array) -> None:
    """Sines and cosines of angles [rad], NaN where unknown, shape (N,) each."""
    with np.errstate(invalid='ignore'):
        np.sin(angles, out=sines)
        np.cos(angles, out=cosines)


def spline(knots: Array, coefficients: Array, degree: int, at: float, values: Array) -> None:
    """Values of B-splines with knots in common, shape (M,); coefficients of shape (K, M)."""
    values[:] = BSpline.construct_fast(knots, coefficients, degree)(at)


def springs(
    sines: Array, cosines: Array, parameters: Array, periodic: bool, rows: Array
) -> tuple[float, float]:
    """Rows of springs; parameters are r [m], a [m], c [m^2] and lbar [m], see `Chain.springs`.

    They are of shape (4, N), of which those of springs count as far as there are springs.
    Returns how the rotors twist and stand, the sums of sin(theta_n + theta_{n+1}) =
    (-1)^n sin(phi_{n+1} - phi_n) and, but for the edge rotors, of cos(theta_n).
    """
    count = rows.shape[1]
    lengths, of_springs = parameters[0], parameters[1:, :count]
    h, v = lengths * sines, lengths * cosines
    after = np.arange(1, count + 1)
    following = h.take(after, mode='wrap'), v.take(after, mode='wrap')
    rows[:] = springs_between((h[:count], v[:count]), following, *of_springs)
    signs = 1.0 - 2.0 * (np.arange(len(sines)) % 2)
    twists = sines[1:] * cosines[:-1] - cosines[1:] * sines[:-1]
    return float(signs[:-1] @ twists), float(signs[1:-1] @ cosines[1:-1])


def elastic(
    rows: Array,
    half: Array,
    lefts: Array,
    rights: Array,
    periodic: bool,
    variance: float,
    walls: Array,
    reach: float,
) -> tuple[float, float, float, float]:
    """Energy of springs [J] less that of the noise, its wake, and two sums of `_elastic`.

    Half of the stiffnesses [N/m], and the same for noise of rotors on the left and the right of
    each spring, are of shape (springs,). The wake [J] is that of the springs, at n + 1/2, out
    of reach of all walls, whose places [rotor spacings] grow from the first beyond one end to
    the last beyond the other, shape (W + 2,). The sums are |H|^2 / 4 [N^2 m^2] and tau H tau in
    the same units with the energy, |tau|^2 / 4.
    """
    extensions, firsts, seconds = rows[0], lefts * rows[1] ** 2, rights * rows[2] ** 2
    levers, pulls = firsts + seconds, half * extensions
    stretched = pulls * extensions
    energies = stretched - variance * levers
    squares = float(levers @ levers) + 2 * _joint(seconds, firsts, periodic)
    of_next = lefts * extensions * rows[1]
    pulling = float(stretched @ levers) + 2 * _joint(pulls * rows[2], of_next, periodic)
    return float(energies.sum()), _wake(energies, 0.5, walls, reach), squares, pulling


def kinetic(
    half: Array, noisy: Array, rates: Array, variance: float, walls: Array, reach: float
) -> tuple[float, float, float, float]:
    """Energy of rotors [J] less that of the noise, its wake as of springs, and two sums.

    They are those of the energies' products with the inertia of the rotors that are noisy, and
    of the squares of these.
    """
    energies = half * (rates * rates) - variance * noisy
    wake = _wake(energies, 0.0, walls, reach)
    return float(energies.sum()), wake, float(energies @ noisy), float(noisy @ noisy)


def topology(
    rows: Array, before: int, beyond: int, domain: float
) -> tuple[float, float, int, int, float]:
    """Sums of (A^2 - B^2) / (A^2 + B^2) before and beyond the walls, and where the mode sits.

    Between the sums and the centre of t_n^2 [rotor spacings] are the signs of the first and the
    last bond that are above the domain, 0 where there is none.
    """
    first, second = rows[1] ** 2, rows[2] ** 2
    strengths = (first - second) / np.maximum(first + second, _TINY)
    domains = np.sign(strengths[np.abs(strengths) > domain])
    ends = (int(domains[0]), int(domains[-1])) if len(domains) else (0, 0)
    logarithms = np.zeros(len(first) + 1)
    np.log(np.maximum(first, _TINY) / np.maximum(second, _TINY)).cumsum(out=logarithms[1:])
    logarithms -= logarithms.max()
    squares = np.exp(np.maximum(logarithms, _LEAST_LOGARITHM))
    centre = float(np.arange(len(squares)) @ squares) / float(squares.sum())
    return float(strengths[:before].sum()), float(strengths[beyond:].sum()), *ends, centre


def contraction_sums(
    angles: Array,
    table: Array,
    offsets: Array,
    begin: int,
    end: int,
    centre: float,
    gamma: float,
    step: float,
    half: float,
) -> tuple[float, float, float, float, float]:
    """Sums of f'^2, f' g, g^2, f' x and g x over rotors that are known, g = u f'; see `step`.

    The table has f, f' and f'' in steps [rotor spacings] up to a half on either side of 0,
    which is at the offset of each rotor, shape (N,); x is what f leaves of an angle [rad].
    """
    rotors = np.arange(begin, end)[np.isfinite(angles[begin:end])]
    distances = np.clip(gamma * (centre - rotors), -half * step, half * step)
    steps = distances * (1 / step)
    nearest = np.rint(steps)
    beyond = (steps - nearest) * step
    values, slopes, curvatures = table[:, (nearest + offsets[rotors]).astype(np.intp)]
    bent = beyond * curvatures
    left = wrapped(angles[rotors] - (values + beyond * (slopes + 0.5 * bent)))
    slopes = slopes + bent
    by_log = distances * slopes
    return (
        float(slopes @ slopes),
        float(slopes @ by_log),
        float(by_log @ by_log),
        float(slopes @ left),
        float(by_log @ left),
    )


def _joint(lefts: Array, rights: Array, periodic: bool) -> float:
    """Sum over the rotors between two springs of a number of each."""
    inner = float(lefts[:-1] @ rights[1:])
    return inner + float(lefts[-1] * rights[0]) if periodic else inner


def _wake(energies: Array, place: float, walls: Array, reach: float) -> float:
    """Sum over rotors or springs out of reach of all walls; the first is at a place."""
    wake, count = 0.0, len(energies)
    for wall, following in pairwise(walls.tolist()):
        low, high = wall + reach - place, following - reach - place
        begin = math.floor(low) + 1 if low >= 0 else 0
        end = math.ceil(high) if high < count else count
        wake += float(energies[begin:end].sum()) if begin < end else 0.0
    return wake
