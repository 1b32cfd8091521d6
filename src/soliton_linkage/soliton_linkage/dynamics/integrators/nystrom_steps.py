# SPDX-License-Identifier: Apache-2.0
"""Steps of a symplectic Runge-Kutta-Nystrom method along the motion of a chain of springs.

A step of length h is a palindrome of drifts and kicks,

    drift(a_15 h) kick(b_14 h) drift(a_14 h) ... kick(b_1 h) drift(a_1 h),

both of which are exact flows: a kick changes the rates by the accelerations at the angles as they
are; a drift turns rotors at their rates, which decay with the damping gamma = c / (M r^2),

    phi_dot(t) = phi_dot e^(-gamma t),    phi(t) = phi + phi_dot (1 - e^(-gamma t)) / gamma,

and takes out the kinetic energy that they lose. Without damping the map is symplectic and each
step is undone by a step of -h. With it areas in phase space shrink exactly as those of the motion
do, by e^(-h sum gamma), and energy plus dissipated energy is what stays near its value.

The coefficients are those of SRKN_14^a, order 6, of S. Blanes and P. C. Moan, J. Comput. Appl.
Math. 142 (2002) 313, which makes use of a kinetic energy that is quadratic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_loops import PlainStep, advance, interpolate
from soliton_linkage.dynamics.integrators.rotor_loops import (
    ANGLES,
    COSINES,
    RATES,
    SINES,
    VECTOR,
    WORK_ROWS,
    Checks,
    Numbers,
    PlainForces,
)
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import NO_DEVIATIONS

ORDER = 6
"""The error of a step of length h goes as h^7."""
STABLE_STEP = 3.14
"""Longest step in units of 1 / omega at which vibrations of frequency omega stay bounded.

Those of pi grow, though by less than a thousandth a step, and those of 6.15 and more.
"""

_HALF_OF_DRIFTS = (
    0.0378593198406116,
    0.102635633102435,
    -0.0258678882665587,
    0.314241403071447,
    -0.130144459517415,
    0.106417700369543,
    -0.00879424312851058,
)
"""a_1 to a_7 of the paper."""
_HALF_OF_KICKS = (
    0.09171915262446165,
    0.183983170005006,
    -0.05653436583288827,
    0.004914688774712854,
    0.143761127168358,
    0.328567693746804,
)
"""b_1 to b_6 of the paper."""
_LAST_KICK = 0.5 - sum(_HALF_OF_KICKS)
"""b_7, of which the kicks of half a step add up to a half."""

DRIFTS = np.array([*_HALF_OF_DRIFTS, 1 - 2 * sum(_HALF_OF_DRIFTS), *_HALF_OF_DRIFTS[::-1]])
"""a_1 to a_15."""
KICKS = np.array([*_HALF_OF_KICKS, _LAST_KICK, _LAST_KICK, *_HALF_OF_KICKS[::-1]])
"""b_1 to b_14."""


@dataclass(frozen=True)
class SolverSettings:
    """Tuning of `SymplecticNystrom`."""

    rotors_together: int = 16_000
    """Rotors times steps in one call of the loops; half or twice as many: time within 10 %."""
    safety: float = 0.8
    """Of the turn at which loops stop the fastest rotor makes this share in the longest step.

    Half of it: 60 % more forces where a rotor spins fast, else no difference. Where it is 1
    a rotor that is sped up stops them for good.
    """
    aim: float = 0.3
    """Error, over that tolerated, that a new length of step is chosen for.

    Half or twice of it: forces -10 to +10 %, errors from half to twice as large.
    """
    worth_growing: float = 1.25
    """How much longer a step must be for a change; 1.13 and 1.5: forces within 6 %."""
    worth_shrinking: float = 0.95
    """How much shorter one must be while the first is on trial; 0.9 and 0.975: no difference."""
    measured_every: int = 32
    """Of how many steps one has its error measured; 16: forces +6 %, 64: forces -3 %."""
    steps_until_exact: int = 1000
    """Steps after which cosines and sines, off by a rounding more each time, are taken anew.

    Half or twice as many: no difference but of rounding.
    """
    shortest: float = 1e-6
    """Step, over the longest that is stable, at which a solver gives up, later or earlier."""
    trials: int = 60
    """Of lengths for one step, after which it gives up; it takes one to three but to give up."""


DEFAULTS = SolverSettings()

NONE: Numbers = np.empty(0, dtype=np.int64)
"""No step has its error measured."""


def steps_to_measure(taken: int, count: int, every: int) -> Numbers:
    """Which of the next steps have their error measured; the next one is 1.

    Of the first step of a length, which says little of a motion that begins, of two soon after
    it, and then of one in so many; some of this length were taken before.
    """
    regular = np.arange(every - taken % every, count + 1, every)
    early = [step for step in (1, 4, 16) if taken < step <= taken + count]
    return np.append(np.array(early) - taken, regular) if early else regular


class NystromSteps:
    """Takes steps along a motion."""

    def __init__(self, motion: EquationOfMotion, settings: SolverSettings = DEFAULTS) -> None:
        """Along a motion, with nothing taken over from one step to the next."""
        self._motion = motion
        self._until_exact = settings.steps_until_exact
        self.forces = forces_of(motion)
        half_inertias = motion.chain.moments_of_inertia / 2
        self._half_inertias = self._padded(half_inertias) if motion.damped else np.empty(0)
        self._prepared = math.nan
        self._work = work_for(places_of(motion))
        self._between = np.zeros_like(self._work)
        self._since_load = self._until_exact

    def advance(
        self, state: Array, length: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        """States at the start and after each of count steps [s], and the largest error.

        It stops before a step in which a rotor would turn by more than half a radian in a drift,
        or whose error against two steps of half the length exceeds 1, so that the states have
        the shape (done + 1, len(state)).
        """
        number = self._motion.rotors
        states = np.empty((count + 1, len(state)))
        states[0] = state
        self._since_load += count
        if (
            self._since_load > self._until_exact
            or (self._work[ANGLES, :number] != states[0, :number]).any()
        ):
            self._since_load = 0
            load_angles(self._work, states[0, :number])
        self._work[RATES, :number] = state[number : 2 * number]
        step, plain = self._prepare(length), tuple(checks or (states[0], 0.0, NONE))
        done, error = advance(self._work, self.forces, step, plain, states)
        return states[: done + 1], error

    def interpolated(self, states: Array, length: float, places: Array) -> Array:
        """States at places, counted in steps from the first state, shape (places, len(state)).

        Polynomials in each step, degree 8 in the angles, have angles, rates and accelerations at
        its ends and its middle.
        """
        angles = states[:, : self._motion.rotors]
        output = np.empty((len(places), states.shape[1]))
        circular = np.array([np.cos(angles), np.sin(angles)])
        step = self._prepare(length)
        interpolate(self._between, self.forces, step, states, circular, places, output)
        return output

    def step(self, length: float) -> PlainStep:
        """What steps of a length [s] need, the fields of `nystrom_loops.Step`."""
        decays = self._decays(length)
        rates = self._motion.decay_rates
        return length * DRIFTS, length * KICKS, decays, self._half_inertias, rates

    def _prepare(self, length: float) -> PlainStep:
        """What steps of a length need, as the last ones may have had it."""
        if length != self._prepared:
            self._prepared, self._step = length, self.step(length)
        return self._step

    def _decays(self, length: float) -> Array:
        if not self._motion.damped:
            return np.empty((2, 2, len(DRIFTS), 0))
        times = np.multiply.outer([length / 2, length], DRIFTS)[..., np.newaxis]
        return self._padded(np.array(decay(self._motion, times)).swapaxes(0, 1))

    def _padded(self, values: Array) -> Array:
        return padded(values, places_of(self._motion))


def decay(motion: EquationOfMotion, time: float | Array) -> tuple[Array, Array]:
    """Factor of the rates after a free time [s], and the angle turned per rate [s], (N,) each.

    Of times of shape (..., 1) they have the shape (..., N).
    """
    exponents = -motion.decay_rates * time
    divisors = np.where(exponents == 0, 1.0, exponents)
    growth = np.where(exponents == 0, 1.0, np.expm1(exponents) / divisors)
    return np.exp(exponents), time * growth


def places_of(motion: EquationOfMotion) -> int:
    """Places for the rotors of a motion, in whole vectors."""
    return -(-motion.rotors // VECTOR) * VECTOR


def forces_of(motion: EquationOfMotion) -> PlainForces:
    """All that acts on the rotors but damping, the fields of `Forces`."""
    rows = _springs(motion)
    offset, _, slope, product, lever, cross, *_ = (float(row[0]) for row in rows)
    springs = padded(rows, places_of(motion))
    springs[0, rows.shape[1] :] = 1.0  # where there is no spring, none has length 0 either
    return (
        (offset, slope, product, lever, cross),
        np.empty((8, 0)) if _plain(motion) else springs,
        _field(motion),
        motion.chain.periodic,
    )


def padded(values: Array, places: int) -> Array:
    """Values of the rotors with zeros behind them, shape (..., places)."""
    longer = np.zeros((*values.shape[:-1], places))
    longer[..., : values.shape[-1]] = values
    return longer


def _springs(motion: EquationOfMotion) -> Array:
    chain, inverse = motion.chain, motion.inverse_inertias
    left = np.arange(chain.number_of_springs)
    right = (left + 1) % chain.number_of_rotors
    squares, lengths = chain.rest_lengths**2, chain.rotor_lengths
    lever_left = chain.stiffnesses * chain.spacings * lengths[left] * inverse[left]
    lever_right = chain.stiffnesses * chain.spacings * lengths[right] * inverse[right]
    crosses = chain.stiffnesses * lengths[left] * lengths[right]
    return np.array(
        [
            1 + chain.offsets / squares,
            2 * chain.spacings * lengths[right] / squares,
            2 * chain.spacings * lengths[left] / squares,
            2 * lengths[left] * lengths[right] / squares,
            lever_left,
            crosses * inverse[left],
            crosses * inverse[right],
            lever_right,
        ]
    )


def _plain(motion: EquationOfMotion) -> bool:
    """Whether springs that are all alike are all that acts."""
    even = motion.chain.deviations == NO_DEVIATIONS and not motion.fixed
    return even and not (motion.chain.periodic or motion.damped or motion.in_field)


def _field(motion: EquationOfMotion) -> Array:
    if not motion.in_field:
        return np.empty((3, 0))
    rows = np.array([motion.held_torques, motion.weights.by_sine, motion.weights.by_cosine])
    return padded(rows * motion.inverse_inertias, places_of(motion))


def work_for(places: int) -> Array:
    """Rows for rotors at so many places."""
    return zeros_in_line(WORK_ROWS, places + VECTOR)


def zeros_in_line(rows: int, places: int) -> Array:
    """Zeros of shape (rows, places), at an address where a line of the cache begins.

    Vectors that lie across two lines take longer. They are filled now, so that the system does
    not have to find the room later, page by page.
    """
    size, line = rows * places, 64
    room = np.full(size + VECTOR, 0.0)
    first = -room.ctypes.data % line // room.itemsize
    return room[first : first + size].reshape(rows, places)


def load_angles(work: Array, angles: Array) -> None:
    """Put angles, cosines and sines into the first rows of work."""
    rows = work[:, : len(angles)]
    rows[ANGLES] = angles
    np.cos(angles, out=rows[COSINES])
    np.sin(angles, out=rows[SINES])
