# SPDX-License-Identifier: Apache-2.0
"""Naive twins, in numpy, of the loops over a frame and a state: same arguments."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from soliton_linkage.estimation.loops.frame_loops import LARGEST_ANGLE
from soliton_linkage.estimation.loops.state_loops import Energy, Shape, Sides
from soliton_linkage.linkage.chain import Array, springs_between, wrapped

LEAST_LOGARITHM = -600.0
TINY = float(np.finfo(np.float64).tiny)


def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
    readable = np.isfinite(angles) & (np.abs(angles) < LARGEST_ANGLE)
    read = np.where(readable, angles, np.nan)
    jumps = np.rint((read - last) / (2 * math.pi))
    turns -= np.where(np.isfinite(jumps), jumps, 0.0)
    last[readable] = read[readable]
    seen[:] = read + 2 * math.pi * turns


def all_within(values: Array, limit: float) -> bool:
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
    end = first + len(about)
    expected = np.concatenate([before[:first], about, beyond[end:]])
    read = angles - corrections
    differences[:] = wrapped((math.pi - read if upside_down else read) - expected)


def median_change(first: Array, second: Array, third: Array) -> float:
    differences = np.abs(first - 2 * second + third)
    known = differences[np.isfinite(differences)]
    return float(np.median(known)) if len(known) else math.nan


def products_in_time(
    oldest: Array, older: Array, left: Array, tangent: Array, first: int
) -> tuple[float, float, float, float]:
    about = slice(first, first + len(tangent))
    products = left[about] * (older[about] * (4 / 3) - oldest[about] / 3)
    share = tangent**2
    free = share - share**2
    return float(products.sum()), float(share @ products), float(free.sum()), float(free @ free)


def of_angles(
    angles: Array, parameters: Array, periodic: bool, rows: Array
) -> tuple[float, float]:
    sines, cosines = np.sin(angles), np.cos(angles)
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
    noise: float,
    walls: Array,
    reach: float,
) -> Energy:
    variance = noise**2
    extensions, firsts, seconds = rows[0], lefts * rows[1] ** 2, rights * rows[2] ** 2
    levers, pulls = firsts + seconds, half * extensions
    stretched = pulls * extensions
    energies = stretched - variance * levers
    squares = float(levers @ levers) + 2 * joint(seconds, firsts, periodic)
    of_next = lefts * extensions * rows[1]
    pulling = float(stretched @ levers) + 2 * joint(pulls * rows[2], of_next, periodic)
    spread = 4 * variance * max(pulling - variance * squares, 0.0) + 2 * variance**2 * squares
    return float(energies.sum()), wake_of(energies, 0.5, walls, reach), math.sqrt(spread)


def kinetic(
    half: Array, noisy: Array, rates: Array, noise: float, walls: Array, reach: float
) -> Energy:
    energies = half * (rates * rates) - noise**2 * noisy
    wake = wake_of(energies, 0.0, walls, reach)
    known, squares = max(float(energies @ noisy), 0.0), float(noisy @ noisy)
    return float(energies.sum()), wake, noise * math.sqrt(4 * known + 2 * noise**2 * squares)


def topology(rows: Array, before: int, beyond: int, domain: float) -> Sides:
    first, second = rows[1] ** 2, rows[2] ** 2
    strengths = (first - second) / np.maximum(first + second, TINY)
    domains = np.sign(strengths[np.abs(strengths) > domain])
    ends = (int(domains[0]), int(domains[-1])) if len(domains) else (0, 0)
    logarithms = np.zeros(len(first) + 1)
    np.log(np.maximum(first, TINY) / np.maximum(second, TINY)).cumsum(out=logarithms[1:])
    logarithms -= logarithms.max()
    squares = np.exp(np.maximum(logarithms, LEAST_LOGARITHM))
    centre = float(np.arange(len(squares)) @ squares) / float(squares.sum())
    return float(strengths[:before].sum()), float(strengths[beyond:].sum()), *ends, centre


def report(
    angles: Array,
    parameters: Array,
    periodic: bool,
    half: Array,
    lefts: Array,
    rights: Array,
    noise: float,
    inertias: Array,
    noisy: Array,
    rates: Array,
    rate_noise: float,
    walls: Array,
    reach: float,
    before: int,
    beyond: int,
    domain: float,
) -> tuple[Shape, Sides, Energy, Energy]:
    rows = np.empty((3, len(half)))
    stands = of_angles(angles, parameters, periodic, rows)
    return (
        (*stands, float(rows[1, 0]), float(rows[2, -1])),
        topology(rows, before, beyond, domain),
        elastic(rows, half, lefts, rights, periodic, noise, walls, reach),
        kinetic(inertias, noisy, rates, rate_noise, walls, reach),
    )


def joint(lefts: Array, rights: Array, periodic: bool) -> float:
    inner = float(lefts[:-1] @ rights[1:])
    return inner + float(lefts[-1] * rights[0]) if periodic else inner


def wake_of(energies: Array, place: float, walls: Array, reach: float) -> float:
    wake, count = 0.0, len(energies)
    for wall, following in pairwise(walls.tolist()):
        low, high = wall + reach - place, following - reach - place
        begin = math.floor(low) + 1 if low >= 0 else 0
        end = math.ceil(high) if high < count else count
        wake += float(energies[begin:end].sum()) if begin < end else 0.0
    return wake
