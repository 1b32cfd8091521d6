# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over springs and rotors that compute energies and topology of a state.

A spring table, shape (3, springs), contains the extensions [m] and their derivatives [m/rad] with
respect to the angles of the left rotor (lever A) and of the right rotor (lever B).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    b1,
    compile_loop,
    compiled,
    const_f8_1d,
    const_f8_2d,
    f8,
    f8_2d,
    i8,
    records,
)
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import TINY, spring_between

Records = NDArray[np.void]
Energy = tuple[float, float, float]
"""Energy of a state, its part in the wake, and the standard deviation of the energy [J each]."""
Shape = tuple[float, float, float, float]
"""The two results of `of_angles` [1], the first lever A and the last lever B [m/rad]."""
Sides = tuple[float, float, int, int, float]

spring = compile_loop(spring_between, inlined=True)


@compiled(const_f8_1d, const_f8_1d, const_f8_2d, i8, i8, f8_2d)
def _set_spring(
    sines: Array, cosines: Array, parameters: Array, n: int, following: int, rows: Array
) -> None:
    left, right = parameters[0, n], parameters[0, following]
    rows[0, n], rows[1, n], rows[2, n] = spring(
        left * sines[n],
        left * cosines[n],
        right * sines[following],
        right * cosines[following],
        parameters[1, n],
        parameters[2, n],
        parameters[3, n],
    )


@compiled(const_f8_1d, const_f8_2d, b1, f8_2d)
def of_angles(
    angles: Array, parameters: Array, periodic: bool, rows: Array
) -> tuple[float, float]:
    """Set the spring table `rows` for angles [rad], shape (N,), and return two sums.

    The sign of the first sum is the orientation of a spinner. The sum has the terms sin(theta_n +
    theta_{n+1}) = (-1)^n sin(phi_{n+1} - phi_n) of all bonds, with the staggered angles theta. The
    sign of the second sum is the orientation of a flipper. This sum has the terms cos(theta_n) of
    all inner rotors. `parameters` are `Chain.spring_parameters`.
    """
    rotors = angles.size
    sines, cosines = np.empty(rotors), np.empty(rotors)
    for n in range(rotors):
        sines[n], cosines[n] = math.sin(angles[n]), math.cos(angles[n])
    for n in range(rotors - 1):
        _set_spring(sines, cosines, parameters, n, n + 1, rows)
    if periodic:
        _set_spring(sines, cosines, parameters, rotors - 1, 0, rows)
    twists, upright, sign = 0.0, 0.0, 1.0
    for n in range(rotors - 1):
        twists += sign * (sines[n + 1] * cosines[n] - cosines[n + 1] * sines[n])
        upright += sign * cosines[n] if n else 0.0
        sign = -sign
    return twists, upright


@compiled(const_f8_1d, f8, const_f8_1d, f8)
def _wake(energies: Array, site: float, walls: Array, reach: float) -> float:
    wake, count = 0.0, energies.size
    for n in range(walls.size - 1):
        low, high = walls[n] + reach - site, walls[n + 1] - reach - site
        begin = math.floor(low) + 1 if low >= 0 else 0
        end = math.ceil(high) if high < count else count
        for m in range(begin, end):
            wake += energies[m]
    return wake


@compiled(const_f8_2d, const_f8_1d, const_f8_1d, const_f8_1d, b1, f8, const_f8_1d, f8)
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
    """Return the elastic energy, its part in the wake, and its standard deviation [J each].

    `half` are half the stiffnesses [N/m]. `lefts` (`rights`) equal `half`, but are 0 for springs
    whose left (right) rotor has no noise. The wake consists of all springs farther than `reach`
    [rotor spacings] from all walls; spring n is at site n + 1/2. `walls`, shape (W + 2,), are the
    sites of W walls in ascending order, with one additional value at each end. These values are
    -inf and inf in an open chain. On a ring of N rotors, they are the last site minus N and the
    first site plus N.

    The mean energy that noise adds is subtracted. If the noise of the angles has the standard
    deviation sigma, the variance of the energy is sigma^2 |tau|^2 + sigma^4 |H|^2 / 2. Here tau
    are the torques, H = R^T k_e R is the stiffness matrix, R is the rigidity matrix, and k_e are
    the stiffnesses.
    """
    whole, squares, pulling, variance = 0.0, 0.0, 0.0, noise**2
    count = half.size
    energies = np.empty(count)
    for n in range(count):
        extension, first, second = rows[0, n], rows[1, n], rows[2, n]
        levers = lefts[n] * first * first + rights[n] * second * second
        stretched = half[n] * extension * extension
        energies[n] = stretched - variance * levers
        whole += energies[n]
        squares += levers * levers
        pulling += stretched * levers
        if n + 1 < count or periodic:
            after = n + 1 if n + 1 < count else 0
            by_next = lefts[after] * rows[1, after]
            squares += 2 * rights[n] * second * second * by_next * rows[1, after]
            pulling += 2 * half[n] * extension * second * by_next * rows[0, after]
    excess = max(pulling - variance * squares, 0.0)
    deviation = 2 * math.sqrt(variance * (excess + variance * squares / 2))
    return whole, _wake(energies, 0.5, walls, reach), deviation


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, f8, const_f8_1d, f8)
def kinetic(
    half: Array, noisy: Array, rates: Array, noise: float, walls: Array, reach: float
) -> Energy:
    """Return the kinetic energy, its part in the wake, and its standard deviation [J each].

    `half` are half the moments of inertia [kg m^2]. `noisy` equal `half`, but are 0 for rates
    without noise. `walls` and `reach` are as in `elastic`. The mean energy that noise adds is
    subtracted. If the noise of the rates has the standard deviation sigma, a rotor with the moment
    of inertia I and the rate omega adds I^2 sigma^2 (omega^2 + sigma^2 / 2) to the variance of the
    energy.
    """
    whole, known, squares, variance = 0.0, 0.0, 0.0, noise**2
    energies = np.empty(half.size)
    for n in range(half.size):
        energy = half[n] * (rates[n] * rates[n]) - variance * noisy[n]
        energies[n] = energy
        whole += energy
        known += energy * noisy[n]
        squares += noisy[n] * noisy[n]
    spread = 4 * variance * max(known, 0.0) + 2 * variance**2 * squares
    return whole, _wake(energies, 0.0, walls, reach), math.sqrt(spread)


@compiled(const_f8_2d, i8, i8, f8)
def topology(rows: Array, before: int, beyond: int, domain: float) -> Sides:
    """Return two sums of polarisations, two edge signs, and the centre of the zero mode.

    The polarisation of a bond with the levers A and B is (A^2 - B^2) / (A^2 + B^2). The first sum
    is over the first `before` bonds, and the second sum over the bonds from `beyond` on. The edge
    signs are the signs of the first and of the last polarisation whose absolute value exceeds
    `domain`, or 0 if there is none. The centre [rotor spacings] is the centroid of the squared
    zero mode t_n^2. It is computed from logarithms, because t_n^2 may overflow.
    """
    left, right, first, last = 0.0, 0.0, 0, 0
    logarithms, largest = np.zeros(rows.shape[1] + 1), 0.0
    for n in range(rows.shape[1]):
        a, b = rows[1, n] * rows[1, n], rows[2, n] * rows[2, n]
        strength = (a - b) / max(a + b, TINY)
        left += strength if n < before else 0.0
        right += strength if n >= beyond else 0.0
        if abs(strength) > domain:
            last = 1 if strength > 0 else -1
            first = first if first else last
        logarithms[n + 1] = logarithms[n] + math.log(max(a, TINY) / max(b, TINY))
        largest = max(largest, logarithms[n + 1])
    squares, moments = 0.0, 0.0
    for n in range(logarithms.size):
        square = math.exp(logarithms[n] - largest)
        squares += square
        moments += n * square
    return left, right, first, last, moments / squares


SCOPE = np.dtype(
    [(name, np.float64) for name in ('noise', 'rate_noise', 'reach', 'before', 'beyond', 'domain')]
)
"""Record of the noise of a state, and of the bonds beside the walls.

noise: standard deviation of the angles [rad].
rate_noise: standard deviation of the rates [rad/s].
reach: distance from a wall beyond which energy belongs to the wake [rotor spacings].
before: number of bonds before the first wall [1].
beyond: index of the first bond beyond the last wall [1].
domain: absolute polarisation above which a bond is in a domain [1].
"""
_SCOPE = records(SCOPE)


@compiled(const_f8_1d, const_f8_2d, b1, const_f8_2d, const_f8_2d, const_f8_1d, _SCOPE)
def report(
    angles: Array,
    parameters: Array,
    periodic: bool,
    springs: Array,
    rotors: Array,
    walls: Array,
    scope: Records,
) -> tuple[Shape, Sides, Energy, Energy]:
    """Return orientation and edge levers, and the results of `topology`, `elastic` and `kinetic`.

    `springs` has the rows `half`, `lefts` and `rights` of `elastic`, and `rotors` has the rows
    `half`, `noisy` and `rates` of `kinetic`.
    """
    half = springs[0]
    rows = np.empty((3, half.size))
    twists, upright = of_angles(angles, parameters, periodic, rows)
    given = scope[0]
    noise, reach = given['noise'], given['reach']
    before, beyond = int(given['before']), int(given['beyond'])
    return (
        (twists, upright, rows[1, 0], rows[2, half.size - 1]),
        topology(rows, before, beyond, given['domain']),
        elastic(rows, half, springs[1], springs[2], periodic, noise, walls, reach),
        kinetic(rotors[0], rotors[1], rotors[2], given['rate_noise'], walls, reach),
    )
