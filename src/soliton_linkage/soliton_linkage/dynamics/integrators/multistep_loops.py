# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of `multistep_steps`, which says what they compute.

Kicks, turns and memory are rings of rows: instant n has row n & (rows - 1).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soliton_linkage.compiling import (
    FREEDOMS,
    Kernel,
    arrays_do_not_overlap,
    compile_loop,
    take_widest_vectors,
    unsigned,
)
from soliton_linkage.dynamics.integrators.forces import Forces, Numbers, PlainForces, Spring
from soliton_linkage.dynamics.integrators.multistep_coefficients import (
    AHEAD,
    DIFFERENCE,
    ERROR,
    MEMORY,
    OF_KICKS,
    OF_TURNS,
    RECALLING,
    RECURSION,
    RESPONSE,
    STARTING_STEPS,
)
from soliton_linkage.dynamics.integrators.nystrom_loops import (
    HALF,
    WHOLE,
    PlainStep,
    Step,
    take_step,
)
from soliton_linkage.dynamics.integrators.rotor_loops import (
    ANGLES,
    COSINES,
    KEPT,
    LARGEST_TURN,
    ON_LEFT,
    ON_RIGHT,
    ONE,
    RATES,
    ROTORS_IN_CACHE,
    SINES,
    Before,
    Checks,
    PlainChecks,
    Span,
    copy,
    difference,
    faster,
    inlined,
    named,
    pull_all,
    pull_and_cross,
    turned,
)
from soliton_linkage.linkage.chain import Array

Q1, Q2, Q3, Q4 = (float(q) for q in RECURSION[1:5])
B0, B1, B2, B3, B4 = (float(b) for b in RESPONSE[:5])
D0, D1, D2, D3, D4, D5 = (ERROR * float(d) for d in DIFFERENCE[:6])
WRAP = MEMORY - 1
"""Row n & WRAP of the memory has w_n."""


class Rings(NamedTuple):
    """What steps have left behind."""

    kicks: Array
    """Of some last instants, times the square of the step [rad], shape (rows, P)."""
    turns: Array
    """From these instants to the next [rad], shape (rows, P)."""
    memory: Array
    """The w of the last ones [rad], shape (16, P)."""


PlainRings = tuple[Array, Array, Array]
"""The fields of `Rings`."""


def summing(function: Kernel) -> Kernel:
    """Compile as `inlined` does, but sums may be taken in any order."""
    return compile_loop(function, freedoms=FREEDOMS | {'reassoc'}, inlined=True)


@inlined
def pull_even(
    work: Array, span: Span, spring: Spring, before: Before, kicks: Array, row: int
) -> Before:
    """Kicks of springs that are all alike, as `nystrom_loops.kick_and_turn` has them."""
    take_widest_vectors()
    arrays_do_not_overlap()
    last = unsigned(span.number - 1)
    f_before, q_before = before
    for n in range(unsigned(span.start), unsigned(span.end)):
        c, c_next = work[COSINES, n], work[COSINES, n + ONE]
        s, s_next = work[SINES, n], work[SINES, n + ONE]
        f, q = pull_and_cross(c, s, c_next, s_next, spring)
        f, q = (f, q) if n < last else (0.0, 0.0)
        kicks[row, n] = (f - f_before) * c - (q - q_before)
        f_before, q_before = f, q
    return Before(f_before, q_before)


@inlined
def pull_each(
    work: Array, number: int, forces: Forces, square: float, kicks: Array, row: int
) -> None:
    """Kicks of springs that each have their own parameters, and of a field."""
    pull_all(work, number, forces)
    for n in range(number):
        kicks[row, n] = square * (work[ON_LEFT, n] + work[ON_RIGHT, n])


@inlined
def scaled(spring: Spring, square: float) -> Spring:
    """Coefficients of springs whose accelerations are to be kicks."""
    lever, cross = square * spring.lever, square * spring.cross
    return Spring(spring.offset, spring.slope, spring.product, lever, cross)


@inlined
def turn(work: Array, rings: Rings, remembered: Array, instant: int, start: int, end: int) -> int:
    """Turn rotors as the kicks up to an instant ask for; return how many turn too far.

    Memory and what is remembered are one array, of which other rows are written than are read.
    """
    take_widest_vectors()
    arrays_do_not_overlap()
    kicks, turns, memory = rings
    wrap = kicks.shape[0] - 1
    now, before = instant & wrap, (instant - 1) & wrap
    w0, w1, w2 = instant & WRAP, (instant - 1) & WRAP, (instant - 2) & WRAP
    w3, w4, w5 = (instant - 3) & WRAP, (instant - 4) & WRAP, (instant - 5) & WRAP
    w6, w7, w8 = (instant - 6) & WRAP, (instant - 7) & WRAP, (instant - 8) & WRAP
    too_far = 0
    for n in range(unsigned(start), unsigned(end)):
        first = remembered[w1, n] + remembered[w7, n]
        second = remembered[w2, n] + remembered[w6, n]
        third, fourth = remembered[w3, n] + remembered[w5, n], remembered[w4, n]
        newest = (kicks[now, n] - remembered[w8, n]) - Q1 * first - Q2 * second - Q3 * third
        newest -= Q4 * fourth
        response = B0 * (newest + remembered[w8, n]) + B1 * first + B2 * second + B3 * third
        x = turns[before, n] + (response + B4 * fourth)
        memory[w0, n] = newest
        turns[now, n] = x
        too_far += not abs(x) <= LARGEST_TURN
        work[ANGLES, n] += x
        work[COSINES, n], work[SINES, n] = turned(work[COSINES, n], work[SINES, n], x)
    return too_far


@inlined
def take_even_steps(
    work: Array, number: int, spring: Spring, rings: Rings, last: int, count: int
) -> int:
    """Take steps between springs that are all alike; return how many turn no rotor too far.

    So that rotors stay in the cache, some are taken through all steps before the next: each step
    takes one rotor less than that before it, whose kicks it needs.
    """
    kicks, turns, memory = rings
    places, wrap = kicks.shape[1], kicks.shape[0] - 1
    before, too_far = np.zeros((count, 2)), 0
    for block in range(0, places, ROTORS_IN_CACHE):
        end = block + ROTORS_IN_CACHE
        for step in range(count):
            start, stop = (block - step if block else 0), (end - step if end < places else places)
            turning = start + min(block, 1), min(stop + 1, places)
            too_far += turn(work, rings, memory, last + step, *turning)
            before[step] = pull_even(
                work,
                Span(start, stop, number),
                spring,
                Before(before[step, 0], before[step, 1]),
                kicks,
                (last + step + 1) & wrap,
            )
    return leave_before(work, turns, last, count) if too_far else count


@inlined
def leave_before(work: Array, turns: Array, last: int, count: int) -> int:
    """Turn the rotors from KEPT on until one would turn too far; return how many times."""
    number, wrap = turns.shape[1], turns.shape[0] - 1
    for n in range(number):
        work[ANGLES, n] = work[KEPT, n]
    for step in range(count):
        row = (last + step) & wrap
        for n in range(number):
            if not abs(turns[row, n]) <= LARGEST_TURN:
                return step
        for n in range(number):
            work[ANGLES, n] += turns[row, n]
    return count


@inlined
def take_uneven_steps(
    work: Array, number: int, forces: Forces, square: float, rings: Rings, last: int, count: int
) -> int:
    """Take steps between springs that each have their own parameters, as `take_even_steps`."""
    kicks, turns, memory = rings
    places, wrap = kicks.shape[1], kicks.shape[0] - 1
    for step in range(count):
        if turn(work, rings, memory, last + step, 0, places):
            return leave_before(work, turns, last, step + 1)
        pull_each(work, number, forces, square, kicks, (last + step + 1) & wrap)
    return count


@inlined
def put_state(angles: Array, rings: Rings, instant: int, step: float, state: Array) -> None:
    """Write down the angles, once they are smooth, and the rates of an instant."""
    kicks, turns, _ = rings
    wrap, number = kicks.shape[0] - 1, state.size // 2
    for start in range(0, number, ROTORS_IN_CACHE):
        rotors = unsigned(start), unsigned(min(start + ROTORS_IN_CACHE, number))
        for n in range(*rotors):
            state[n] = angles[n]
            state[unsigned(number) + n] = 0.0
        for part in range(2):
            scale, first = (1.0, 1 / step)[part], unsigned(part * number)
            for j in range(2 * AHEAD):
                row, weight = (instant + j - AHEAD) & wrap, scale * OF_TURNS[part, j]
                for n in range(*rotors):
                    state[first + n] += weight * turns[row, n]
            for j in range(2 * AHEAD + 1):
                row, weight = (instant + j - AHEAD) & wrap, scale * OF_KICKS[part, j]
                for n in range(*rotors):
                    state[first + n] += weight * kicks[row, n]


@inlined
def turn_back(angles: Array, turns: Array, row: int) -> None:
    """Undo the turns of a row."""
    for n in range(angles.size):
        angles[n] -= turns[row, n]


@compile_loop
def tell(
    work: Array, plain_rings: PlainRings, told: int, last: int, step: float, states: Array
) -> None:
    """Write down the states of instants up to that which is told; angles are of the last one."""
    rings = Rings(*plain_rings)
    turns = rings.turns
    angles = work[ANGLES, : states.shape[1] // 2].copy()
    for instant in range(last - 1, told - len(states), -1):
        turn_back(angles, turns, instant & (turns.shape[0] - 1))
        row = len(states) - 1 + instant - told
        if row < len(states):
            put_state(angles, rings, instant, step, states[row])


@compile_loop
def interpolate(
    knots: Array, kicks: Array, found: Numbers, weights: tuple[Array, Array], output: Array
) -> None:
    """Fill output with the states in steps that were found, by the weights of `interpolating`.

    Knots are states with h times the rates; kicks are those of the same instants and of five
    more on each side.
    """
    for frame in range(found.size):
        ends = knots[found[frame] : found[frame] + 2]
        around = kicks[found[frame] + 1 : found[frame] + 1 + 2 * AHEAD]
        for part in range(2):
            combine(ends, around, weights[part][frame], output[frame], part)


@inlined
def combine(ends: Array, kicks: Array, weights: Array, output: Array, part: int) -> None:
    """Weighted sum of angles, and of rates, at both ends, and of ten rows of kicks."""
    take_widest_vectors()
    number = kicks.shape[1]
    a0, a1, r0, r1 = weights[0], weights[1], weights[2], weights[3]
    k0, k1, k2, k3, k4 = weights[4], weights[5], weights[6], weights[7], weights[8]
    k5, k6, k7, k8, k9 = weights[9], weights[10], weights[11], weights[12], weights[13]
    for n in range(number):
        cubic = a0 * ends[0, n] + a1 * ends[1, n]
        cubic += r0 * ends[0, number + n] + r1 * ends[1, number + n]
        early = k0 * kicks[0, n] + k1 * kicks[1, n] + k2 * kicks[2, n] + k3 * kicks[3, n]
        late = k6 * kicks[6, n] + k7 * kicks[7, n] + k8 * kicks[8, n] + k9 * kicks[9, n]
        between = k4 * kicks[4, n] + k5 * kicks[5, n]
        output[part * number + n] = cubic + (early + between + late)


@summing
def error(work: Array, rings: Rings, instant: int, step: float, checks: Checks) -> float:
    """Root mean square of what the step to an instant missed in units of what is tolerated."""
    kicks, turns, _ = rings
    absolute, relative, _ = checks
    wrap = kicks.shape[0] - 1
    before, k0, k1 = (instant - 1) & wrap, instant & wrap, (instant - 1) & wrap
    k2, k3, k4 = (instant - 2) & wrap, (instant - 3) & wrap, (instant - 4) & wrap
    k5, k6, k7 = (instant - 5) & wrap, (instant - 6) & wrap, (instant - 7) & wrap
    k8, k9, k10 = (instant - 8) & wrap, (instant - 9) & wrap, (instant - 10) & wrap
    number, squares = absolute.size // 2, 0.0
    for n in range(number):
        missed = D0 * (kicks[k0, n] + kicks[k10, n]) + D1 * (kicks[k1, n] + kicks[k9, n])
        missed += D2 * (kicks[k2, n] + kicks[k8, n]) + D3 * (kicks[k3, n] + kicks[k7, n])
        missed += D4 * (kicks[k4, n] + kicks[k6, n]) + D5 * kicks[k5, n]
        of_angle = absolute[n] + relative * abs(work[ANGLES, n])
        of_turn = abs(step) * absolute[number + n] + relative * abs(turns[before, n])
        ratio = missed / (of_angle * of_turn)  # divisions take most of the time here
        squares += (ratio * of_turn) ** 2 + (ratio * of_angle) ** 2
    return math.sqrt(squares / (2 * number))


@compile_loop
def begin(
    work: Array,
    plain_forces: PlainForces,
    plain_step: PlainStep,
    length: float,
    plain_rings: PlainRings,
    plain_checks: PlainChecks,
    states: Array,
) -> tuple[int, float]:
    """Take steps of `nystrom_loops` until the rings are filled; return how many, and the error.

    States are those of instants 0 to 9; it stops before a step that turns a rotor too far. The
    error is measured in the last step, against two halves.
    """
    forces, step, rings = named(plain_forces), Step(*plain_step), Rings(*plain_rings)
    checks = Checks(*plain_checks)
    kicks, turns, _ = rings
    number, even, error = states.shape[1] // 2, scaled(forces.spring, length * length), 0.0
    every_rotor = Span(0, kicks.shape[1], number)
    halves = np.empty(2 * number)
    for n in range(number):
        states[0, n], states[0, number + n] = work[ANGLES, n], work[RATES, n]
    for instant in range(STARTING_STEPS + 1):
        if forces.springs.size:
            pull_each(work, number, forces, length * length, kicks, instant)
        else:
            pull_even(work, every_rotor, even, Before(0.0, 0.0), kicks, instant)
        if instant == STARTING_STEPS or faster(work, number, LARGEST_TURN / abs(length)):
            break
        for n in range(number):
            work[ANGLES, n] = 0.0  # so that turns are not rounded as differences of angles are
        if instant == STARTING_STEPS - 1:
            copy(work, ANGLES, KEPT)
            for _ in range(2):
                take_step(work, number, forces, step, HALF)
            put_turned(work, states[instant], halves)
            copy(work, KEPT, ANGLES)
        take_step(work, number, forces, step, WHOLE)
        put_turned(work, states[instant], states[instant + 1])
        for n in range(number):
            turns[instant, n] = work[ANGLES, n]
    for n in range(number):
        work[ANGLES, n] = states[instant, n]
    if instant == STARTING_STEPS:
        before, whole = states[instant - 1], states[instant]
        error = difference(before, whole, halves, checks.absolute, checks.relative)
        remember(rings, number)
    return instant, error


@inlined
def put_turned(work: Array, before: Array, after: Array) -> None:
    """Write down a state whose angles are counted from those before."""
    number = before.size // 2
    for n in range(number):
        after[n] = before[n] + work[ANGLES, n]
        after[number + n] = work[RATES, n]


@inlined
def remember(rings: Rings, number: int) -> None:
    """Put w_1 to w_8 into the memory."""
    kicks, turns, memory = rings
    for row in range(1, STARTING_STEPS):
        for n in range(number):
            memory[row, n] = 0.0
        for instant in range(1, STARTING_STEPS):
            of_change = RECALLING[row - 1, instant - 1]
            of_kick = RECALLING[row - 1, instant + 7]
            for n in range(number):
                change = turns[instant, n] - turns[instant - 1, n]
                memory[row, n] += of_change * change + of_kick * kicks[instant, n]


@compile_loop
def advance(
    work: Array,
    plain_forces: PlainForces,
    plain_rings: PlainRings,
    instants: tuple[int, int],
    count: int,
    step: float,
    plain_checks: PlainChecks,
    state: Array,
) -> tuple[int, int, float]:
    """Take steps and write down what is told; return its instant, the last, and largest error.

    Instants are those before. Where an error exceeds 1, the last state is told whose error was
    good. State has the shape (1, 2N).
    """
    forces, rings, checks = named(plain_forces), Rings(*plain_rings), Checks(*plain_checks)
    told, last = instants
    good, number = told, state.shape[1] // 2
    even = scaled(forces.spring, step * step)
    largest, done, next_measured = 0.0, 0, 0
    while done < count:
        measured = next_measured < checks.measured.size and checks.measured[next_measured] <= count
        until = checks.measured[next_measured] if measured else count
        for n in range(number):
            work[KEPT, n] = work[ANGLES, n]
        if forces.springs.size:
            taken = take_uneven_steps(work, number, forces, step * step, rings, last, until - done)
        else:
            taken = take_even_steps(work, number, even, rings, last, until - done)
        done += taken
        last += taken
        if done < until:
            break
        if measured:
            next_measured += 1
            found = error(work, rings, last, step, checks)
            largest = max(largest, found)
            if not found <= 1:
                tell(work, plain_rings, good, last, step, state)
                return good, last, found
            good = max(good, last - AHEAD)
    told = max(told, last - AHEAD)
    tell(work, plain_rings, told, last, step, state)
    return told, last, largest
