# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over rotors: turning them, and what turns them.

Every rotor is carried as its angle, cosine and sine, and turned by the small angle of a drift
with polynomials, so that no loop calls a function and all are vectorised. Arrays are padded from
N to P places, whole vectors, with rotors that do not move.

Chains whose springs are all alike and on which nothing else acts go through one loop, which does
all that a rotor needs; for others there is a loop for each term. They index one array, `work`,
rather than take rows of it, because every array made in a stage counts its references, which
takes longer than twenty rotors do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    FASTMATH_FLAGS,
    Kernel,
    compile_loop,
    prefer_wide_vectors,
    unsigned,
)
from soliton_linkage.linkage.chain import Array

Numbers = NDArray[np.int64]

VECTOR = 8
"""Largest number of values that a processor takes at once; rows of arrays are multiples of it."""

ANGLES, RATES, COSINES, SINES, ON_LEFT, ON_RIGHT, TURNS, KEPT = range(8)
"""Rows of work, shape (11, P + VECTOR); the last four are to come back to.

Of the angular accelerations by springs, spring n has that of rotor n at place n of ON_LEFT, and
that of rotor n+1 at place n+1 of ON_RIGHT.
"""

WORK_ROWS = KEPT + 4
"""Of angles, rates, cosines and sines, which `copy` copies."""

ROTORS_IN_CACHE = 1024
"""Of which 32 kB, what caches hold, are carried from stage to stage."""

LARGEST_TURN = 0.5
"""Of a rotor at once [rad], up to which the series of `turned` are exact to rounding."""

ONE = unsigned(1)
"""Numbers that could be below 0 would count from the end, and no loop over them is vectorised."""


PlainForces = tuple[tuple[float, float, float, float, float], Array, Array, bool]
"""The fields of `Forces`; from Python a plain tuple is handed over in a third of the time."""


class Spring(NamedTuple):
    """Coefficients of springs that are all alike; see `pull_and_cross`."""

    offset: float
    """c / lbar^2 + 1, where c is one of `Chain.offsets`."""
    slope: float
    """2 a r / lbar^2."""
    product: float
    """2 r^2 / lbar^2."""
    lever: float
    """k a r / I."""
    cross: float
    """k r^2 / I."""


class Forces(NamedTuple):
    """Accelerations by springs, by torques and by gravity."""

    spring: Spring
    springs: Array
    """Rows of `pull`, shape (8, P); (8, 0) where `spring` is all that acts."""
    field: Array
    """Rows of `add_field`, shape (3, P), or (3, 0) where there is none."""
    periodic: bool


class Span(NamedTuple):
    """Rotors from one to before another."""

    start: int
    end: int
    number: int
    """Of rotors in the chain, the last of which has no spring to a next one."""


class Before(NamedTuple):
    """What the spring before a rotor does to it; see `pull_and_cross`."""

    pull: float
    cross: float


class Checks(NamedTuple):
    """Which steps have their error measured, and in what units.

    These are absolute + relative abs(state), and errors the root mean square over the state, the
    norm of scipy's solvers.
    """

    absolute: Array
    """Shape (len(state),)."""
    relative: float
    measured: Numbers
    """Numbers of the steps, of which the next one is 1."""


PlainChecks = tuple[Array, float, Numbers]
"""The fields of `Checks`."""


def inlined(function: Kernel) -> Kernel:
    """Compile a loop into the functions that call it."""
    return compile_loop(function, inlined=True)


def estimating(function: Kernel) -> Kernel:
    """Compile as `inlined` does, but roots and inverses may be estimated."""
    return compile_loop(function, freedoms=FASTMATH_FLAGS | {'arcp', 'afn'}, inlined=True)


@inlined
def named(forces: PlainForces) -> Forces:
    """Forces that Python has handed over."""
    spring, springs, field, periodic = forces
    return Forces(Spring(*spring), springs, field, periodic)


@inlined
def faster(work: Array, number: int, limit: float) -> int:
    """Number of rotors whose rate is not below a limit, or no number at all."""
    found = 0
    for n in range(number):
        found += not abs(work[RATES, n]) <= limit
    return found


@inlined
def turned(c: float, s: float, x: float) -> tuple[float, float]:
    """(c cos x - s sin x, s cos x + c sin x).

    The series of sin x and cos x - 1 go on until LARGEST_TURN allows nothing more.
    """
    z = x * x
    y = z * z
    odd = (-1 / 5040 + z * (1 / 362880)) + y * (-1 / 39916800 + z * (1 / 6227020800))
    odd = (-1 / 6 + z * (1 / 120)) + y * odd
    even = (-1 / 720 + z * (1 / 40320)) + y * (-1 / 3628800 + z * (1 / 479001600))
    even = z * ((-1 / 2 + z * (1 / 24)) + y * even)
    sine = x + x * z * odd
    return c + (c * even - s * sine), s + (s * even + c * sine)


@estimating
def inverse_root_estimate(w: float) -> float:
    """1 / sqrt(w) to single precision: an instruction of the processor and a step of Newton's."""
    return float(np.float32(1) / np.sqrt(np.float32(w)))


@inlined
def tension(w: float) -> float:
    """1 - 1 / sqrt(w), of a spring of length lbar sqrt(w) the force over k l.

    With an estimate y of the root's inverse and d = 1 - w y^2, 1 / sqrt(w) is
    y (1 + d / 2 + 3 d^2 / 8 + ...), of which nothing more is left in double precision. There is
    neither a division nor a root, which take the processor as long as all else in a stage does.
    """
    y = inverse_root_estimate(w)
    d = 1 - w * y * y
    return (1 - y) - y * d * (0.5 + 0.375 * d)


@inlined
def pull_and_cross(
    c: float, s: float, c_next: float, s_next: float, spring: Spring
) -> tuple[float, float]:
    """The f and q of a spring from a rotor (c, s) to the next (c', s') where all are alike.

    x = l^2 / lbar^2 = offset + slope (s' - s) - product (s s' + c c'),
    f = lever (1 - 1 / sqrt(x)),
    q = cross (1 - 1 / sqrt(x)) (s c' - c s'),
    acceleration = (f - f of the spring before) c - (q - q of the spring before).
    """
    squares = spring.product * (s * s_next + c * c_next)
    pull = tension(spring.offset + spring.slope * (s_next - s) - squares)
    return spring.lever * pull, spring.cross * pull * (s * c_next - c * s_next)


@inlined
def pull(work: Array, places: int, rows: Array) -> None:
    """Pull of springs that each have their own parameters, the rows, shape (8, P).

    These are offset, slope', slope, product, lever, cross, cross', lever' of `pull_and_cross`, in
    which each place of a length or inertia takes that of its own rotor:

    x = offset + slope' s' - slope s - product (s s' + c c'),
    pull on the left  = (1 - 1 / sqrt(x)) [lever c - cross (s c' - c s')],
    pull on the right = (1 - 1 / sqrt(x)) [cross' (s c' - c s') - lever' c'].
    """
    prefer_wide_vectors()
    for n in range(places):
        c, c_next = work[COSINES, n], work[COSINES, n + 1]
        s, s_next = work[SINES, n], work[SINES, n + 1]
        x = rows[0, n] + (rows[1, n] * s_next - rows[2, n] * s)
        e = tension(x - rows[3, n] * (s * s_next + c * c_next))
        torque = s * c_next - c * s_next
        work[ON_LEFT, n] = e * (rows[4, n] * c - rows[5, n] * torque)
        work[ON_RIGHT, n + 1] = e * (rows[6, n] * torque - rows[7, n] * c_next)


@inlined
def add_field(work: Array, field: Array) -> None:
    """Add accelerations load + by_sine sin(phi) + by_cosine cos(phi), the rows of the field."""
    for n in range(field.shape[1]):
        varying = field[1, n] * work[SINES, n] + field[2, n] * work[COSINES, n]
        work[ON_LEFT, n] += field[0, n] + varying


@inlined
def pull_all(work: Array, number: int, forces: Forces) -> None:
    """Put the accelerations by springs that each have their own parameters, and a field."""
    if forces.periodic:
        work[COSINES, number], work[SINES, number] = work[COSINES, 0], work[SINES, 0]
    pull(work, forces.springs.shape[1], forces.springs)
    if forces.periodic:
        work[ON_RIGHT, 0] = work[ON_RIGHT, number]
    else:
        work[ON_LEFT, number - 1] = 0.0
    add_field(work, forces.field)


@inlined
def copy(work: Array, start: int, end: int) -> None:
    """Copy angles, rates, cosines and sines from four rows to four others."""
    for row in range(4):
        for n in range(work.shape[1]):
            work[end + row, n] = work[start + row, n]


@inlined
def difference(
    before: Array, whole: Array, halves: Array, absolute: Array, relative: float
) -> float:
    """Root mean square of the difference of two states in units of what is tolerated."""
    squares = 0.0
    for n in range(whole.size):
        tolerated = absolute[n] + relative * max(abs(before[n]), abs(halves[n]))
        squares += ((whole[n] - halves[n]) / tolerated) ** 2
    return math.sqrt(squares / whole.size)
