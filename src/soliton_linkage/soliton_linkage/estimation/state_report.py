# SPDX-License-Identifier: Apache-2.0
"""Report of one state of a known chain: energies (noise subtracted), topology, edge rotors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.estimation import state_loops
from soliton_linkage.estimation.frames import Flags
from soliton_linkage.linear.bands import couplings, penetration_depth, winding_number
from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linkage.chain import Array, Chain, Motion, check_shape
from soliton_linkage.linkage.springs import TINY
from soliton_linkage.solitons.tanh_fit import DOMAIN


class Energies(NamedTuple):
    """Energies of a state [J]; kinetic energies are NaN if the rates are unknown.

    The wake is the part of the chain that is far from all walls.

    kinetic: kinetic energy of the rotors.
    elastic: energy of the springs.
    kinetic_wake: kinetic energy of the wake.
    elastic_wake: elastic energy of the wake.
    kinetic_deviation: standard deviation of the kinetic energy; NaN if the rate noise is unknown.
    elastic_deviation: standard deviation of the elastic energy.
    """

    kinetic: float
    elastic: float
    kinetic_wake: float
    elastic_wake: float
    kinetic_deviation: float
    elastic_deviation: float

    @property
    def whole(self) -> float:
        """Total energy [J]."""
        return self.kinetic + self.elastic

    @property
    def wake(self) -> float:
        """Energy of the wake [J]."""
        return self.kinetic_wake + self.elastic_wake

    @property
    def wall(self) -> float:
        """Energy near the walls [J]."""
        return self.whole - self.wake


class Topology(NamedTuple):
    """Polarisations, winding numbers, charge and zero mode of a state.

    polarisations: mean polarisations of the bonds before the first wall and of the bonds beyond
        the last wall; +1 if all rotors there lean right, and -1 if all of them lean left.
    winding_numbers: winding numbers of the uniform states before the first wall and beyond the
        last wall; their difference is the charge.
    charge: number of walls with charge +1 minus number of walls with charge -1.
    mode_centre: centre of the zero mode [rotor spacings].
    """

    polarisations: tuple[float, float]
    winding_numbers: tuple[int, int]
    charge: int
    mode_centre: float


class EdgeRotors(NamedTuple):
    """States of the first and the last rotor.

    toggled: whether each rotor has toggled (see `Orbit`); None for spinners.
    turns: angle of each rotor minus its angle in a uniform state, divided by 2 pi [1]; NaN for
        flippers. The uniform state leans right, or left if the chain is turned (see
        `polarised_bonds`).
    """

    toggled: tuple[bool, bool] | None
    turns: tuple[float, float]


class StateReport(NamedTuple):
    """Topology, edge rotors and energies of one state."""

    topology: Topology | None
    """Topology of the chain; None for a ring, because a ring has no edges."""
    edge_rotors: EdgeRotors
    energies: Energies


class FrameErrors(NamedTuple):
    """Errors of the angles and rates of a frame.

    noise: standard deviation of the angles [rad].
    rate_noise: standard deviation of the rates [rad/s], NaN if unknown.
    persistent: root mean square of the persistent differences from the orbit [rad].
    unseen: flags of rotors whose angles are taken from the orbit because they are not measured,
        shape (N,); None if all angles are measured.
    """

    noise: float = 0.0
    rate_noise: float = 0.0
    persistent: float = 0.0
    unseen: Flags | None = None

    @property
    def known_rate_noise(self) -> float:
        """Standard deviation of the rates [rad/s], 0 if unknown."""
        return self.rate_noise if math.isfinite(self.rate_noise) else 0.0


class ArcRate(NamedTuple):
    """Rate of the arc length and its standard deviation [rad/s].

    Both are divided by the number `Orbit.free_rate`, so that the kinetic energy of a moving wall
    is (I / 2) rate^2 in any chain. I is the moment of inertia of a rotor without deviations.
    """

    rate: float
    deviation: float = 0.0


EXACT = FrameErrors()
_NO_TURNS = (math.nan, math.nan)


def energy_reach(chain: Chain) -> float:
    """Return the distance from a wall beyond which energy belongs to the wake [rotor spacings].

    At most the fraction e^-16 of the energy of a wall is beyond 8 penetration depths. 3 rotor
    spacings are added, because the penetration depth of some walls is 0.
    """
    depth = penetration_depth(chain) / chain.spacing
    return 8 * depth + 3


def polarised_bonds(chain: Chain, angles: Array) -> tuple[Array, bool]:
    """Return the polarisation of each bond, shape (springs,), and whether the chain is turned.

    The levers A and B of a bond are the derivatives of its length with respect to the angles of
    its left and of its right rotor. The polarisation is here (A^2 - B^2) / (A^2 + B^2), divided by
    `uniform_polarisation`. It is 1 in the right-leaning and -1 in the left-leaning uniform state,
    also if the chain is turned. A flipper is turned if it is upside down, and a spinner is turned
    if it leans left before its kink. The angles [rad] have shape (N,).
    """
    springs = np.empty((3, chain.number_of_springs))
    twists, upright = state_loops.of_angles(
        angles, chain.spring_parameters, chain.periodic, springs
    )
    first, second = springs[1] ** 2, springs[2] ** 2
    strength = np.maximum(first + second, TINY) * uniform_polarisation(chain)
    turned = (twists if chain.motion is Motion.SPINNER else upright) < 0
    return np.asarray((first - second) / strength), turned


def uniform_polarisation(chain: Chain) -> float:
    """Return (A^2 - B^2) / (A^2 + B^2) for the levers A and B of the right-leaning state [1]."""
    plus, minus = couplings(chain)
    return (plus**2 - minus**2) / (plus**2 + minus**2)


class StateReporter:
    """Reporter of the states of one chain."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self._reach = energy_reach(chain)
        self._springs = np.tile(0.5 * chain.stiffnesses, (3, 1))
        self._rotors = np.tile(0.5 * chain.moments_of_inertia, (3, 1))
        self._rotors[2] = 0.0
        self._scope = np.zeros(1, state_loops.SCOPE)
        self._uniform = uniform_polarisation(chain)
        self._windings = {lean > 0: winding_number(chain, lean) for lean in (1, -1)}
        self._last_sign = 1 if chain.number_of_rotors % 2 else -1

    def report(
        self,
        angles: ArrayLike,
        sites: ArrayLike,
        rates: Array | ArcRate | None = None,
        errors: FrameErrors = EXACT,
    ) -> StateReport:
        """Return energies, topology and edge rotors of the state with given angles [rad], (N,).

        `sites` are the sites of the walls [rotor spacings], empty or NaN without walls. `rates`
        are the rates of the rotors [rad/s], shape (N,), or an `ArcRate`. From an `ArcRate`, the
        kinetic energy is (I / 2) rate^2 plus an estimate for waves, and the kinetic energy of the
        wake is NaN.

        Let noise have the standard deviations sigma for angles and sigma_rate for rates. On
        average, it adds (k_e / 2) (A_n^2 + B_n^2) sigma^2 to the energy of a spring and (I / 2)
        sigma_rate^2 to the energy of a rotor. The reporter subtracts these mean values, so that
        small energies may become negative. Raises ValueError for another shape and for values that
        are not finite.
        """
        chain, walls = self.chain, _finite(sites)
        state = np.ascontiguousarray(angles, dtype=np.float64)
        check_shape(state, chain.number_of_rotors)
        noise, unseen = errors.known_rate_noise, errors.unseen
        springs, rotors = self._rows(unseen)
        if rates is None or isinstance(rates, ArcRate):
            rotors[2] = 0.0
        else:
            check_shape(rates, chain.number_of_rotors, 'rate')
            rotors[2] = rates
        before, beyond = self._bonds_beside(walls)
        domain = DOMAIN * self._uniform
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
            hidden = self._hidden(state, errors, unseen)
            elastic = *elastic[:2], math.hypot(elastic[2], hidden[0])
            kinetic = *kinetic[:2], math.hypot(kinetic[2], hidden[1])
        return StateReport(
            None if chain.periodic else self._topology(sides, before, beyond),
            self._edge_rotors(state, shape),
            Energies(kinetic[0], elastic[0], kinetic[1], elastic[1], kinetic[2], elastic[2]),
        )

    def _rows(self, unseen: Flags | None) -> tuple[Array, Array]:
        """Return `springs` and `rotors` of `state_loops.report`; the caller sets the rates."""
        if unseen is None:
            return self._springs, self._rotors
        seen, half, count = ~unseen, self._springs[0], self.chain.number_of_springs
        rotors = self._rotors.copy()
        rotors[1, unseen] = 0.0
        lefts, rights = seen[:count], np.roll(seen, -1)[:count]
        return np.array([half, half * lefts, half * rights]), rotors

    def _bonds_beside(self, walls: list[float]) -> tuple[int, int]:
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
        """Return the states of the edge rotors.

        An edge rotor of a flipper has toggled if its lever has not the sign that it has in the
        left-leaning state (see `Orbit`). The levers are A_0 of the first and B_{N-2} of the last
        rotor. In the left-leaning state, A_0 has the sign of d - 1, with the lean ratio d = 2 r
        sin(theta_bar) / a, and B_{N-2} has the sign of (-1)^(N-1). If the flipper is upside down,
        both signs are opposite.
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
        """Return the kinetic energy, NaN for its part in the wake, and its standard deviation [J].

        The kinetic energy of waves is assumed to equal their elastic energy, which is estimated as
        the elastic energy of the chain minus its standard deviation.
        """
        if rate is None:
            return math.nan, math.nan, math.nan
        half = 0.5 * self.chain.moment_of_inertia
        variance = rate.deviation**2
        moving = rate.rate**2 - variance
        spread = 4 * variance * (max(moving, 0.0) + variance / 2)
        held = max(elastic[0] - elastic[2], 0.0)
        return half * moving + held, math.nan, math.hypot(half * math.sqrt(spread), held)

    def _hidden(self, angles: Array, errors: FrameErrors, unseen: Flags) -> tuple[float, float]:
        """Return standard deviations of elastic and kinetic energy due to unseen rotors [J]."""
        half, (first, second) = self._springs[0], rigidity_bands(self.chain, angles)
        stiffness = self.chain.gathered(half * first**2, half * second**2)
        elastic = float(stiffness[unseen].sum()) * (errors.noise**2 + errors.persistent**2)
        return elastic, float(self._rotors[0, unseen].sum()) * errors.known_rate_noise**2

    def _between(self, walls: list[float]) -> Array:
        before, beyond = -math.inf, math.inf
        if self.chain.periodic and walls:
            rotors = self.chain.number_of_rotors
            before, beyond = walls[-1] - rotors, walls[0] + rotors
        return np.array([before, *walls, beyond])


def _finite(sites: ArrayLike) -> list[float]:
    given: list[float] = sites if isinstance(sites, list) else np.ravel(sites).tolist()
    return sorted(site for site in given if math.isfinite(site))
