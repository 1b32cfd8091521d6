# SPDX-License-Identifier: Apache-2.0
"""Naive twin of `MultistepSteps`: its steps as the equations have them, all of the past kept."""

from __future__ import annotations

import math

import numpy as np
from naive_nystrom import NaiveNystrom

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.chain_solver import DEFAULTS
from soliton_linkage.dynamics.integrators.multistep_coefficients import (
    AHEAD,
    DIFFERENCE,
    ERROR,
    OF_KICKS,
    OF_TURNS,
    RECALLING,
    RECURSION,
    REMEMBERED,
    RESPONSE,
    STARTING_STEPS,
    interpolating,
)
from soliton_linkage.dynamics.integrators.nystrom_steps import steps_to_measure
from soliton_linkage.dynamics.integrators.rotor_loops import LARGEST_TURN, Checks
from soliton_linkage.linkage.chain import Array


class NaiveMultistep:
    def __init__(self, motion: EquationOfMotion) -> None:
        self._motion = motion

    def begin(
        self, state: Array, step: float, absolute: Array, relative: float
    ) -> tuple[Array, float]:
        number, last = self._motion.rotors, np.array([STARTING_STEPS])
        checks = Checks(absolute, relative, last)
        states, error = NaiveNystrom(self._motion).advance(state, step, STARTING_STEPS, checks)
        turns = np.diff(states[:, :number], axis=0)
        too_far = ~(np.abs(turns) <= LARGEST_TURN).all(axis=1)
        states = states[: 1 + int(np.argmax(np.append(too_far, True)))]
        if len(states) > STARTING_STEPS:
            self._step, self._turns, self._angles = step, list(turns), list(states[:, :number])
            self._kicks = [self._kick(angles) for angles in self._angles]
            known = np.concatenate([np.diff(turns, axis=0), self._kicks[1:STARTING_STEPS]])
            self._memory = [np.zeros(number), *(RECALLING @ known)]
            self._told = STARTING_STEPS
        return states, error

    def advance(self, count: int, absolute: Array, relative: float) -> tuple[Array, int, float]:
        told, last = self._told, len(self._turns)
        measured = steps_to_measure(
            last - STARTING_STEPS, told + count + AHEAD - last, DEFAULTS.measured_every
        )
        largest, good = 0.0, told
        for done in range(1, told + count + AHEAD - last + 1):
            if not self._turned():
                break
            if done in measured:
                error = self._error(absolute, relative)
                largest = max(largest, error)
                if not error <= 1:
                    self._told = good
                    return self._state(good), good - told, error
                good = max(good, len(self._turns) - AHEAD)
        self._told = max(told, len(self._turns) - AHEAD)
        return self._state(self._told), self._told - told, largest

    def interpolated(self, before: Array, count: int, places: Array) -> Array:
        """States at places, counted in steps from count steps before the last that was told."""
        number, states = self._motion.rotors, []
        found = np.clip(np.floor(places), 0, count - 1).astype(np.int64)
        first = self._told - count
        for place, of_angles, of_rates in zip(found, *interpolating(places - found), strict=True):
            knots = [self._state(first + n) if n else before for n in (place, place + 1)]
            ends = [knot[:number] for knot in knots], [knot[number:] for knot in knots]
            near = self._kicks[first + place + 1 - AHEAD : first + place + 1 + AHEAD]
            known = np.vstack([*ends[0], *(self._step * np.array(ends[1])), *near])
            states.append(np.concatenate([of_angles @ known, of_rates @ known / self._step]))
        return np.array(states)

    def _turned(self) -> bool:
        """Turn the rotors unless one would turn too far."""
        remembered = np.array(self._memory[:-9:-1])
        newest = self._kicks[-1] - RECURSION[1:] @ remembered
        turn = self._turns[-1] + (RESPONSE[0] * newest + RESPONSE[1:] @ remembered)
        if not np.abs(turn).max() <= LARGEST_TURN:
            return False
        self._memory.append(newest)
        self._turns.append(turn)
        self._angles.append(self._angles[-1] + turn)
        self._kicks.append(self._kick(self._angles[-1]))
        return True

    def _kick(self, angles: Array) -> Array:
        return self._step**2 * self._motion.accelerations(angles)

    def _state(self, n: int) -> Array:
        turns, kicks = self._turns[n - AHEAD : n + AHEAD], self._kicks[n - AHEAD : n + AHEAD + 1]
        of_angles, rates = OF_TURNS @ np.array(turns) + OF_KICKS @ np.array(kicks)
        return np.concatenate([self._angles[n] + of_angles, rates / self._step])

    def _error(self, absolute: Array, relative: float) -> float:
        missed = ERROR * DIFFERENCE @ np.array(self._kicks[-REMEMBERED - 1 :])
        errors = np.concatenate([missed, missed / self._step])
        rates = self._turns[-1] / self._step
        tolerated = absolute + relative * np.abs(np.concatenate([self._angles[-1], rates]))
        return math.sqrt(float(np.mean((errors / tolerated) ** 2)))
