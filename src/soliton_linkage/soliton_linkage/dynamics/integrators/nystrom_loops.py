# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of `nystrom_steps`, which says what they compute; imports numba.

Every rotor is carried as its angle, cosine and sine, and turned by the small angle of a drift
with polynomials, so that no loop calls a function and all are vectorised. Arrays are padded from
N to P places, whole vectors, with rotors that do not move.

Chains whose springs are all alike and on which nothing else acts go through one loop, which does
all that a rotor needs; for others there is a loop for each thing that acts. They index one array,
`work`, rather than take rows of it, because every array made in a stage counts its references,
which takes longer than twenty rotors do.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import (
    FREEDOMS,
    Kernel,
    arrays_do_not_overlap,
    compile_loop,
    take_widest_vectors,
)
from soliton_linkage.dynamics.integrators.nystrom_steps import LARGEST_TURN, VECTOR, Numbers
from soliton_linkage.linkage.chain import Array

ANGLES, RATES, COSINES, SINES, ON_LEFT, ON_RIGHT, TURNS = range(7)
"""Rows of work, shape (11, P + VECTOR); the last four are to come back to.

Of the angular accelerations by springs, spring n has that of rotor n at place n of ON_LEFT, and
that of rotor n+1 at place n+1 of ON_RIGHT.
"""

ROTORS_IN_CACHE = 1024
"""Of which 32 kB are carried from stage to stage."""

ONE = np.uintp(1)
"""Numbers that could be below 0 would count from the end, and no loop over them is vectorised."""

Coefficients = tuple[float, float, float, float, float]


def inlined(function: Kernel) -> Kernel:
    """Compile a loop into the functions that call it."""
    return compile_loop(function, inlined=True)


def estimating(function: Kernel) -> Kernel:
    """Compile as `inlined` does, but roots and inverses may be estimated."""
    return compile_loop(function, freedoms=FREEDOMS | {'arcp', 'afn'}, inlined=True)


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


@inlined
def turn(work: Array, rates: int, start: int, end: int, time: float) -> None:
    """Turn rotors at their rates for a time."""
    take_widest_vectors()
    for n in range(np.uintp(start), np.uintp(end)):
        x = time * work[rates, n]
        work[ANGLES, n] += x
        work[COSINES, n], work[SINES, n] = turned(work[COSINES, n], work[SINES, n], x)


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
def cross_and_pull(
    c: float, s: float, c_next: float, s_next: float, coefficients: Coefficients
) -> tuple[float, float]:
    """The f and q of `kick_and_turn` of a spring."""
    offset, slope, product, lever, cross = coefficients
    pull = tension(offset + slope * (s_next - s) - product * (s * s_next + c * c_next))
    return lever * pull, cross * pull * (s * c_next - c * s_next)


@inlined
def kick_and_turn(
    angles: Array,
    rates: Array,
    cosines: Array,
    sines: Array,
    start: int,
    end: int,
    number: int,
    coefficients: Coefficients,
    times: tuple[float, float],
    before: tuple[float, float],
) -> tuple[float, float]:
    """Kick and then turn rotors (c, s) between springs, all the same, to the next (c', s').

    x = l^2 / lbar^2 = offset + slope (s' - s) - product (s s' + c c'),
    f = lever (1 - 1 / sqrt(x)),
    q = cross (1 - 1 / sqrt(x)) (s c' - c s'),
    acceleration = (f - f of the spring before) c - (q - q of the spring before),

    slope = 2 a r / lbar^2, product = 2 r^2 / lbar^2, lever = k a r / I, cross = k r^2 / I.

    It begins with f and q of the spring before rotor start, and returns those before rotor end.
    """
    take_widest_vectors()
    arrays_do_not_overlap()
    kick_time, turn_time = times
    f_before, q_before = before
    for n in range(np.uintp(start), np.uintp(end)):
        c, c_next = cosines[n], cosines[n + ONE]
        s, s_next = sines[n], sines[n + ONE]
        f, q = cross_and_pull(c, s, c_next, s_next, coefficients)
        f, q = (f, q) if n < np.uintp(number - 1) else (0.0, 0.0)
        rate = rates[n] + kick_time * ((f - f_before) * c - (q - q_before))
        f_before, q_before = f, q
        rates[n] = rate
        angles[n] += turn_time * rate
        cosines[n], sines[n] = turned(c, s, turn_time * rate)
    return f_before, q_before


@inlined
def take_even_step(
    work: Array,
    number: int,
    coefficients: Coefficients,
    stages: tuple[Array, Array],
    share: float,
) -> None:
    """Take a share of a step between springs that are all alike.

    So that rotors stay in the cache, all stages take some rotors on before they take the next:
    each one rotor less than the stage before it, whose work on its right neighbour it needs.
    """
    drifts, kicks = stages
    places = work.shape[1] - VECTOR
    angles, rates, cosines, sines = work[ANGLES], work[RATES], work[COSINES], work[SINES]
    if places <= ROTORS_IN_CACHE:
        turn(work, RATES, 0, places, share * drifts[0])
        for stage in range(kicks.size):
            times = share * kicks[stage], share * drifts[stage + 1]
            kick_and_turn(
                angles, rates, cosines, sines, 0, places, number, coefficients, times, (0.0, 0.0)
            )
        return
    before = np.zeros((kicks.size, 2))
    for block in range(0, places, ROTORS_IN_CACHE):
        end = block + ROTORS_IN_CACHE
        last = end >= places
        turn(work, RATES, block + min(block, 1), places if last else end + 1, share * drifts[0])
        for stage in range(kicks.size):
            before[stage] = kick_and_turn(
                angles,
                rates,
                cosines,
                sines,
                max(block - stage, 0),
                places if last else end - stage,
                number,
                coefficients,
                (share * kicks[stage], share * drifts[stage + 1]),
                (before[stage, 0], before[stage, 1]),
            )


@inlined
def decay(
    work: Array, places: int, decays: Array, length: int, stage: int, half_inertias: Array
) -> float:
    """Damp the rates in a drift; return the energy taken out and put the angles into TURNS.

    Decays, shape (2, 2, 15, P), are for half a step and a whole one the factors of the rates and
    the angles per rate of each drift.
    """
    dissipated = 0.0
    for n in range(places):
        rate, factor = work[RATES, n], decays[length, 0, stage, n]
        work[TURNS, n] = decays[length, 1, stage, n] * rate
        work[RATES, n] = factor * rate
        dissipated += half_inertias[n] * (1 - factor * factor) * rate * rate
    return dissipated


@inlined
def pull(work: Array, places: int, rows: Array) -> None:
    """Pull of springs that each have their own parameters, the rows, shape (8, P).

    These are offset, slope', slope, product, lever, cross, cross', lever' of `kick_and_turn`, in
    which each place of a length or inertia takes that of its own rotor:

    x = offset + slope' s' - slope s - product (s s' + c c'),
    pull on the left  = (1 - 1 / sqrt(x)) [lever c - cross (s c' - c s')],
    pull on the right = (1 - 1 / sqrt(x)) [cross' (s c' - c s') - lever' c'].
    """
    take_widest_vectors()
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
def pull_all(
    work: Array, number: int, springs: tuple[Coefficients, Array, bool], field: Array
) -> None:
    """Put the accelerations by springs that each have their own parameters, and a field."""
    _, rows, periodic = springs
    if periodic:
        work[COSINES, number], work[SINES, number] = work[COSINES, 0], work[SINES, 0]
    pull(work, rows.shape[1], rows)
    if periodic:
        work[ON_RIGHT, 0] = work[ON_RIGHT, number]
    else:
        work[ON_LEFT, number - 1] = 0.0
    add_field(work, field)


@inlined
def kick(work: Array, number: int, time: float) -> None:
    """Change the rates by the pulls for a time."""
    for n in range(number):
        work[RATES, n] += time * (work[ON_LEFT, n] + work[ON_RIGHT, n])


@compile_loop
def take_step(
    work: Array,
    number: int,
    springs: tuple[Coefficients, Array, bool],
    field: Array,
    damping: tuple[Array, Array],
    stages: tuple[Array, Array],
    length: int,
) -> float:
    """Take one step and return the energy that damping has taken out; see `advance`."""
    coefficients, rows, _ = springs
    decays, half_inertias = damping
    drifts, kicks = stages
    places, share, dissipated = work.shape[1] - VECTOR, (1 + length) / 2, 0.0
    if not rows.size:
        take_even_step(work, number, coefficients, stages, share)
        return dissipated
    for stage in range(drifts.size):
        if half_inertias.size:
            dissipated += decay(work, places, decays, length, stage, half_inertias)
            turn(work, TURNS, 0, places, 1.0)
        else:
            turn(work, RATES, 0, places, share * drifts[stage])
        if stage == kicks.size:
            break
        pull_all(work, number, springs, field)
        kick(work, number, share * kicks[stage])
    return dissipated


@inlined
def record(states: Array, step: int, work: Array, number: int, dissipated: float) -> None:
    """Write down the state after a step."""
    for n in range(number):
        states[step, n] = work[ANGLES, n]
        states[step, number + n] = work[RATES, n]
    if states.shape[1] > 2 * number:
        states[step, -1] = states[step - 1, -1] + dissipated


@inlined
def copy(work: Array, start: int, end: int) -> None:
    """Copy angles, rates, cosines and sines from four rows to four others."""
    for row in range(4):
        for n in range(work.shape[1]):
            work[end + row, n] = work[start + row, n]


@inlined
def error(before: Array, whole: Array, halves: Array, absolute: Array, relative: float) -> float:
    """Root mean square of the difference of two states in units of what is tolerated."""
    squares = 0.0
    for n in range(whole.size):
        tolerated = absolute[n] + relative * max(abs(before[n]), abs(halves[n]))
        squares += ((whole[n] - halves[n]) / tolerated) ** 2
    return math.sqrt(squares / whole.size)


@compile_loop
def advance(
    work: Array,
    springs: tuple[Coefficients, Array, bool],
    field: Array,
    damping: tuple[Array, Array],
    stages: tuple[Array, Array],
    tolerances: tuple[Array, float],
    measured: Numbers,
    states: Array,
) -> tuple[int, float]:
    """Fill states[1:] with the state after each step; return how many, and the largest error.

    Springs are the coefficients of `kick_and_turn`, the rows of `pull`, of shape (8, 0) where the
    former do, and whether the ends are periodic. Field and damping, arguments of
    `add_field` and `decay`, have 0 places where there is none. Stages are the times of drifts and
    kicks [s]. Tolerances are those of `error`, which is measured in the steps whose numbers are
    given. It stops before a step that turns a rotor too far or whose error exceeds 1.
    """
    number = states.shape[1] // 2
    halves = np.empty((3, states.shape[1]))
    fastest, largest_error, next_measured = LARGEST_TURN / np.max(np.abs(stages[0])), 0.0, 0
    for step in range(1, len(states)):
        if faster(work, number, fastest):
            return step - 1, largest_error
        checked = next_measured < measured.size and step == measured[next_measured]
        if checked:
            next_measured += 1
            copy(work, 0, 7)
            halves[0] = states[step - 1]
            for half in (1, 2):
                dissipated = take_step(work, number, springs, field, damping, stages, 0)
                record(halves, half, work, number, dissipated)
            copy(work, 7, 0)
        dissipated = take_step(work, number, springs, field, damping, stages, 1)
        record(states, step, work, number, dissipated)
        if checked:
            found = error(states[step - 1], states[step], halves[2], tolerances[0], tolerances[1])
            largest_error = max(largest_error, found)
            if not found <= 1:
                return step - 1, found
    return len(states) - 1, largest_error


@compile_loop
def interpolate(
    work: Array,
    springs: tuple[Coefficients, Array, bool],
    field: Array,
    damping: tuple[Array, Array, Array],
    stages: tuple[Array, Array],
    states: Array,
    circular: Array,
    places: Array,
    output: Array,
) -> None:
    """Fill output with the states at places, counted in steps, between states.

    The polynomials, degree 8 in the angles, go through angle, rate and acceleration at the ends
    and the middle of a step. Circular holds cosines and sines of the states, shape (2, steps, N).
    Damping are decays and half inertias, as `decay` has them, and decay rates, shape (N,).
    """
    number = states.shape[1] // 2
    half = np.sum(stages[0]) / 2
    knots = np.empty((9, states.shape[1] - number))
    middle = np.empty((2, states.shape[1]))
    fitted = -1
    for frame in range(places.size):
        step = min(int(places[frame]), len(states) - 2)
        if step != fitted:
            load(work, states[step], circular[:, step])
            middle[0] = states[step]
            dissipated = take_step(work, number, springs, field, damping[:2], stages, 0)
            record(middle, 1, work, number, dissipated)
            put_knot(work, springs, field, damping, middle[1], half, knots, 1)
            for end in range(2):
                load(work, states[step + end], circular[:, step + end])
                put_knot(work, springs, field, damping, states[step + end], half, knots, 2 * end)
            fit(knots)
            fitted = step
        evaluate(knots, number, 2 * (places[frame] - step) - 1, half, output[frame])


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
    springs: tuple[Coefficients, Array, bool],
    field: Array,
    damping: tuple[Array, Array, Array],
    state: Array,
    unit: float,
    knots: Array,
    knot: int,
) -> None:
    """Put angles, and dissipated energy, and their two derivatives in a unit of time into knots.

    The accelerations are what rates of 0 become in a kick of one second.
    """
    number = state.size // 2
    decays, half_inertias, decay_rates = damping
    for n in range(work.shape[1]):
        work[RATES, n] = 0.0
    stages = np.zeros(2), np.ones(1)
    take_step(work, number, springs, field, (decays, half_inertias[:0]), stages, 1)
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
    take_widest_vectors()
    for n in range(knots.shape[1]):
        value = slope = 0.0
        for power in range(8, -1, -1):
            slope = slope * x + value
            value = value * x + knots[power, n]
        output[n if n < number else 2 * number] = value
        if n < number:
            output[number + n] = slope / unit
