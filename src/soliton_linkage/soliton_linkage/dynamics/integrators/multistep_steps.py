# SPDX-License-Identifier: Apache-2.0
"""Steps of a symmetric multistep method along the motion of a chain of springs.

The turns x_(n+1) - x_n of the rotors between instants, a step h apart, are a filter's response to
the kicks h^2 x''_n = h^2 a(x_n), one force a step:

    w_n = h^2 a(x_n) - sum_(j=1)^8 q_j w_(n-j),
    x_(n+1) - x_n = x_n - x_(n-1) + sum_(j=0)^8 b_j w_(n-j),

where both palindromes come from the roots of sum_j q_j z^j, which lie on the unit circle at
e^(+-i psi_k): these say how the method could vibrate besides the motion that it approximates. The
b_j make it exact for polynomials of degree 11 in the time, order 10. It is the same forth and
back, so that vibrations are neither damped nor fed as long as they are slow enough: J. D. Lambert
and I. A. Watson, J. Inst. Maths Applics 18 (1976) 189; G. D. Quinlan and S. Tremaine, Astron. J.
100 (1990) 1694. The psi_k were chosen for a small error and stable long steps.

The state that is told is five steps behind the last, from turns and kicks on both sides, so
weighted that the method's own vibrations vanish from it. Where these grow, as they may in long
runs, the error shows them, and the solver begins anew without them. Damping would feed some of
them; chains that have it need a method of one step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.multistep_coefficients import (
    AHEAD,
    DIFFERENCE,
    ERROR,
    MEMORY,
    OF_KICKS,
    OF_TURNS,
    RECALLING,
    RECURSION,
    REMEMBERED,
    RESPONSE,
    STARTING_STEPS,
    interpolating,
)
from soliton_linkage.dynamics.integrators.nystrom_steps import (
    DRIFTS,
    KICKS,
    LARGEST_TURN,
    MEASURED_EVERY,
    STEPS_UNTIL_EXACT,
    VECTOR,
    Checks,
    CompiledSteps,
    Numbers,
    Steps,
    load_angles,
    steps_of,
    zeros_in_line,
)
from soliton_linkage.dynamics.integrators.nystrom_steps import load_loops as load_starting_loops
from soliton_linkage.linkage.chain import Array, Chain


def load_loops() -> None:
    """Compile the loops, of the steps that begin too, or load what was compiled.

    Raises ImportError where numba is absent.
    """
    load_starting_loops()
    steps = MultistepSteps(EquationOfMotion(Chain(number_of_rotors=2)), 1, compiled=True)
    steps.begin(np.zeros(4), 1e-3, np.ones(4), 0.0)
    steps.advance(1, np.ones(4), 0.0)
    steps.recorded(np.zeros(4), 1).interpolated(np.zeros(1))


class Past:
    """What steps have left behind: kicks and turns of some last instants, and w.

    Instants are counted from the first of the steps that begin. Row n & (rows - 1) of kicks and
    turns is that of instant n, row n & 15 of the memory is w_n. `told` is that of the state that
    was told.
    """

    def __init__(self, places: int, instants: int) -> None:
        """Have room for so many instants."""
        rows = 1 << (instants - 1).bit_length()
        self.kicks = zeros_in_line(rows, places)
        self.turns = zeros_in_line(rows, places)
        self.memory = zeros_in_line(MEMORY, places)
        self.last = self.told = STARTING_STEPS

    def rows(self, first: int, end: int) -> Numbers:
        """Rows of the instants from first to before end."""
        return np.arange(first, end) & (len(self.kicks) - 1)


class MultistepSteps:
    """Takes steps of the method.

    Compiled loops or numpy: as `nystrom_steps.steps_of` chooses. Raises ValueError for a motion
    with damping.
    """

    def __init__(
        self, motion: EquationOfMotion, together: int, compiled: bool | None = None
    ) -> None:
        """Take steps along a motion, so many at once at most."""
        if motion.damped:
            raise ValueError(
                f'damping = {motion.chain.damping:g} of the chain must be 0 in a symmetric '
                'multistep method; take SymplecticNystrom'
            )
        self.starting = steps_of(motion, compiled)
        self._loops = (
            CompiledLoops(motion, self.starting)
            if isinstance(self.starting, CompiledSteps)
            else NumpyLoops(motion, self.starting)
        )
        self._number = motion.rotors
        self._past = Past(self._loops.places, together + REMEMBERED + 2 * AHEAD)
        self._step = math.nan

    def begin(
        self, state: Array, step: float, absolute: Array, relative: float
    ) -> tuple[Array, float]:
        """Take the steps [s] before the first one of the method.

        Their states, shape (10, 2N), and the error of the last one in units of what is tolerated,
        as in `advance`. They are fewer where a rotor turns by more than half a radian.
        """
        self._step = step
        self._past.last = self._past.told = STARTING_STEPS
        checks = Checks(absolute, relative, MEASURED_EVERY - STARTING_STEPS)
        return self._loops.begin(self._past, state, step, checks)

    def advance(self, count: int, absolute: Array, relative: float) -> tuple[Array, int, float]:
        """State after count steps, how many they are, and the largest error that was measured.

        Errors are in units of absolute + relative abs(state). Where one exceeds 1 it stops where
        the last good one was measured, or where it began; it also stops before a rotor turns by
        more than half a radian in a step. If it took less than count steps it has to begin anew.
        """
        past = self._past
        checks = Checks(absolute, relative, past.last - STARTING_STEPS)
        told, steps = past.told, past.told + count + AHEAD - past.last
        state, error = self._loops.advance(past, self._step, steps, checks)
        return state, past.told - told, error

    def recorded(self, before: Array, count: int) -> Recorded:
        """The last count steps, from the state before them."""
        past = self._past
        knots = self._loops.told(past, self._step, count + 1)
        knots[0] = before
        knots[:, self._number :] *= self._step
        kicks = past.kicks[past.rows(past.told - count - AHEAD, past.told + AHEAD + 1)]
        kicks = np.ascontiguousarray(kicks[:, : self._number])
        return Recorded(knots, kicks, self._step, self._loops)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Steps between which one can interpolate."""

    knots: Array
    """States between them, and on both sides, with h times the rates, shape (steps + 1, 2N)."""
    kicks: Array
    """Of the same instants and of five more on each side."""
    step: float
    loops: CompiledLoops | NumpyLoops

    def interpolated(self, places: Array) -> Array:
        """States at places, counted in steps, shape (places, 2N); see `interpolating`."""
        found = np.clip(np.floor(places), 0, len(self.knots) - 2).astype(np.int64)
        weights = interpolating(places - found)
        states = self.loops.interpolated(self.knots, self.kicks, found, weights)
        states[:, self.kicks.shape[1] :] /= self.step
        return states


class NumpyLoops:
    """Steps as the equations have them."""

    def __init__(self, motion: EquationOfMotion, starting: Steps) -> None:
        """Along a motion."""
        self._motion, self._starting = motion, starting
        self.places = motion.rotors
        self._angles = np.zeros(motion.rotors)

    def begin(self, past: Past, state: Array, step: float, checks: Checks) -> tuple[Array, float]:
        """See `MultistepSteps.begin`."""
        states, error = self._starting.advance(state, step, STARTING_STEPS, checks)
        turns = np.diff(states[:, : self.places], axis=0)
        too_far = ~(np.abs(turns) <= LARGEST_TURN).all(axis=1)
        states = states[: 1 + int(np.argmax(np.append(too_far, True)))]
        if len(states) > STARTING_STEPS:
            angles, square = states[:, : self.places], step**2
            kicks = np.array([square * self._motion.accelerations(each) for each in angles])
            past.turns[:STARTING_STEPS], past.kicks[: STARTING_STEPS + 1] = turns, kicks
            known = np.concatenate([np.diff(turns, axis=0), kicks[1:STARTING_STEPS]])
            past.memory[1:STARTING_STEPS] = RECALLING @ known
            self._angles = angles[-1].copy()
        return states, error

    def advance(self, past: Past, step: float, count: int, checks: Checks) -> tuple[Array, float]:
        """State and largest error of steps, whose last one that is good is told."""
        measured, largest, good = checks.measured(count), 0.0, past.told
        for done in range(1, count + 1):
            if not self._turned(past):
                break
            past.last += 1
            kick = step**2 * self._motion.accelerations(self._angles)
            past.kicks[past.rows(past.last, past.last + 1)] = kick
            if done in measured:
                error = self._error(past, step, checks)
                largest = max(largest, error)
                if not error <= 1:
                    past.told = good
                    return self.told(past, step, 1)[0], error
                good = max(good, past.last - AHEAD)
        past.told = max(past.told, past.last - AHEAD)
        return self.told(past, step, 1)[0], largest

    def _turned(self, past: Past) -> bool:
        """Turn the rotors unless one would turn too far."""
        n = past.last
        remembered = past.memory[(n - np.arange(1, 9)) & (MEMORY - 1)]
        newest = past.kicks[past.rows(n, n + 1)][0] - RECURSION[1:] @ remembered
        turn = past.turns[past.rows(n - 1, n)][0]
        turn = turn + (RESPONSE[0] * newest + RESPONSE[1:] @ remembered)
        near = bool(np.abs(turn).max() <= LARGEST_TURN)
        if near:
            past.memory[n & (MEMORY - 1)] = newest
            past.turns[past.rows(n, n + 1)] = turn
            self._angles += turn
        return near

    def told(self, past: Past, step: float, count: int) -> Array:
        """States of so many instants up to that which is told, shape (count, 2N)."""
        angles, states = self._angles.copy(), np.empty((count, 2 * self.places))
        for n in range(past.last - 1, past.told - count, -1):
            angles -= past.turns[past.rows(n, n + 1)][0]
            if n <= past.told:
                turns = past.turns[past.rows(n - AHEAD, n + AHEAD)]
                kicks = past.kicks[past.rows(n - AHEAD, n + AHEAD + 1)]
                of_angles, rates = OF_TURNS @ turns + OF_KICKS @ kicks
                states[count - 1 + n - past.told] = *(angles + of_angles), *(rates / step)
        return states

    def interpolated(
        self, knots: Array, kicks: Array, found: Numbers, weights: tuple[Array, Array]
    ) -> Array:
        """See `Recorded.interpolated`."""
        number, states = self.places, []
        for row, step in enumerate(found):
            ends = knots[step : step + 2].reshape(2, 2, number).swapaxes(0, 1).reshape(4, number)
            around = np.vstack([ends, kicks[step + 1 : step + 1 + 2 * AHEAD]])
            states.append(np.concatenate([weights[0][row] @ around, weights[1][row] @ around]))
        return np.array(states)

    def _error(self, past: Past, step: float, checks: Checks) -> float:
        n = past.last
        missed = ERROR * DIFFERENCE @ past.kicks[past.rows(n - REMEMBERED, n + 1)]
        errors = np.concatenate([missed, missed / step])
        turn = past.turns[past.rows(n - 1, n)][0]
        tolerated = checks.absolute + checks.relative * np.abs([*self._angles, *(turn / step)])
        return math.sqrt(float(np.mean((errors / tolerated) ** 2)))


class CompiledLoops:
    """Steps in the loops of `multistep_kernels`; raises ImportError where numba is absent."""

    def __init__(self, motion: EquationOfMotion, starting: CompiledSteps) -> None:
        """Along a motion."""
        from soliton_linkage.dynamics.integrators import multistep_loops as kernels

        self._kernels = kernels
        self._number = motion.rotors
        self._forces = starting.forces
        self.places = starting.places
        self._work = zeros_in_line(11, self.places + VECTOR)
        self._since_load = 0

    def begin(self, past: Past, state: Array, step: float, checks: Checks) -> tuple[Array, float]:
        """See `MultistepSteps.begin`."""
        number = self._number
        self._load(state[:number])
        self._work[1, :number] = state[number:]
        states = np.empty((STARTING_STEPS + 1, 2 * number))
        done, error = self._kernels.begin(
            self._work,
            *self._forces,
            (step * DRIFTS, step * KICKS),
            step,
            (past.kicks, past.turns, past.memory),
            (checks.absolute, checks.relative),
            states,
        )
        return states[: done + 1], error

    def advance(self, past: Past, step: float, count: int, checks: Checks) -> tuple[Array, float]:
        """State and largest error of steps, whose last one that is good is told."""
        states = np.empty((1, 2 * self._number))
        self._since_load += count
        if self._since_load > STEPS_UNTIL_EXACT:
            self._load(self._work[0, : self._number].copy())
        past.told, past.last, error = self._kernels.advance(
            self._work,
            *self._forces,
            (past.kicks, past.turns, past.memory),
            (past.told, past.last, count),
            step,
            (checks.absolute, checks.relative),
            checks.measured(count),
            states,
        )
        return states[0], error

    def told(self, past: Past, step: float, count: int) -> Array:
        """States of so many instants up to that which is told, shape (count, 2N)."""
        states = np.empty((count, 2 * self._number))
        rings = past.kicks, past.turns, past.memory
        self._kernels.tell(self._work, rings, past.told, past.last, step, states)
        return states

    def interpolated(
        self, knots: Array, kicks: Array, found: Numbers, weights: tuple[Array, Array]
    ) -> Array:
        """See `Recorded.interpolated`."""
        states = np.empty((len(found), 2 * self._number))
        self._kernels.interpolate(knots, kicks, found, weights, states)
        return states

    def _load(self, angles: Array) -> None:
        self._since_load = 0
        load_angles(self._work, angles)
