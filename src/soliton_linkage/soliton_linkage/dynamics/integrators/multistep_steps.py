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
from soliton_linkage.dynamics.integrators.chain_solver import DEFAULTS, SolverSettings
from soliton_linkage.dynamics.integrators.forces import places_of
from soliton_linkage.dynamics.integrators.multistep_coefficients import (
    AHEAD,
    MEMORY,
    REMEMBERED,
    STARTING_STEPS,
    interpolating,
)
from soliton_linkage.dynamics.integrators.multistep_loops import (
    PlainRings,
    advance,
    begin,
    interpolate,
    tell,
)
from soliton_linkage.dynamics.integrators.nystrom_steps import (
    NONE,
    NystromSteps,
    steps_to_measure,
)
from soliton_linkage.dynamics.integrators.rotor_loops import (
    ANGLES,
    RATES,
    load_angles,
    work_for,
    zeros_in_line,
)
from soliton_linkage.linkage.chain import Array

BEGUN = STARTING_STEPS, STARTING_STEPS
"""Instants that the steps that begin lead to."""


class MultistepSteps:
    """Takes steps of the method; raises ValueError for a motion with damping."""

    def __init__(
        self, motion: EquationOfMotion, together: int, settings: SolverSettings = DEFAULTS
    ) -> None:
        """Take steps along a motion, so many at once at most."""
        if motion.damped:
            raise ValueError(
                f'damping = {motion.chain.damping:g} of the chain must be 0 in a symmetric '
                'multistep method; take SymplecticNystrom'
            )
        self.starting = NystromSteps(motion, settings)
        self._settings = settings
        self._number = motion.rotors
        places = places_of(motion)
        rows = 1 << (together + REMEMBERED + 2 * AHEAD - 1).bit_length()
        kicks, turns = zeros_in_line(rows, places), zeros_in_line(rows, places)
        self._rings: PlainRings = kicks, turns, zeros_in_line(MEMORY, places)
        self._work = work_for(places)
        self._since_load = 0
        self._told, self._last = BEGUN
        self._length = math.nan

    def begin(
        self, state: Array, length: float, absolute: Array, relative: float
    ) -> tuple[Array, float]:
        """Take the steps [s] before the first one of the method.

        Their states, shape (10, 2N), and the error of the last one in units of what is tolerated,
        as in `advance`. They are fewer where a rotor turns by more than half a radian.
        """
        self._length, (self._told, self._last) = length, BEGUN
        self._load(state[: self._number])
        self._work[RATES, : self._number] = state[self._number :]
        states = np.empty((STARTING_STEPS + 1, 2 * self._number))
        done, error = begin(
            self._work,
            self.starting.forces,
            self.starting.step(length),
            length,
            self._rings,
            (absolute, relative, NONE),
            states,
        )
        return states[: done + 1], error

    def advance(self, count: int, absolute: Array, relative: float) -> tuple[Array, int, float]:
        """State after count steps, how many they are, and the largest error that was measured.

        Errors are in units of absolute + relative abs(state). Where one exceeds 1 it stops where
        the last good one was measured, or where it began; it also stops before a rotor turns by
        more than half a radian in a step. If it took less than count steps it has to begin anew.
        """
        told, last = self._told, self._last
        steps = told + count + AHEAD - last
        every = self._settings.measured_every
        measured = steps_to_measure(last - STARTING_STEPS, steps, every)
        self._since_load += steps
        if self._since_load > self._settings.steps_until_exact:
            self._load(self._work[ANGLES, : self._number].copy())
        state = np.empty((1, 2 * self._number))
        self._told, self._last, error = advance(
            self._work,
            self.starting.forces,
            self._rings,
            (told, last),
            steps,
            self._length,
            (absolute, relative, measured),
            state,
        )
        return state[0], self._told - told, error

    def recorded(self, before: Array, count: int) -> Recorded:
        """The last count steps, from the state before them."""
        told, kicks = self._told, self._rings[0]
        knots = np.empty((count + 1, 2 * self._number))
        tell(self._work, self._rings, told, self._last, self._length, knots)
        knots[0] = before
        knots[:, self._number :] *= self._length
        instants = np.arange(told - count - AHEAD, told + AHEAD + 1)
        around = kicks[instants & (len(kicks) - 1), : self._number]
        return Recorded(knots, np.ascontiguousarray(around), self._length)

    def _load(self, angles: Array) -> None:
        self._since_load = 0
        load_angles(self._work, angles)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Steps between which one can interpolate."""

    knots: Array
    """States between them, and on both sides, with h times the rates, shape (steps + 1, 2N)."""
    kicks: Array
    """Of the same instants and of five more on each side."""
    length: float
    """Of a step [s]."""

    def interpolated(self, places: Array) -> Array:
        """States at places, counted in steps, shape (places, 2N); see `interpolating`."""
        found = np.clip(np.floor(places), 0, len(self.knots) - 2).astype(np.int64)
        states = np.empty((len(found), self.knots.shape[1]))
        interpolate(self.knots, self.kicks, found, interpolating(places - found), states)
        states[:, self.kicks.shape[1] :] /= self.length
        return states
