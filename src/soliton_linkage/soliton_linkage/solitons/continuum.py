# SPDX-License-Identifier: Apache-2.0
"""Continuum theories of the wall: phi^4 for flippers with d << 1, sine-Gordon for d >> d_c.

Both have a density of energy that is a perfect square, so that the wall of charge Q = +1, which
leans right on the side of rotor 0 and left beyond, is free at rest, while that of Q = -1 costs
2 E_s. Both are invariant under Lorentz boosts with the speed of sound c,

    w = w_0 / gamma,    gamma = 1 / sqrt(1 - v^2 / c^2),
    E = (gamma - 1) M_eff c^2 + (1 - Q) E_s,    E_s = M_eff c^2.

Signs and factors are those of the chain; where the paper has others (eqs. flip_discrete, width,
lagrangian2, sg and their kin) the docstrings say so.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered

_HARDEST_KICK = 1e9
"""Kick in units of Lambda c [1] from which the speed is c, but for 2 / kick^4 of it."""


@dataclass(frozen=True)
class WallTheory(ABC):
    """A relativistic wall of a uniform chain.

    By default c is the exact speed of sound, a sqrt|q+ q-| / r in units of sqrt(k_e / M), with
    which contraction, speed and energy of simulated walls agree better than with the limit that
    the theory itself has; with the latter its equations hold exactly and E_s = M_eff c^2. Speeds
    are in [m/s]; those that are not below c, or not finite, raise ValueError, as do charges
    other than +-1.
    """

    chain: Chain
    exact_sound: bool = True

    @property
    @abstractmethod
    def limiting_speed_of_sound(self) -> float:
        """Speed of sound where the theory is exact [m/s]."""

    @property
    @abstractmethod
    def effective_mass(self) -> float:
        """Mass M_eff of a slow wall [kg]."""

    @property
    @abstractmethod
    def energy_scale(self) -> float:
        """Energy E_s [J], half of what a wall of charge -1 costs at rest."""

    @property
    def speed_of_sound(self) -> float:
        """Speed c of the boosts [m/s], exact or limiting."""
        if not self.exact_sound:
            return self.limiting_speed_of_sound
        return speed_of_sound(self.chain)

    @property
    def arc_per_site(self) -> float:
        """Length Lambda of the motion of all masses while the wall goes on by a, over a [1].

        A slow wall has the mass M_eff = M Lambda^2.
        """
        return math.sqrt(self.effective_mass / self.chain.mass)

    def lorentz_factor(self, velocity: float) -> float:
        """Return gamma = 1 / sqrt(1 - v^2 / c^2)."""
        ratio = self._ratio(velocity)
        return 1 / math.sqrt((1 - ratio) * (1 + ratio))

    def width(self, velocity: float = 0.0) -> float:
        """Width w of tanh(x / w) [m], contracted by the Lorentz factor."""
        return self.chain.wall_width / self.lorentz_factor(velocity)

    def kinetic_energy(self, velocity: float) -> float:
        """Energy in motion [J], gamma M_eff v^2 / 2."""
        return self.lorentz_factor(velocity) * self.effective_mass * velocity**2 / 2

    def elastic_energy(self, velocity: float, charge: int = 1) -> float:
        """Energy in the springs [J], (gamma - 1)^2 / (2 gamma) M_eff c^2 + (1 - Q) E_s.

        For Q = +1 it is (gamma - 1) / (gamma + 1) of that in motion.
        """
        gamma, excess = self.lorentz_factor(velocity), self._excess(velocity)
        moving = self.effective_mass * (self.speed_of_sound * excess) ** 2 / (2 * gamma)
        return moving + (1 - _checked_charge(charge)) * self.energy_scale

    def energy(self, velocity: float, charge: int = 1) -> float:
        """Energy of the wall [J], (gamma - 1) M_eff c^2 + (1 - Q) E_s."""
        moving = self.effective_mass * self.speed_of_sound**2 * self._excess(velocity)
        return moving + (1 - _checked_charge(charge)) * self.energy_scale

    def speed_after_kick(self, kick: float, arc_per_site: float | None = None) -> float:
        """Speed of a wall set going by a kick along the zero mode [m/s].

        The masses get the speed v_0 = r |phi_dot| [m/s] (norm over the rotors) and the energy
        M v_0^2 / 2 = (gamma - 1) M Lambda^2 c^2, so that

            v = c sqrt(1 - 1 / (1 + v_0^2 / (2 Lambda^2 c^2))^2),

        which tends to v_0 / Lambda for slow walls and rigid bars. Lambda [1] is the exact arc
        length of the motion by one site over a, where it is known, or else that of the theory.
        """
        arc = self.arc_per_site if arc_per_site is None else arc_per_site
        if not math.isfinite(kick):
            raise ValueError(f'kick = {kick} m/s must be a finite number')
        if not (math.isfinite(arc) and arc > 0):
            raise ValueError(f'arc per site = {arc} must be a finite number above 0')
        # From there on v is c to rounding, as it is for all kicks at d = 1, where c vanishes.
        if abs(kick) >= _HARDEST_KICK * arc * self.speed_of_sound:
            return math.copysign(self.speed_of_sound, kick)
        gained = (kick / (arc * self.speed_of_sound)) ** 2 / 2
        speed = self.speed_of_sound * math.sqrt(gained * (2 + gained)) / (1 + gained)
        return math.copysign(speed, kick)

    def _ratio(self, velocity: float) -> float:
        """Return v / c; walls at rest have 0 even at d = 1, where c vanishes."""
        if velocity == 0:
            return 0.0
        speed_of_sound = self.speed_of_sound
        if not abs(velocity) < speed_of_sound:
            raise ValueError(
                f'velocity = {velocity:g} m/s must stay below the speed of sound, '
                f'{speed_of_sound:g} m/s; slow the wall down or stiffen the springs'
            )
        return velocity / speed_of_sound

    def _excess(self, velocity: float) -> float:
        """Return gamma - 1, without cancellation for slow walls."""
        gamma = self.lorentz_factor(velocity)
        return (gamma * self._ratio(velocity)) ** 2 / (gamma + 1)

    def _misfit(self, velocity: float, charge: int) -> float:
        """Return Q gamma - 1, by how much the slope differs from that of a wall at rest."""
        excess = self._excess(velocity)
        return excess if _checked_charge(charge) > 0 else -2 - excess

    def _scaled(self, places: ArrayLike, position: float, velocity: float) -> Array:
        """Distance of places from the wall in its widths [1]."""
        given = np.asarray(places, dtype=np.float64)
        scaled: Array = (given - position) / self.width(velocity)
        return scaled

    def _pivots(self) -> Array:
        return self.chain.spacing * np.arange(self.chain.number_of_rotors, dtype=np.float64)


@dataclass(frozen=True)
class FlipperTheory(WallTheory):
    """phi^4 theory of a flipper's wall in the displacement u = r sin(theta) [m], for d << 1.

    L = (1 / a) integral dx {(M / 2) u_t^2 - (K / 2) [(ub^2 - u^2) + (a^2 / 2) u_x]^2} with
    ub = r sin(theta_bar) and K = 4 k_e / lbar^2 (paper, eq. lagrangian2 with twice its cross
    term and the 1 / a of a sum over sites). Raises ValueError for a spinner.
    """

    def __post_init__(self) -> None:
        """Refuse a spinner."""
        if self.chain.motion is Motion.SPINNER:
            raise ValueError(
                f'a chain with d = {self.chain.lean_ratio:g} above d_c = '
                f'{self.chain.critical_lean_ratio:g} is a spinner; use SpinnerTheory'
            )

    @property
    def lean(self) -> float:
        """Displacement ub = r sin(theta_bar) of the right-leaning state [m]."""
        return self.chain.rotor_length * math.sin(self.chain.rest_angle)

    @property
    def limiting_speed_of_sound(self) -> float:
        """Limit of c for d << 1 [m/s], a^2 / lbar sqrt(k_e / M)."""
        return self.chain.spacing**2 / (self.chain.rest_length * self.chain.time_unit)

    @property
    def effective_mass(self) -> float:
        """M_eff = (8 / 3) M (ub / a)^3 [kg]."""
        return 8 / 3 * self.chain.mass * (self.lean / self.chain.spacing) ** 3

    @property
    def energy_scale(self) -> float:
        """E_s = (8 / 3) k_e a ub^3 / lbar^2 [J]."""
        chain = self.chain
        return 8 / 3 * chain.stiffness * chain.spacing * self.lean**3 / chain.rest_length**2

    def displacements(
        self, places: ArrayLike, position: float = 0.0, velocity: float = 0.0, charge: int = 1
    ) -> Array:
        """Field u = -Q ub tanh((x - X) / w) [m] at places x [m], shape (...).

        The paper (eqs. width and Kink2) has the sign of Q = -1, which costs energy.
        """
        scaled = self._scaled(places, position, velocity)
        return np.asarray(-_checked_charge(charge) * self.lean * np.tanh(scaled))

    def static_slope(self, displacements: ArrayLike) -> Array:
        """Slope of a wall at rest, u' = (2 / a^2) (u^2 - ub^2) [1] (paper, eq. phi4_1)."""
        squares = np.square(np.asarray(displacements, dtype=np.float64))
        return np.asarray(2 / self.chain.spacing**2 * (squares - self.lean**2))

    def elastic_density(self, displacements: ArrayLike, slopes: ArrayLike) -> Array:
        """Elastic energy per length [J/m], (K / 2 a) [(ub^2 - u^2) + (a^2 / 2) u']^2."""
        chain = self.chain
        misfit = np.asarray(slopes) - self.static_slope(displacements)
        stretch = chain.spacing**2 * misfit / chain.rest_length
        return np.asarray(chain.stiffness * stretch**2 / (2 * chain.spacing))

    def kinetic_density(self, rates: ArrayLike) -> Array:
        """Kinetic energy per length [J/m], (M / 2 a) u_t^2."""
        return np.asarray(self.chain.mass * np.square(rates) / (2 * self.chain.spacing))

    def extensions(
        self, places: ArrayLike, position: float = 0.0, velocity: float = 0.0, charge: int = 1
    ) -> Array:
        """Extension of the springs at places x [m], -(2 / lbar) (Q gamma - 1) (ub^2 - u^2) [m].

        A moving wall of charge +1 compresses them, one of charge -1 stretches them even at rest.
        """
        squares = self.lean**2 * _sech_squared(self._scaled(places, position, velocity))
        factor = -2 / self.chain.rest_length * self._misfit(velocity, charge)
        return np.asarray(factor * squares)

    def state(
        self, position: float, velocity: float = 0.0, charge: int = 1
    ) -> tuple[Array, Array]:
        """Angles [rad] and rates [rad/s] of a chain with a wall at X [m], each (N,).

        From sin(theta) = u / r with the even rotors up, and u_t = -v u'.
        """
        chain, pivots = self.chain, self._pivots()
        displacements = self.displacements(pivots, position, velocity, charge)
        theta = np.arcsin(displacements / chain.rotor_length)
        steepness = _sech_squared(self._scaled(pivots, position, velocity))
        slopes = -charge * self.lean / self.width(velocity) * steepness
        turning = -velocity * slopes / (chain.rotor_length * np.cos(theta))
        return staggered(theta), turning * (-1.0) ** np.arange(chain.number_of_rotors)


@dataclass(frozen=True)
class SpinnerTheory(WallTheory):
    """Sine-Gordon theory of a spinner's wall in the angle psi [rad] that rotors have turned.

    A rotor turns from theta_bar by psi from 0 to pi, forwards in its actual angle (turn +1) or
    backwards (-1): with staggered angles theta = theta_bar + turn psi on rotors 0, 2, ... (the
    paper's odd sites) and theta_bar - turn psi on the others. With I = M r^2, ub = r
    sin(theta_bar) and K = k_e r^4 a^2 sin(2 theta_bar)^2 / lbar^2,

        L = (1 / a) integral dx {(I / 2) psi_t^2 - (K / 2) [psi_x - sin(psi) / ub]^2}

    (paper, supporting information, without its factor a in the last term). A chain can be
    assembled as a spinner in two ways: rotors of the family +1 pass from theta_bar to the
    left-leaning state pi + theta_bar, those of -1 from -theta_bar - pi to -theta_bar, so that
    psi - pi and -theta_bar stand in for psi and theta_bar. Raises ValueError for a flipper.
    """

    family: int = 1

    def __post_init__(self) -> None:
        """Refuse a flipper, and a family that there is not."""
        if self.family not in (-1, 1):
            raise ValueError(f'family = {self.family!r} must be +1 or -1')
        if self.chain.motion is not Motion.SPINNER:
            raise ValueError(
                f'a chain with d = {self.chain.lean_ratio:g} up to d_c = '
                f'{self.chain.critical_lean_ratio:g} is a flipper; use FlipperTheory'
            )

    @property
    def limiting_speed_of_sound(self) -> float:
        """Limit of c for d >> 1 [m/s], sqrt(K / I) = a r sin(2 theta_bar) / lbar sqrt(k_e / M)."""
        chain = self.chain
        across = chain.rotor_length * math.sin(2 * chain.rest_angle)
        return chain.spacing * across / (chain.rest_length * chain.time_unit)

    @property
    def effective_mass(self) -> float:
        """M_eff = 2 I / (a ub) [kg]."""
        return 2 * self.chain.moment_of_inertia / (self.chain.spacing * self.chain.wall_width)

    @property
    def energy_scale(self) -> float:
        """E_s = 2 K / (a ub) [J]."""
        return 2 * self.effective_stiffness / (self.chain.spacing * self.chain.wall_width)

    @property
    def effective_stiffness(self) -> float:
        """K = k_e r^4 a^2 sin(2 theta_bar)^2 / lbar^2 [N m^3]."""
        return self.chain.stiffness * self._lever**2

    def turned(
        self, places: ArrayLike, position: float = 0.0, velocity: float = 0.0, charge: int = 1
    ) -> Array:
        """Angle psi turned at places x [m], cos(psi) = -Q tanh((x - X) / w), 0 to pi, (...)."""
        scaled = _checked_charge(charge) * self._scaled(places, position, velocity)
        return np.asarray(np.pi / 2 + 2 * np.arctan(np.tanh(scaled / 2)))

    def staggered_angles(
        self,
        places: ArrayLike,
        sublattice: int,
        position: float = 0.0,
        velocity: float = 0.0,
        charge: int = 1,
        turn: int = 1,
    ) -> Array:
        """Field theta [rad] of rotors 0, 2, ... (sublattice 0) or 1, 3, ... (1) at places [m].

        On both cos(theta - theta_bar) = -Q tanh((x - X) / w), and at rest
        theta' = Q sin(theta - theta_bar) / (r sin(theta_bar)) (paper, eq. sg with the opposite
        sign, and eq. sgd). In the family -1 both have -theta_bar and the opposite sign.
        """
        if sublattice not in (0, 1):
            raise ValueError(f'sublattice = {sublattice!r} must be 0 (even rotors) or 1 (odd)')
        sign = _checked_turn(turn) * (-1) ** sublattice
        turned = self.turned(places, position, velocity, charge) + self._assembled
        return np.asarray(self.family * self.chain.rest_angle + sign * turned)

    def static_slope(self, turned: ArrayLike) -> Array:
        """Slope of a wall at rest, psi' = sin(psi) / (r sin(theta_bar)) [rad/m]."""
        return np.asarray(np.sin(turned) / self.chain.wall_width)

    def elastic_density(self, turned: ArrayLike, slopes: ArrayLike) -> Array:
        """Elastic energy per length [J/m], (K / 2 a) [psi' - sin(psi) / ub]^2."""
        misfit = np.asarray(slopes) - self.static_slope(turned)
        return np.asarray(self.effective_stiffness * misfit**2 / (2 * self.chain.spacing))

    def kinetic_density(self, rates: ArrayLike) -> Array:
        """Kinetic energy per length [J/m], (I / 2 a) psi_t^2."""
        inertia = self.chain.moment_of_inertia
        return np.asarray(inertia * np.square(rates) / (2 * self.chain.spacing))

    def extensions(
        self,
        places: ArrayLike,
        position: float = 0.0,
        velocity: float = 0.0,
        charge: int = 1,
        turn: int = 1,
    ) -> Array:
        """Extension of the springs right of even rotors at places x [m], shape (...) [m].

        turn (r^2 a sin(2 theta_bar) / lbar) (Q gamma - 1) sin(psi) / ub; those right of odd
        rotors have the opposite one, as have those of the family -1.
        """
        sign = _checked_turn(turn) * self.family
        factor = sign * self._lever * self._misfit(velocity, charge)
        slope = self.static_slope(self.turned(places, position, velocity, charge))
        return np.asarray(factor * slope)

    def state(
        self, position: float, velocity: float = 0.0, charge: int = 1, turn: int = 1
    ) -> tuple[Array, Array]:
        """Angles [rad] and rates [rad/s] of a chain with a wall at X [m], each (N,).

        All turn together, phi = phi_uniform + turn psi, and psi_t = -v psi'.
        """
        pivots = self._pivots()
        turned = self.turned(pivots, position, velocity, charge)
        slopes = charge * np.sin(turned) / self.width(velocity)
        sign = _checked_turn(turn)
        angles = self.chain.uniform_state(self.family) + sign * (turned + self._assembled)
        return angles, -velocity * sign * slopes

    @property
    def _assembled(self) -> float:
        """Angle of the family's first rotors where psi is 0 [rad], from +-theta_bar."""
        return 0.0 if self.family > 0 else -math.pi

    @property
    def _lever(self) -> float:
        """Extension over the misfit of the slope, r^2 a sin(2 theta_bar) / lbar [m^2]."""
        chain = self.chain
        across = chain.rotor_length**2 * math.sin(2 * chain.rest_angle)
        return across * chain.spacing / chain.rest_length


def wall_theory(chain: Chain) -> WallTheory:
    """Theory of the walls of a chain, by its class of motion."""
    return SpinnerTheory(chain) if chain.motion is Motion.SPINNER else FlipperTheory(chain)


def _checked_charge(charge: int) -> int:
    if charge not in (-1, 1):
        raise ValueError(f'charge = {charge!r} must be +1 or -1')
    return charge


def _checked_turn(turn: int) -> int:
    if turn not in (-1, 1):
        raise ValueError(f'turn = {turn!r} must be +1 (forwards) or -1 (backwards)')
    return turn


def _sech_squared(scaled: Array) -> Array:
    tangents = np.tanh(scaled)
    return np.asarray((1 - tangents) * (1 + tangents))
