# SPDX-License-Identifier: Apache-2.0
"""Terms: the torques on the rotors whose sum is the equation of motion.

A new law inside the package is one more class here. A law from outside is a plain function,
`f(time, angles, rates) -> torques`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from soliton_linkage.compiling import b1, compile_loop, compiled, const_f8_1d, const_f8_2d, f8_1d
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.springs import spring_between

TorqueFunction = Callable[[float, Array, Array], Array]
"""Torques [N m] by time [s], angles [rad] and rates [rad/s], shape (N,) each."""


class Term(ABC):
    """Torque on each rotor, as one summand of an equation of motion."""

    dissipative = False
    """Whether `add` may return other powers than 0."""

    @abstractmethod
    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add the torque on each rotor [N m] to `torques`, shape (N,).

        Return the power that the term takes out of the chain [W]; 0 for a term whose energy or
        work is accounted for otherwise.
        """

    def energy(self, angles: Array) -> float:
        """Return the potential energy [J], 0 of a term that has none."""
        del angles
        return 0.0


class SpringTorques(Term):
    """Torques of the springs, -dV/dphi; see `Chain.spring_torques`."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._rows = np.zeros((5, chain.number_of_rotors))
        self._rows[:4] = chain.spring_parameters
        self._rows[4, : chain.number_of_springs] = chain.stiffnesses

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add -k_e (l - lbar) A to the left rotor and -k_e (l - lbar) B to the right one."""
        del time, rates
        _add_springs(torques, angles, self._rows, self._chain.periodic)
        return 0.0

    def energy(self, angles: Array) -> float:
        """Return the sum of (k_e / 2) (l - lbar)^2 [J]."""
        return float(self._chain.elastic_energy(angles))


class Weights(Term):
    """Torques of gravity, g M r sin(phi + tilt)."""

    def __init__(self, chain: Chain, gravity: Gravity) -> None:
        self._chain, self._gravity = chain, gravity
        weights = gravity.acceleration * chain.masses * chain.rotor_lengths
        self.by_sine: Array = weights * math.cos(gravity.tilt)
        """Torque over the sine of the angle [N m], shape (N,)."""
        self.by_cosine: Array = weights * math.sin(gravity.tilt)
        """Torque over the cosine of the angle [N m], shape (N,)."""

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add by_sine sin(phi) + by_cosine cos(phi)."""
        del time, rates
        _add_weights(torques, angles, self.by_sine, self.by_cosine)
        return 0.0

    def energy(self, angles: Array) -> float:
        """Return the sum of g M r cos(phi + tilt) [J]."""
        return float(self._gravity.energy(self._chain, angles))


class HeldTorques(Term):
    """Constant torques [N m], shape (N,), whose work is torque times angle."""

    def __init__(self, held: Array) -> None:
        self.held = held

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add the constant torques."""
        del time, angles, rates
        torques += self.held
        return 0.0


class LinearDamping(Term):
    """Torques -c phi_dot, with c [N m s/rad] of each rotor, shape (N,)."""

    dissipative = True

    def __init__(self, dampings: Array) -> None:
        self._dampings = dampings

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add -c phi_dot; return the sum of c phi_dot^2."""
        del time, angles
        return _add_damping(torques, rates, self._dampings)


class DryFriction(Term):
    """Torques -tau tanh(phi_dot / omega) of bearings, Coulomb's law with a continuous start.

    `torque` tau [N m] is one number or one for each rotor, shape (N,); below about the rate
    omega, `regularisation` [rad/s], the friction falls to 0 in proportion to the rate.
    """

    dissipative = True

    def __init__(self, torque: Array | float, regularisation: float) -> None:
        if not (np.all(np.asarray(torque) >= 0) and regularisation > 0):
            raise ValueError(
                f'friction torque = {torque} N m must be 0 or more, and regularisation = '
                f'{regularisation} rad/s above 0'
            )
        self._torque, self._regularisation = torque, regularisation

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add -tau tanh(phi_dot / omega); return the sum of tau phi_dot tanh(phi_dot / omega)."""
        del time, angles
        friction = self._torque * np.tanh(rates / self._regularisation)
        torques -= friction
        return float(friction @ rates)


class AppliedFunction(Term):
    """Torques of a plain function of time, angles and rates."""

    dissipative = True

    def __init__(self, function: TorqueFunction) -> None:
        self._function = function

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add what the function returns; return minus its power."""
        applied = self._function(time, angles, rates)
        torques += applied
        return -float(applied @ rates)


spring = compile_loop(spring_between, inlined=True)


@compiled(f8_1d, const_f8_1d, const_f8_2d, b1)
def _add_springs(torques: Array, angles: Array, rows: Array, periodic: bool) -> None:
    rotors = angles.size
    lengths, spacings, offsets, rest_lengths, stiffnesses = rows
    horizontal, vertical = np.empty(rotors), np.empty(rotors)
    for n in range(rotors):
        horizontal[n] = lengths[n] * math.sin(angles[n])
        vertical[n] = lengths[n] * math.cos(angles[n])
    for left in range(rotors if periodic else rotors - 1):
        right = left + 1 if left + 1 < rotors else 0
        extension, first, second = spring(
            horizontal[left],
            vertical[left],
            horizontal[right],
            vertical[right],
            spacings[left],
            offsets[left],
            rest_lengths[left],
        )
        pull = stiffnesses[left] * extension
        torques[left] -= pull * first
        torques[right] -= pull * second


@compiled(f8_1d, const_f8_1d, const_f8_1d, const_f8_1d)
def _add_weights(torques: Array, angles: Array, by_sine: Array, by_cosine: Array) -> None:
    for n in range(angles.size):
        torques[n] += by_sine[n] * math.sin(angles[n]) + by_cosine[n] * math.cos(angles[n])


@compiled(f8_1d, const_f8_1d, const_f8_1d)
def _add_damping(torques: Array, rates: Array, dampings: Array) -> float:
    dissipated = 0.0
    for n in range(rates.size):
        friction = dampings[n] * rates[n]
        dissipated += friction * rates[n]
        torques[n] -= friction
    return dissipated
