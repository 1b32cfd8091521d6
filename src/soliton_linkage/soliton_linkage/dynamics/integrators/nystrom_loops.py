# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of `nystrom_steps`, which says what they compute."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soliton_linkage.compiling import (
    arrays_do_not_overlap,
    compile_loop,
    prefer_wide_vectors,
    unsigned,
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
    TURNS,
    VECTOR,
    Before,
    Checks,
    Forces,
    PlainChecks,
    PlainForces,
    Span,
    Spring,
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

HALF, WHOLE = range(2)
"""Lengths of steps."""


class Step(NamedTuple):
    """What steps of one length need."""

    drifts: Array
    """Times of the drifts [s], shape (15,)."""
    kicks: Array
    """Times of the kicks [s], shape (14,)."""
    decays: Array
    """For a half step and a whole one the factor of the rates and the angle per rate of each
    drift, shape (2, 2, 15, P); without damping P is 0."""
    half_inertias: Array
    """Half the moment of inertia of each rotor [kg m^2], shape (P,); empty without damping."""
    decay_rates: Array
    """Of each rotor [1/s], shape (N,)."""


PlainStep = tuple[Array, Array, Array, Array, Array]
"""The fields of `Step`."""


class Times(NamedTuple):
    """How long rotors are kicked and then drift [s]."""

    kick: float
    turn: float


class Rotors(NamedTuple):
    """Rows of work."""

    angles: Array
    rates: Array
    cosines: Array
    sines: Array


@inlined
def turn(work: Array, rates: int, start: int, end: int, time: float) -> None:
    """Turn rotors at their rates for a time."""
    prefer_wide_vectors()
    for n in range(unsigned(start), unsigned(end)):
        x = time * work[rates, n]
        work[ANGLES, n] += x
        work[COSINES, n], work[SINES, n] = turned(work[COSINES, n], work[SINES, n], x)


@inlined
def kick_and_turn(
    rotors: Rotors, span: Span, spring: Spring, times: Times, before: Before
) -> Before:
    """Kick and then turn rotors between springs that are all alike; see `pull_and_cross`.

    It begins with what the spring before the first of them does, and returns the same of that
    before the rotor behind them.
    """
    prefer_wide_vectors()
    arrays_do_not_overlap()
    angles, rates, cosines, sines = rotors
    last = unsigned(span.number - 1)
    kick_time, turn_time = times
    f_before, q_before = before
    for n in range(unsigned(span.start), unsigned(span.end)):
        c, c_next = cosines[n], cosines[n + ONE]
        s, s_next = sines[n], sines[n + ONE]
        f, q = pull_and_cross(c, s, c_next, s_next, spring)
        f, q = (f, q) if n < last else (0.0, 0.0)
        rate = rates[n] + kick_time * ((f - f_before) * c - (q - q_before))
        f_before, q_before = f, q
        rates[n] = rate
        angles[n] += turn_time * rate
        cosines[n], sines[n] = turned(c, s, turn_time * rate)
    return Before(f_before, q_before)


@inlined
def take_even_step(work: Array, number: int, spring: Spring, step: Step, share: float) -> None:
    """Take a share of a step between springs that are all alike.

    So that rotors stay in the cache, all stages take some rotors on before they take the next:
    each one rotor less than the stage before it, whose work on its right neighbour it needs.
    """
    places, stages, first_drift = work.shape[1] - VECTOR, step.kicks.size, share * step.drifts[0]
    rotors = Rotors(work[ANGLES], work[RATES], work[COSINES], work[SINES])
    if places <= ROTORS_IN_CACHE:
        turn(work, RATES, 0, places, first_drift)
        for stage in range(stages):
            times = Times(share * step.kicks[stage], share * step.drifts[stage + 1])
            kick_and_turn(rotors, Span(0, places, number), spring, times, Before(0.0, 0.0))
        return
    before = np.zeros((stages, 2))
    for block in range(0, places, ROTORS_IN_CACHE):
        end = block + ROTORS_IN_CACHE
        last = end >= places
        turn(work, RATES, block + min(block, 1), places if last else end + 1, first_drift)
        for stage in range(stages):
            span = Span(max(block - stage, 0), places if last else end - stage, number)
            times = Times(share * step.kicks[stage], share * step.drifts[stage + 1])
            before[stage] = kick_and_turn(
                rotors, span, spring, times, Before(before[stage, 0], before[stage, 1])
            )


@inlined
def decay(work: Array, places: int, step: Step, length: int, stage: int) -> float:
    """Damp the rates in a drift; return the energy taken out and put the angles into TURNS."""
    dissipated, decays, half_inertias = 0.0, step.decays, step.half_inertias
    for n in range(places):
        rate, factor = work[RATES, n], decays[length, 0, stage, n]
        work[TURNS, n] = decays[length, 1, stage, n] * rate
        work[RATES, n] = factor * rate
        dissipated += half_inertias[n] * (1 - factor * factor) * rate * rate
    return dissipated


@inlined
def kick(work: Array, number: int, time: float) -> None:
    """Change the rates by the pulls for a time."""
    for n in range(number):
        work[RATES, n] += time * (work[ON_LEFT, n] + work[ON_RIGHT, n])


@compile_loop
def take_step(work: Array, number: int, forces: Forces, step: Step, length: int) -> float:
    """Take one step, HALF or WHOLE, and return the energy that damping has taken out."""
    places, share, dissipated = work.shape[1] - VECTOR, (1 + length) / 2, 0.0
    if not forces.springs.size:
        take_even_step(work, number, forces.spring, step, share)
        return dissipated
    for stage in range(step.drifts.size):
        if step.half_inertias.size:
            dissipated += decay(work, places, step, length, stage)
            turn(work, TURNS, 0, places, 1.0)
        else:
            turn(work, RATES, 0, places, share * step.drifts[stage])
        if stage == step.kicks.size:
            break
        pull_all(work, number, forces)
        kick(work, number, share * step.kicks[stage])
    return dissipated


@inlined
def record(states: Array, row: int, work: Array, number: int, dissipated: float) -> None:
    """Write down the state after a step."""
    for n in range(number):
        states[row, n] = work[ANGLES, n]
        states[row, number + n] = work[RATES, n]
    if states.shape[1] > 2 * number:
        states[row, -1] = states[row - 1, -1] + dissipated


@compile_loop
def advance(
    work: Array,
    plain_forces: PlainForces,
    plain_step: PlainStep,
    plain_checks: PlainChecks,
    states: Array,
) -> tuple[int, float]:
    """Fill states[1:] with the state after each step; return how many, and the largest error.

    It stops before a step that turns a rotor too far or whose error exceeds 1.
    """
    forces, step, checks = named(plain_forces), Step(*plain_step), Checks(*plain_checks)
    number = states.shape[1] // 2
    halves = np.empty((3, states.shape[1]))
    fastest, largest_error, next_measured = LARGEST_TURN / np.max(np.abs(step.drifts)), 0.0, 0
    for row in range(1, len(states)):
        if faster(work, number, fastest):
            return row - 1, largest_error
        checked = next_measured < checks.measured.size and row == checks.measured[next_measured]
        if checked:
            next_measured += 1
            copy(work, ANGLES, KEPT)
            halves[0] = states[row - 1]
            for half in (1, 2):
                dissipated = take_step(work, number, forces, step, HALF)
                record(halves, half, work, number, dissipated)
            copy(work, KEPT, ANGLES)
        dissipated = take_step(work, number, forces, step, WHOLE)
        record(states, row, work, number, dissipated)
        if checked:
            error = difference(
                states[row - 1], states[row], halves[2], checks.absolute, checks.relative
            )
            largest_error = max(largest_error, error)
            if not error <= 1:
                return row - 1, error
    return len(states) - 1, largest_error


@compile_loop
def interpolate(
    work: Array,
    plain_forces: PlainForces,
    plain_step: PlainStep,
    states: Array,
    circular: Array,
    places: Array,
    output: Array,
) -> None:
    """Fill output with the states at places, counted in steps, between states.

    The polynomials, degree 8 in the angles, go through angle, rate and acceleration at the ends
    and the middle of a step. Circular holds cosines and sines of the states, shape (2, steps, N).
    """
    forces, step = named(plain_forces), Step(*plain_step)
    number = states.shape[1] // 2
    half = np.sum(step.drifts) / 2
    knots = np.empty((9, states.shape[1] - number))
    middle = np.empty((2, states.shape[1]))
    fitted = -1
    for frame in range(places.size):
        row = min(int(places[frame]), len(states) - 2)
        if row != fitted:
            load(work, states[row], circular[:, row])
            middle[0] = states[row]
            dissipated = take_step(work, number, forces, step, HALF)
            record(middle, 1, work, number, dissipated)
            put_knot(work, forces, step, middle[1], half, knots, 1)
            for end in range(2):
                load(work, states[row + end], circular[:, row + end])
                put_knot(work, forces, step, states[row + end], half, knots, 2 * end)
            fit(knots)
            fitted = row
        evaluate(knots, number, 2 * (places[frame] - row) - 1, half, output[frame])


@inlined
def load(work: Array, state: Array, circular: Array) -> None:
    """Put angles, rates, cosines and sines of a state into work."""
    number = circular.shape[1]
    for n in range(number):
        work[ANGLES, n] = state[n]
        work[RATES, n] = state[number + n]
    for n in range(number):
        work[COSINES, n] = circular[0, n]
        work[SINES, n] = circular[1, n]


@compile_loop
def put_knot(
    work: Array,
    forces: Forces,
    step: Step,
    state: Array,
    unit: float,
    knots: Array,
    knot: int,
) -> None:
    """Put angles, and dissipated energy, and their two derivatives in a unit of time into knots.

    The accelerations are what rates of 0 become in a kick of one second.
    """
    number = state.size // 2
    _, _, decays, half_inertias, decay_rates = step
    for n in range(work.shape[1]):
        work[RATES, n] = 0.0
    kick_alone = Step(np.zeros(2), np.ones(1), decays, half_inertias[:0], decay_rates)
    take_step(work, number, forces, kick_alone, WHOLE)
    for n in range(number):
        knots[3 * knot, n] = state[n]
        knots[3 * knot + 1, n] = unit * state[number + n]
        knots[3 * knot + 2, n] = unit**2 * work[RATES, n]
    if half_inertias.size:
        power = heating = 0.0
        for n in range(number):
            rate, drag = state[number + n], decay_rates[n] * state[number + n]
            knots[3 * knot + 2, n] -= unit**2 * drag
            power += 2 * half_inertias[n] * drag * rate
            heating += 4 * half_inertias[n] * drag * (work[RATES, n] - drag)
        knots[3 * knot, number] = state[2 * number]
        knots[3 * knot + 1, number] = unit * power
        knots[3 * knot + 2, number] = unit**2 * heating


@inlined
def fit(knots: Array) -> None:
    """Turn value, slope and curvature at -1, 0 and 1 into the coefficients of 1 to x^8."""
    for n in range(knots.shape[1]):
        value, slope, curvature = knots[3, n], knots[4, n], knots[5, n]
        before, after = knots[0, n] - value, knots[6, n] - value
        even = (after + before) / 2 - curvature / 2
        even_slope = (knots[7, n] - knots[1, n]) / 2 - curvature
        even_curvature = (knots[8, n] + knots[2, n]) / 2 - curvature
        odd = (after - before) / 2 - slope
        odd_slope = (knots[7, n] + knots[1, n]) / 2 - slope
        odd_curvature = (knots[8, n] - knots[2, n]) / 2
        eighth = (even_curvature - 9 * even_slope + 24 * even) / 8
        sixth = (even_slope - 4 * even) / 2 - 2 * eighth
        seventh = (odd_curvature - 7 * odd_slope + 15 * odd) / 8
        fifth = (odd_slope - 3 * odd) / 2 - 2 * seventh
        knots[0, n], knots[1, n], knots[2, n] = value, slope, curvature / 2
        knots[3, n], knots[4, n] = odd - fifth - seventh, even - sixth - eighth
        knots[5, n], knots[6, n], knots[7, n], knots[8, n] = fifth, sixth, seventh, eighth


@inlined
def evaluate(knots: Array, number: int, x: float, unit: float, output: Array) -> None:
    """State of polynomials in x, which is time in a unit."""
    prefer_wide_vectors()
    for n in range(knots.shape[1]):
        value = slope = 0.0
        for power in range(8, -1, -1):
            slope = slope * x + value
            value = value * x + knots[power, n]
        output[n if n < number else 2 * number] = value
        if n < number:
            output[number + n] = slope / unit
