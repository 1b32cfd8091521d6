# SPDX-License-Identifier: Apache-2.0
"""Terms of the equation of motion; each of them adds a torque to every rotor.

A kernel is a compiled loop that computes the torques of a term. To add a term with a kernel, write
a subclass of `CompiledTerm` and the kernel, and call the kernel in `sum_terms`. A Python function
`f(time, angles, rates) -> torques` is also a term, but only scipy's solvers accept it.

A kernel reads angles, rates, cosines and sines from rows of the array `work`, shape
(rows, P + VECTOR), and adds torques [N m] to the row TORQUES. P is the number of rotors N rounded
up to a multiple of VECTOR; elements from N on are zeros. A kernel uses indices instead of views of
rows, because numba counts the references to views, which is slow.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    FASTMATH_FLAGS,
    compile_loop,
    compiled,
    const_f8_1d,
    const_f8_2d,
    const_i8_2d,
    f8_1d,
    inlined,
    prefer_wide_vectors,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity

TorqueFunction = Callable[[float, Array, Array], Array]
"""Function from time [s], angles [rad] and rates [rad/s] to torques [N m], shape (N,) each."""

VECTOR = 8
"""Largest number of doubles in a vector register."""

ANGLES, RATES, COSINES, SINES, TORQUES, TORQUES_ON_RIGHT, ACTIVE = range(7)
"""Indices of the rows of `work`. Element n + 1 of TORQUES_ON_RIGHT is the torque that spring n
exerts on its right rotor, n + 1. ACTIVE contains the sum of the torques of all active terms
(see `Term.active`); TORQUES includes the torques of all terms."""

SPRINGS, GRAVITY, CONSTANT, LINEAR_DAMPING, DRY_FRICTION = range(5)
QUADRATIC_DAMPING, ON_SITE, NON_RECIPROCAL = range(5, 8)
"""Kinds of compiled terms."""


class Term(ABC):
    """One summand of the torque on each rotor in the equation of motion."""

    dissipative = False
    """Whether the term is damping, friction or a Python function. The energy that the term removes
    counts as dissipated energy."""
    active = False
    """Whether the torques of the term depend on the angles, but have no potential energy. The
    energy that an active term removes also counts as dissipated energy, although `dissipative` is
    False."""

    @abstractmethod
    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add the torques of the term [N m] to `torques`; return the dissipated power [W]."""

    def energy(self, angles: Array) -> float:
        """Return the potential energy [J], or 0 for a term without a potential energy."""
        del angles
        return 0.0


class CompiledTerm(Term):
    """Term with a compiled kernel.

    The torques depend on the rates if the term is dissipative, otherwise on the angles.
    """

    kind: int

    def __init__(self, *rows: Array) -> None:
        self.rows = np.array(rows)
        """Parameters of the kernel, shape (parameters, N), or (parameters, 1) if the values of all
        rotors are equal."""

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add the torques of the kernel; return the dissipated power [W]."""
        del time
        return torques_of(angles, rates, *term_table([self], torques.size), torques)


class SpringTorques(CompiledTerm):
    """Torques of the springs, -dV/dphi; see `Chain.spring_torques`."""

    kind = SPRINGS

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        squares, count = chain.rest_lengths**2, chain.number_of_springs
        left = chain.rotor_lengths[:count]
        right = np.roll(chain.rotor_lengths, -1)[:count]
        super().__init__(*np.zeros((7, chain.number_of_rotors)))
        self.rows[0] = 1.0
        self.rows[:, :count] = (
            1 + chain.offsets / squares,
            2 * chain.spacings * right / squares,
            2 * chain.spacings * left / squares,
            2 * left * right / squares,
            chain.stiffnesses * chain.spacings * left,
            chain.stiffnesses * chain.spacings * right,
            chain.stiffnesses * left * right,
        )

    def energy(self, angles: Array) -> float:
        """Return the sum of (k_e / 2) (l - lbar)^2 [J]."""
        return float(self._chain.elastic_energy(angles))


class Weights(CompiledTerm):
    """Torques of gravity, g M r sin(phi + tilt)."""

    kind = GRAVITY

    def __init__(self, chain: Chain, gravity: Gravity) -> None:
        self._chain, self._gravity = chain, gravity
        weights = gravity.acceleration * chain.masses * chain.rotor_lengths
        super().__init__(math.cos(gravity.tilt) * weights, math.sin(gravity.tilt) * weights)

    def energy(self, angles: Array) -> float:
        """Return the sum of g M r cos(phi + tilt) [J]."""
        return float(self._gravity.energy(self._chain, angles))


class HeldTorques(CompiledTerm):
    """Constant torques; the argument contains the torques [N m], shape (N,)."""

    kind = CONSTANT


class LinearDamping(CompiledTerm):
    """Torques -c phi_dot of linear damping; the argument is c [N m s/rad], shape (N,)."""

    kind, dissipative = LINEAR_DAMPING, True


class DryFriction(CompiledTerm):
    """Friction torques -tau tanh(phi_dot / omega) of the bearings: regularised Coulomb friction.

    `torque` is tau [N m], a number or an array of shape (N,). `regularisation` is omega [rad/s].
    """

    kind, dissipative = DRY_FRICTION, True

    def __init__(self, torque: Array | float, regularisation: float) -> None:
        if not (np.all(np.asarray(torque) >= 0) and regularisation > 0):
            raise ValueError(
                f'friction torque = {torque} N m must be 0 or more, and regularisation = '
                f'{regularisation} rad/s above 0'
            )
        torques = np.atleast_1d(np.asarray(torque, dtype=np.float64))
        super().__init__(torques, np.full_like(torques, 1 / regularisation))


class QuadraticDamping(CompiledTerm):
    """Torques -c phi_dot abs(phi_dot); the argument is c [N m s^2/rad^2], shape (N,)."""

    kind, dissipative = QUADRATIC_DAMPING, True


class OnSitePotential(CompiledTerm):
    """Torques of a potential that is periodic in each angle, as in the Frenkel-Kontorova model.

    The potential is V = sum_n (A_n / m) [1 - cos(m (q_n - q_0))], with
    A = `Chain.on_site_torques`, m = `Chain.on_site_order` and q_0 = `Chain.on_site_phase`. The
    coordinate of a rotor is q = s phi + (1 - s) pi / 2 with s = `Chain.signs`.
    """

    kind = ON_SITE

    def __init__(self, chain: Chain) -> None:
        signs, order = chain.signs, chain.on_site_order
        phases = order * ((1 - signs) * math.pi / 2 - chain.on_site_phase)
        super().__init__(signs * chain.on_site_torques, signs * order, phases)

    def energy(self, angles: Array) -> float:
        """Return the potential energy V [J]."""
        torques, slopes, phases = self.rows
        return float(torques / slopes @ (1 - np.cos(slopes * angles + phases)))


class NonReciprocal(CompiledTerm):
    """Torques of motors that break reciprocity: equal on the two coordinates of a bond.

    The motors of a bond apply the torque kappa (q_n - q_{n+1}) to the coordinates q_n and q_{n+1},
    which `OnSitePotential` defines. The difference is wrapped to the range from -pi to pi. In
    terms of the angles, let sigma be 1 for flippers and -1 for spinners, and
    D = phi_n + sigma phi_{n+1} - (1 + sigma) pi / 2. The torques are kappa D on rotor n and -sigma
    kappa D on rotor n + 1. Source: Brandenbourger et al., Nature Communications 10, 4608 (2019).
    """

    kind, active = NON_RECIPROCAL, True

    def __init__(self, chain: Chain) -> None:
        strengths = np.zeros(chain.number_of_rotors)
        strengths[: chain.number_of_springs] = chain.non_reciprocities
        super().__init__(strengths, np.full_like(strengths, -chain.signs[1]))


class AppliedFunction(Term):
    """Torques that a Python function of time, angles and rates returns."""

    dissipative = True

    def __init__(self, function: TorqueFunction) -> None:
        self._function = function

    def add(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add the torques that the function returns; return the power that they dissipate [W]."""
        applied = self._function(time, angles, rates)
        torques += applied
        return -float(applied @ rates)


def of_chain(chain: Chain) -> list[CompiledTerm]:
    """Return the terms, other than springs, that the parameters of a chain specify."""
    terms: list[CompiledTerm] = []
    if chain.on_site_torque:
        terms.append(OnSitePotential(chain))
    if chain.damping:
        terms.append(LinearDamping(chain.dampings))
    if chain.dry_friction:
        terms.append(DryFriction(chain.dry_frictions, chain.friction_rate))
    if chain.quadratic_damping:
        terms.append(QuadraticDamping(chain.quadratic_dampings))
    if chain.non_reciprocity:
        terms.append(NonReciprocal(chain))
    return terms


class TermTable(NamedTuple):
    """Kinds and parameters of compiled terms."""

    kinds: NDArray[np.int64]
    """Kind of each term and index of its first row in `parameters`, shape (terms, 2)."""
    parameters: Array
    """Parameter rows of all terms, shape (rows, P)."""


def term_table(terms: Sequence[CompiledTerm], rotors: int) -> TermTable:
    """Return the table of the given terms for a chain of `rotors` rotors."""
    kinds, first = np.empty((len(terms), 2), dtype=np.int64), 0
    parameters = np.zeros((sum(len(term.rows) for term in terms), padded_size(rotors)))
    for index, term in enumerate(terms):
        end = first + len(term.rows)
        kinds[index] = term.kind, first
        parameters[first:end, :rotors] = term.rows
        if term.kind == SPRINGS:
            parameters[first, rotors:] = 1.0  # the length of padding springs must not be 0
        first = end
    for table in kinds, parameters:
        table.flags.writeable = False  # numba compiles again for writable arrays
    return TermTable(kinds, parameters)


def padded_size(rotors: int) -> int:
    """Return P, the number of rotors rounded up to a multiple of VECTOR."""
    return -(-rotors // VECTOR) * VECTOR


@compile_loop
def sum_terms(work: Array, rotors: int, kinds: NDArray[np.int64], parameters: Array) -> float:
    """Set the torques in `work` to the sum of all terms; return the dissipated power [W].

    The term of the springs, if there is one, must be the first, and active terms must be the last.
    """
    prefer_wide_vectors()
    power, start, active = 0.0, 0, False
    if kinds.shape[0] and kinds[0, 0] == SPRINGS:
        _set_springs(work, rotors, parameters, kinds[0, 1])
        start = 1
    else:
        for n in range(parameters.shape[1]):
            work[TORQUES, n] = work[TORQUES_ON_RIGHT, n] = 0.0
    for term in range(start, kinds.shape[0]):
        kind, first = kinds[term, 0], kinds[term, 1]
        if kind == GRAVITY:
            _add_weights(work, parameters, first)
        elif kind == CONSTANT:
            _add_constants(work, parameters, first)
        elif kind in (LINEAR_DAMPING, DRY_FRICTION, QUADRATIC_DAMPING):
            power += _add_friction(work, kind, parameters, first)
        elif kind == ON_SITE:
            _add_on_site(work, parameters, first)
        elif kind == NON_RECIPROCAL:
            if not active:
                active = True
                for n in range(rotors):
                    work[ACTIVE, n] = 0.0
            _add_non_reciprocal(work, rotors, parameters, first)
    if active:
        for n in range(rotors):
            work[TORQUES, n] += work[ACTIVE, n]
        power += active_power(work, rotors)
    return power


@inlined
def active_power(work: Array, rotors: int) -> float:
    """Return the power that active torques remove at the current rates [W]."""
    power = 0.0
    for n in range(rotors):
        power -= work[ACTIVE, n] * work[RATES, n]
    return power


def _estimating(function: Callable[[float], float]) -> Callable[[float], float]:
    return compile_loop(function, fastmath=FASTMATH_FLAGS | {'arcp', 'afn'}, inlined=True)


@_estimating
def _inverse_root_estimate(w: float) -> float:
    """Return an estimate of 1 / sqrt(w) in single precision."""
    return float(np.float32(1) / np.sqrt(np.float32(w)))


@inlined
def tension(w: float) -> float:
    """Return 1 - 1 / sqrt(w): the force of a spring of length l = lbar sqrt(w), divided by k_e l.

    With an estimate y of 1 / sqrt(w) and d = 1 - w y^2, the series y (1 + d / 2 + 3 d^2 / 8)
    equals 1 / sqrt(w) in double precision. A division and a square root would take twice as long.
    """
    y = _inverse_root_estimate(w)
    d = 1 - w * y * y
    return (1 - y) - y * d * (0.5 + 0.375 * d)


@inlined
def _set_springs(work: Array, rotors: int, rows: Array, first: int) -> None:
    """Set the torques of the springs between neighbouring rotors.

    The left rotor has the cosine c and sine s, the right rotor has c' and s'. The parameter rows
    are offset, slope', slope, product, lever, lever' and cross:

        l^2 / lbar^2 = w = offset + slope' s' - slope s - product (s s' + c c'),
        torque on the left  = (1 - 1 / sqrt(w)) [lever c - cross (s c' - c s')],
        torque on the right = (1 - 1 / sqrt(w)) [cross (s c' - c s') - lever' c'].

    The last spring joins the last rotor to the first. With free ends, the parameters of this
    spring are 0, except offset = 1, so that its torques are 0.
    """
    prefer_wide_vectors()
    work[COSINES, rotors], work[SINES, rotors] = work[COSINES, 0], work[SINES, 0]
    for n in range(rows.shape[1]):
        c, c_next = work[COSINES, n], work[COSINES, n + 1]
        s, s_next = work[SINES, n], work[SINES, n + 1]
        w = rows[first, n] + (rows[first + 1, n] * s_next - rows[first + 2, n] * s)
        e = tension(w - rows[first + 3, n] * (s * s_next + c * c_next))
        cross = rows[first + 6, n] * (s * c_next - c * s_next)
        work[TORQUES, n] = e * (rows[first + 4, n] * c - cross)
        work[TORQUES_ON_RIGHT, n + 1] = e * (cross - rows[first + 5, n] * c_next)
    work[TORQUES_ON_RIGHT, 0] = work[TORQUES_ON_RIGHT, rotors]


@inlined
def _add_weights(work: Array, rows: Array, first: int) -> None:
    for n in range(rows.shape[1]):
        by_cosine = rows[first + 1, n] * work[COSINES, n]
        work[TORQUES, n] += rows[first, n] * work[SINES, n] + by_cosine


@inlined
def _add_constants(work: Array, rows: Array, first: int) -> None:
    for n in range(rows.shape[1]):
        work[TORQUES, n] += rows[first, n]


@inlined
def _add_friction(work: Array, kind: int, rows: Array, first: int) -> float:
    power = 0.0
    for n in range(rows.shape[1]):
        rate = work[RATES, n]
        if kind == DRY_FRICTION:
            friction = rows[first, n] * math.tanh(rows[first + 1, n] * rate)
        elif kind == QUADRATIC_DAMPING:
            friction = rows[first, n] * rate * abs(rate)
        else:
            friction = rows[first, n] * rate
        power += friction * rate
        work[TORQUES, n] -= friction
    return power


@inlined
def _add_on_site(work: Array, rows: Array, first: int) -> None:
    for n in range(rows.shape[1]):
        phase = rows[first + 1, n] * work[ANGLES, n] + rows[first + 2, n]
        work[TORQUES, n] -= rows[first, n] * math.sin(phase)


@inlined
def _add_non_reciprocal(work: Array, rotors: int, rows: Array, first: int) -> None:
    for n in range(rotors):
        right = n + 1 if n + 1 < rotors else 0
        sigma = rows[first + 1, n]
        difference = work[ANGLES, n] + sigma * work[ANGLES, right] - (1 + sigma) * (math.pi / 2)
        difference -= 2 * math.pi * math.floor(difference / (2 * math.pi) + 0.5)
        torque = rows[first, n] * difference
        work[ACTIVE, n] += torque
        work[ACTIVE, right] -= sigma * torque


@compiled(const_f8_1d, const_f8_1d, const_i8_2d, const_f8_2d, f8_1d)
def torques_of(
    angles: Array, rates: Array, kinds: NDArray[np.int64], parameters: Array, torques: Array
) -> float:
    """Add the torques of the terms in a `TermTable` [N m]; return the dissipated power [W]."""
    rotors = angles.size
    work = np.zeros((ACTIVE + 1, parameters.shape[1] + VECTOR))
    for n in range(rotors):
        work[ANGLES, n] = angles[n]
        work[RATES, n] = rates[n]
        work[COSINES, n] = math.cos(angles[n])
        work[SINES, n] = math.sin(angles[n])
    power = sum_terms(work, rotors, kinds, parameters)
    for n in range(rotors):
        torques[n] += work[TORQUES, n] + work[TORQUES_ON_RIGHT, n]
    return power
