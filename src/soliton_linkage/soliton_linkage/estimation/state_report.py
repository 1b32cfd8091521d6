# SPDX-License-Identifier: Apache-2.0
"""What one state of a known chain shows: its energies, its topology and its edge rotors.

Walls are given by their places [rotor spacings], found elsewhere. What noise adds to squares is
taken off them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.estimation import state_loops
from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.settings import DEFAULTS, ReportSettings
from soliton_linkage.linear.bands import couplings, penetration_depth, winding_number
from soliton_linkage.linkage.chain import Array, Chain, Motion, check_shape


class Energies(NamedTuple):
    """Where the energy of a state is [J]; NaN for all that takes rates where they are unknown.

    kinetic: energy of the rotors that move.
    elastic: energy of the springs.
    kinetic_wake: part of the kinetic energy that is out of reach of every wall.
    elastic_wake: part of the elastic energy that is out of reach of every wall.
    kinetic_deviation: standard deviation of the kinetic energy, from noise and what is hidden;
        NaN where the noise of the rates is not known.
    elastic_deviation: standard deviation of the elastic energy, from noise and what is hidden.
    """

    kinetic: float
    elastic: float
    kinetic_wake: float
    elastic_wake: float
    kinetic_deviation: float
    elastic_deviation: float

    @property
    def whole(self) -> float:
        """Kinetic and elastic energy [J]."""
        return self.kinetic + self.elastic

    @property
    def wake(self) -> float:
        """Energy that the walls have left behind [J]."""
        return self.kinetic_wake + self.elastic_wake

    @property
    def wall(self) -> float:
        """Energy within reach of the walls [J]."""
        return self.whole - self.wake


class Topology(NamedTuple):
    """Polarisations, winding numbers, charge and zero mode of a state.

    polarisations: means before the first wall and beyond the last, +1 leaning right, -1 leaning
        left.
    winding_numbers: of the uniform states that these sides are in; they differ by the charge.
    charge: walls of charge +1 less those of -1.
    mode_centre: where the zero mode sits [rotor spacings].
    """

    polarisations: tuple[float, float]
    winding_numbers: tuple[int, int]
    charge: int
    mode_centre: float


class EdgeRotors(NamedTuple):
    """States of the first and the last rotor.

    toggled: whether each has toggled, against the left-leaning state; None for spinners.
    turns: turns that each has made from a uniform state [1]; NaN for flippers.
    """

    toggled: tuple[bool, bool] | None
    turns: tuple[float, float]


class StateReport(NamedTuple):
    """What a state shows."""

    topology: Topology | None
    """None for periodic ends, which have no two sides."""
    edge_rotors: EdgeRotors
    energies: Energies


class FrameErrors(NamedTuple):
    """What is known of the errors of a frame.

    noise: standard deviation of the angles [rad].
    rate_noise: standard deviation of the rates [rad/s], NaN where it is not known.
    lasting: root mean square of what the orbit leaves of the angles beside the noise [rad].
    unseen: rotors that were not seen, whose angles and rates are the orbit's, shape (N,).
    """

    noise: float = 0.0
    rate_noise: float = 0.0
    lasting: float = 0.0
    unseen: Flags | None = None

    @property
    def known_rate_noise(self) -> float:
        """What may be taken off the squares of rates as their noise [rad/s], 0 if unknown."""
        return self.rate_noise if math.isfinite(self.rate_noise) else 0.0


class ArcRate(NamedTuple):
    """How fast a chain goes along its orbit, for want of the rates of its rotors.

    rate: of the arc length, over that of free motion where equal rotors have 1 [rad/s]: see
        `Orbit.free_rate`.
    deviation: standard deviation of the rate, over the same [rad/s].
    """

    rate: float
    deviation: float = 0.0


EXACT = FrameErrors()
_NO_TURNS = (math.nan, math.nan)
"""Of the edge rotors of flippers."""


class FrameState:
    """A configuration of a chain and its springs, where more is asked of it than a report."""

    def __init__(self, chain: Chain, angles: ArrayLike) -> None:
        """Take the angles [rad], shape (N,); raises ValueError where they do not fit."""
        self.chain = chain
        self.angles = np.ascontiguousarray(angles, dtype=np.float64)
        check_shape(self.angles, chain.number_of_rotors)
        self.springs: Array = np.empty((3, chain.number_of_springs))
        """Extensions [m] and levers A and B [m/rad] of the springs, shape (3, springs)."""
        self.twists, self.upright = state_loops.of_angles(
            self.angles, chain.spring_parameters, chain.periodic, self.springs
        )
        if not math.isfinite(self.twists):
            chain.check_angles(self.angles)

    @property
    def first(self) -> Array:
        """Levers A [m/rad], shape (springs,)."""
        return np.asarray(self.springs[1])

    @property
    def second(self) -> Array:
        """Levers B [m/rad], shape (springs,)."""
        return np.asarray(self.springs[2])


def energy_reach(chain: Chain, settings: ReportSettings = DEFAULTS.report) -> float:
    """Distance from a wall beyond which energy is its wake [rotor spacings], 8 ell / a + 3.

    The energy of a moving wall falls as the square of its tails, e^(-2 x / ell), or faster where
    speed has contracted it: no more than e^-16 is beyond. Near d = 1, where ell vanishes, the
    core alone is wider; 3 spacings hold it.
    """
    depth = penetration_depth(chain) / chain.spacing
    return settings.reach_in_depths * depth + settings.reach_beside


class StateReporter:
    """Reports the states of a chain; what does not change from one to the next is kept.

    Places of walls are in rotor spacings, of shape () or (W,), NaN or empty without a wall.
    """

    def __init__(self, chain: Chain, settings: ReportSettings = DEFAULTS.report) -> None:
        """Work out what all states have in common."""
        self.chain = chain
        self._reach = energy_reach(chain, settings)
        self._domain = settings.domain
        self._springs = np.tile(0.5 * chain.stiffnesses, (3, 1))
        self._rotors = np.tile(0.5 * chain.moments_of_inertia, (3, 1))
        self._rotors[2] = 0.0
        self._scope = np.zeros(1, state_loops.SCOPE)
        plus, minus = couplings(chain)
        self._uniform = (plus**2 - minus**2) / (plus**2 + minus**2)
        self._windings = {lean > 0: winding_number(chain, lean) for lean in (1, -1)}
        self._last_sign = 1 if chain.number_of_rotors % 2 else -1

    def report(
        self,
        angles: ArrayLike,
        places: ArrayLike,
        rates: Array | ArcRate | None = None,
        errors: FrameErrors = EXACT,
    ) -> StateReport:
        """What angles [rad], shape (N,), show; raises ValueError where they do not fit.

        Energies are in J; spring n, with (k_e / 2) (l_n - lbar)^2, counts at n + 1/2. Noise adds
        (k_e / 2) (A_n^2 + B_n^2) sigma^2 to the energy of a spring and (I / 2) sigma_rate^2 to
        that of a rotor, which are taken off, so that energies near 0 may come out negative.
        Without walls all is wake. Rates are those of the rotors [rad/s], shape (N,), or that of
        the arc, which tells the kinetic energy (I / 2) rate^2 but not that of the wake. A rotor
        that was not seen may hide as much energy as the noise and what the orbit leaves of the
        others would give it; the deviations count it in full.

        A side's winding number is that of the uniform state that leans as it does on the mean of
        its bonds; a side without bonds counts as the nearest of them.
        """
        chain, walls = self.chain, _finite(places)
        state = np.ascontiguousarray(angles, dtype=np.float64)
        check_shape(state, chain.number_of_rotors)
        noise, unseen, springs = errors.known_rate_noise, errors.unseen, self._springs
        if unseen is not None:
            seen = ~unseen
            half, count = springs[0], chain.number_of_springs
            springs = np.array([half, half * seen[:count], half * np.roll(seen, -1)[:count]])
        rotors = self._rotors
        if unseen is not None:
            rotors = rotors.copy()
            rotors[1, unseen] = 0.0
        if rates is None or isinstance(rates, ArcRate):
            rotors[2] = 0.0
        else:
            check_shape(rates, chain.number_of_rotors, 'rate')
            rotors[2] = rates
        before, beyond = self._bonds_beside(walls)
        domain = self._domain * self._uniform
        self._scope[0] = errors.noise, noise, self._reach, before, beyond, domain
        shape, sides, elastic, kinetic = state_loops.report(
            state,
            chain.spring_parameters,
            chain.periodic,
            springs,
            rotors,
            self._between(walls),
            self._scope,
        )
        if not math.isfinite(shape[0]):
            chain.check_angles(state)
        if not math.isfinite(kinetic[0]):
            chain.check_angles(rotors[2], 'rate')
        if rates is None or isinstance(rates, ArcRate):
            kinetic = self._of_arc(rates, elastic)
        elif noise != errors.rate_noise:
            kinetic = *kinetic[:2], math.nan
        if unseen is not None:
            hidden = self._hidden(FrameState(chain, state), errors, unseen)
            elastic = *elastic[:2], math.hypot(elastic[2], hidden[0])
            kinetic = *kinetic[:2], math.hypot(kinetic[2], hidden[1])
        return StateReport(
            None if chain.periodic else self._topology(sides, before, beyond),
            self._edge_rotors(state, shape),
            Energies(kinetic[0], elastic[0], kinetic[1], elastic[1], kinetic[2], elastic[2]),
        )

    def _bonds_beside(self, walls: list[float]) -> tuple[int, int]:
        """Number of bonds before the first wall, and of the first beyond the last."""
        bonds = self.chain.number_of_springs
        first, last = (walls[0], walls[-1]) if walls else (math.inf, -math.inf)
        before = math.floor(min(max(first - 0.5, 0.0), bonds - 1)) + 1
        return before, math.ceil(max(min(last - 0.5, bonds - 1.0), 0.0))

    def _topology(self, sides: state_loops.Sides, before: int, beyond: int) -> Topology:
        left, right, at_first, at_last, centre = sides
        bonds = self.chain.number_of_springs
        means = left / (before * self._uniform), right / ((bonds - beyond) * self._uniform)
        windings = self._windings[means[0] > 0], self._windings[means[1] > 0]
        charge = int(at_first > 0) - int(at_last > 0)
        return Topology(means, windings, charge, centre)

    def _edge_rotors(self, angles: Array, shape: state_loops.Shape) -> EdgeRotors:
        """States of the edge rotors.

        A flipper's edge rotor toggles by passing the line from its pivot to its neighbour's
        mass, where A_0 or B_{N-2} changes sign; in the left-leaning state A_0 has the sign of
        d - 1 and B_n that of (-1)^(n+1), upside down the opposite. A spinner's turns are counted
        in its angle from theta = theta_bar, or from -theta_bar in the family of states that has
        no such state: half a turn in each passage of a wall.
        """
        chain = self.chain
        twists, upright, at_first, at_last = shape
        if chain.motion is Motion.SPINNER:
            rest = math.copysign(chain.rest_angle, twists if twists else -1.0)
            last_rest = rest if chain.number_of_rotors % 2 else math.pi - rest
            turned = float(angles[0]) - rest, float(angles[-1]) - last_rest
            return EdgeRotors(None, (turned[0] / (2 * math.pi), turned[1] / (2 * math.pi)))
        stands = -1 if upright < 0 else 1
        at_first *= stands * (1 if chain.lean_ratio > 1 else -1)
        return EdgeRotors((at_first < 0, at_last * stands * self._last_sign < 0), _NO_TURNS)

    def _of_arc(self, rate: ArcRate | None, elastic: state_loops.Energy) -> state_loops.Energy:
        """Kinetic energy of a chain of which no rotor's rate is known [J].

        What moves beside the orbit has as much as the springs hold, give or take as much again:
        phonons have the same in both on the mean, and the contraction of a wall adds
        (gamma - 1) M_eff v^2 / 2, twice what it strains, to the energy of the orbit. Counted is
        what noise has surely not made.
        """
        if rate is None:
            return math.nan, math.nan, math.nan
        half = 0.5 * self.chain.moment_of_inertia
        variance = rate.deviation**2
        moving = rate.rate**2 - variance
        spread = 4 * variance * (max(moving, 0.0) + variance / 2)
        held = max(elastic[0] - elastic[2], 0.0)
        return half * moving + held, math.nan, math.hypot(half * math.sqrt(spread), held)

    def _hidden(
        self, state: FrameState, errors: FrameErrors, unseen: Flags
    ) -> tuple[float, float]:
        """Elastic and kinetic energy that rotors which were not seen may hide [J]."""
        half = self._springs[0]
        stiffness = self.chain.gathered(half * state.first**2, half * state.second**2)
        elastic = float(stiffness[unseen].sum()) * (errors.noise**2 + errors.lasting**2)
        return elastic, float(self._rotors[0, unseen].sum()) * errors.known_rate_noise**2

    def _between(self, walls: list[float]) -> Array:
        """Places of walls, which grow, and what is next beyond either end of the chain."""
        before, beyond = -math.inf, math.inf
        if self.chain.periodic and walls:
            rotors = self.chain.number_of_rotors
            before, beyond = walls[-1] - rotors, walls[0] + rotors
        return np.array([before, *walls, beyond])


def _finite(places: ArrayLike) -> list[float]:
    """Places of walls in their order, without those that are not finite."""
    given: list[float] = places if isinstance(places, list) else np.ravel(places).tolist()
    return sorted(site for site in given if math.isfinite(site))
