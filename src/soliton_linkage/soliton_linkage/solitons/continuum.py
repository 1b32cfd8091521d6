# SPDX-License-Identifier: Apache-2.0
"""Continuum theories of walls: phi^4 theory for flippers, sine-Gordon theory for spinners.

The theory of flippers is exact in the limit of a small lean ratio d and a small rest angle
theta_bar; the theory of spinners is exact for d far above the critical lean ratio d_c.
The elastic energy density is a square, which is 0 everywhere in a wall of charge Q = +1 at rest. A
wall of velocity v and effective mass M_eff has the width w and the energy E, where w_0 is the
width at rest and c the speed of sound:

    w = w_0 / gamma,    gamma = 1 / sqrt(1 - v^2 / c^2),
    E = (gamma - 1) M_eff c^2 + (1 - Q) E_s,    E_s = M_eff c^2.

Signs and factors apply to the modelled chain. The docstrings state where the paper (Chen et
al., PNAS 111, 13004 (2014)) differs.
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
"""Kick, divided by lambda c with lambda = `arc_per_site`, above which the speed v equals c up to
rounding [1]. For a kick K lambda c, 1 - v / c is about 2 / K^4."""


@dataclass(frozen=True)
class WallTheory(ABC):
    """Theory of relativistic walls in a uniform chain.

    If `exact_sound` is true, c is the exact speed of sound of the chain; the theory then agrees
    better with simulated walls, but E_s = M_eff c^2 holds only in the limit in which the theory is
    exact. Otherwise, c is `limiting_speed_of_sound`. Velocities are in m/s. Methods raise
    ValueError for velocities of c or more, and for charges other than +-1.
    """

    chain: Chain
    exact_sound: bool = True

    @property
    @abstractmethod
    def limiting_speed_of_sound(self) -> float:
        """Speed of sound in the limit in which the theory is exact [m/s]."""

    @property
    @abstractmethod
    def effective_mass(self) -> float:
        """Mass M_eff of a slow wall [kg]."""

    @property
    @abstractmethod
    def energy_scale(self) -> float:
        """Energy E_s [J]; a wall of charge -1 at rest has twice this energy."""

    @property
    def speed_of_sound(self) -> float:
        """Speed of sound c that the Lorentz factor contains [m/s]."""
        if not self.exact_sound:
            return self.limiting_speed_of_sound
        return speed_of_sound(self.chain)

    @property
    def arc_per_site(self) -> float:
        """Norm of all mass displacements per displacement of the wall, sqrt(M_eff / M) [1].

        This ratio lambda equals r Lambda / a, where Lambda is the result of `site_arc`, in the
        limit in which the theory is exact.
        """
        return math.sqrt(self.effective_mass / self.chain.mass)

    def lorentz_factor(self, velocity: float) -> float:
        """Return the Lorentz factor gamma = 1 / sqrt(1 - v^2 / c^2) [1]."""
        ratio = self._ratio(velocity)
        return 1 / math.sqrt((1 - ratio) * (1 + ratio))

    def width(self, velocity: float = 0.0) -> float:
        """Return the width w of the profile tanh(x / w) [m]: width at rest divided by gamma."""
        return self.chain.wall_width / self.lorentz_factor(velocity)

    def kinetic_energy(self, velocity: float) -> float:
        """Return the kinetic energy [J], gamma M_eff v^2 / 2."""
        return self.lorentz_factor(velocity) * self.effective_mass * velocity**2 / 2

    def elastic_energy(self, velocity: float, charge: int = 1) -> float:
        """Return the elastic energy [J], (gamma - 1)^2 / (2 gamma) M_eff c^2 + (1 - Q) E_s."""
        gamma, excess = self.lorentz_factor(velocity), self._excess(velocity)
        moving = self.effective_mass * (self.speed_of_sound * excess) ** 2 / (2 * gamma)
        return moving + (1 - _checked_sign('charge', charge)) * self.energy_scale

    def energy(self, velocity: float, charge: int = 1) -> float:
        """Return the energy of a wall of charge Q [J], (gamma - 1) M_eff c^2 + (1 - Q) E_s."""
        moving = self.effective_mass * self.speed_of_sound**2 * self._excess(velocity)
        return moving + (1 - _checked_sign('charge', charge)) * self.energy_scale

    def speed_after_kick(self, kick: float, arc_per_site: float | None = None) -> float:
        """Return the speed that a kick along the zero mode gives to a wall at rest [m/s].

        `kick` is v_0 = r |phi_dot| [m/s], with the norm |phi_dot| of all rates. With
        lambda = `arc_per_site`, the energy balance M v_0^2 / 2 = (gamma - 1) M lambda^2 c^2 gives
        v = c sqrt(1 - 1 / (1 + v_0^2 / (2 lambda^2 c^2))^2). The argument `arc_per_site` [1]
        replaces the value of the theory.
        """
        arc = self.arc_per_site if arc_per_site is None else arc_per_site
        if not math.isfinite(kick):
            raise ValueError(f'kick = {kick} m/s must be a finite number')
        if not (math.isfinite(arc) and arc > 0):
            raise ValueError(f'arc per site = {arc} must be a finite number above 0')
        # For so hard a kick, v equals c up to rounding. At d = 1, this branch returns 0 for every
        # kick, because the exact c is 0.
        if abs(kick) >= _HARDEST_KICK * arc * self.speed_of_sound:
            return math.copysign(self.speed_of_sound, kick)
        gained = (kick / (arc * self.speed_of_sound)) ** 2 / 2
        speed = self.speed_of_sound * math.sqrt(gained * (2 + gained)) / (1 + gained)
        return math.copysign(speed, kick)

    def _ratio(self, velocity: float) -> float:
        """Return v / c [1]; 0 for a wall at rest, also at d = 1, where the exact c is 0."""
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
        """Return gamma - 1 [1], without cancellation for slow walls."""
        gamma = self.lorentz_factor(velocity)
        return (gamma * self._ratio(velocity)) ** 2 / (gamma + 1)

    def _misfit(self, velocity: float, charge: int) -> float:
        """Return Q gamma - 1 [1].

        Q gamma is the slope of the field in a wall, divided by the slope in a kink at rest where
        the field has the same value.
        """
        excess = self._excess(velocity)
        return excess if _checked_sign('charge', charge) > 0 else -2 - excess

    def _scaled(self, x: ArrayLike, position: float, velocity: float) -> Array:
        given = np.asarray(x, dtype=np.float64)
        scaled: Array = (given - position) / self.width(velocity)
        return scaled

    def _pivots(self) -> Array:
        return self.chain.spacing * np.arange(self.chain.number_of_rotors, dtype=np.float64)


@dataclass(frozen=True)
class FlipperTheory(WallTheory):
    """phi^4 theory of the walls of a flipper. Raises ValueError for a spinner.

    The field is the displacement u = r sin(theta) [m], with the time derivative u_t and the slope
    u_x. With ub = r sin(theta_bar) and K = 4 k_e / lbar^2, the Lagrangian is

        L = (1 / a) integral dx {(M / 2) u_t^2 - (K / 2) [(ub^2 - u^2) + (a^2 / 2) u_x]^2}.

    In the paper (equation `lagrangian2`), the cross term (ub^2 - u^2) u_x is half as large, and
    the factor 1 / a is missing.
    """

    def __post_init__(self) -> None:
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
        """Limit of c for d << 1 and theta_bar << 1, (a^2 / lbar) sqrt(k_e / M) [m/s]."""
        return self.chain.spacing**2 / (self.chain.rest_length * self.chain.time_unit)

    @property
    def effective_mass(self) -> float:
        """Effective mass M_eff = (8 / 3) M (ub / a)^3 [kg]."""
        return 8 / 3 * self.chain.mass * (self.lean / self.chain.spacing) ** 3

    @property
    def energy_scale(self) -> float:
        """Energy E_s = (8 / 3) k_e a ub^3 / lbar^2 [J]."""
        chain = self.chain
        return 8 / 3 * chain.stiffness * chain.spacing * self.lean**3 / chain.rest_length**2

    def displacements(
        self, x: ArrayLike, position: float = 0.0, velocity: float = 0.0, charge: int = 1
    ) -> Array:
        """Return the field u = -Q ub tanh((x - X) / w) [m] at positions x [m], shape (...).

        The wall of charge Q and width w is at `position` X [m]. The equations `width` and `Kink2`
        of the paper are for Q = -1.
        """
        scaled = self._scaled(x, position, velocity)
        return np.asarray(-_checked_sign('charge', charge) * self.lean * np.tanh(scaled))

    def static_slope(self, displacements: ArrayLike) -> Array:
        """Return the slope u' = (2 / a^2) (u^2 - ub^2) [1] in a kink at rest (paper, `phi4_1`)."""
        squares = np.square(np.asarray(displacements, dtype=np.float64))
        return np.asarray(2 / self.chain.spacing**2 * (squares - self.lean**2))

    def elastic_density(self, displacements: ArrayLike, slopes: ArrayLike) -> Array:
        """Return the elastic energy per length, (K / (2 a)) (ub^2 - u^2 + a^2 u' / 2)^2 [J/m]."""
        chain = self.chain
        misfit = np.asarray(slopes) - self.static_slope(displacements)
        stretch = chain.spacing**2 * misfit / chain.rest_length
        return np.asarray(chain.stiffness * stretch**2 / (2 * chain.spacing))

    def kinetic_density(self, rates: ArrayLike) -> Array:
        """Return the kinetic energy per length, (M / (2 a)) u_t^2 [J/m]."""
        return np.asarray(self.chain.mass * np.square(rates) / (2 * self.chain.spacing))

    def extensions(
        self, x: ArrayLike, position: float = 0.0, velocity: float = 0.0, charge: int = 1
    ) -> Array:
        """Return the extensions of springs at x, -(2 / lbar) (Q gamma - 1) (ub^2 - u^2) [m]."""
        squares = self.lean**2 * _sech_squared(self._scaled(x, position, velocity))
        factor = -2 / self.chain.rest_length * self._misfit(velocity, charge)
        return np.asarray(factor * squares)

    def state(
        self, position: float, velocity: float = 0.0, charge: int = 1
    ) -> tuple[Array, Array]:
        """Return angles [rad] and rates [rad/s] of a chain with a wall at a position [m].

        The angles satisfy sin(theta) = u / r, and the even rotors point up. The rates follow from
        u_t = -v u'.
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
    """Sine-Gordon theory of the walls of a spinner. Raises ValueError for a flipper.

    Across a kink, the rotation psi [rad] increases from 0 to pi. When psi increases, phi increases
    for `turn` = +1, and decreases for `turn` = -1. With I = M r^2, ub = r sin(theta_bar) and
    K = k_e r^4 a^2 sin(2 theta_bar)^2 / lbar^2, the Lagrangian is

        L = (1 / a) integral dx {(I / 2) psi_t^2 - (K / 2) [psi_x - sin(psi) / ub]^2}.

    In the paper (supporting information), sin(psi) / ub has an additional factor a.

    A spinner can be assembled in two ways: it cannot move from a state of one way to a state of
    the other way unless springs are stretched. `family` is +1 if the chain is assembled with the
    right-leaning state, in which the staggered angle theta is theta_bar for all rotors, and -1 if
    it is assembled with the left-leaning state, in which theta is -theta_bar. A wall connects two
    uniform states of the same family. Even rotors are the odd sites of the paper.

    - In the family +1, theta is theta_bar + turn psi for even rotors, and theta_bar - turn psi for
      odd rotors. Modulo 2 pi, it changes across a kink from theta_bar to theta_bar + pi.
    - In the family -1, theta is -theta_bar + turn (psi - pi) for even rotors, and
      -theta_bar - turn (psi - pi) for odd rotors. Modulo 2 pi, it changes across a kink from
      pi - theta_bar to -theta_bar.
    """

    family: int = 1
    """Way in which the chain is assembled, +1 or -1; see the class."""

    def __post_init__(self) -> None:
        if self.family not in (-1, 1):
            raise ValueError(f'family = {self.family!r} must be +1 or -1')
        if self.chain.motion is not Motion.SPINNER:
            raise ValueError(
                f'a chain with d = {self.chain.lean_ratio:g} up to d_c = '
                f'{self.chain.critical_lean_ratio:g} is a flipper; use FlipperTheory'
            )

    @property
    def limiting_speed_of_sound(self) -> float:
        """Limit of c for d >> 1, (a r sin(2 theta_bar) / lbar) sqrt(k_e / M) [m/s]."""
        chain = self.chain
        across = chain.rotor_length * math.sin(2 * chain.rest_angle)
        return chain.spacing * across / (chain.rest_length * chain.time_unit)

    @property
    def effective_mass(self) -> float:
        """Effective mass M_eff = 2 I / (a ub) [kg]."""
        return 2 * self.chain.moment_of_inertia / (self.chain.spacing * self.chain.wall_width)

    @property
    def energy_scale(self) -> float:
        """Energy E_s = 2 K / (a ub) [J] with K = `effective_stiffness` and ub = `wall_width`."""
        return 2 * self.effective_stiffness / (self.chain.spacing * self.chain.wall_width)

    @property
    def effective_stiffness(self) -> float:
        """Effective stiffness K = k_e r^4 a^2 sin(2 theta_bar)^2 / lbar^2 [N m^3]."""
        return self.chain.stiffness * self._lever**2

    def rotation(
        self, x: ArrayLike, position: float = 0.0, velocity: float = 0.0, charge: int = 1
    ) -> Array:
        """Return the field psi [rad] at positions x [m], where cos(psi) = -Q tanh((x - X) / w).

        The wall of charge Q and width w is at `position` X [m].
        """
        scaled = _checked_sign('charge', charge) * self._scaled(x, position, velocity)
        return np.asarray(np.pi / 2 + 2 * np.arctan(np.tanh(scaled / 2)))

    def staggered_angles(
        self,
        x: ArrayLike,
        sublattice: int,
        position: float = 0.0,
        velocity: float = 0.0,
        charge: int = 1,
        turn: int = 1,
    ) -> Array:
        """Return the staggered angles theta [rad] of rotors of one sublattice at positions x [m].

        The `sublattice` is 0 for even and 1 for odd rotors. The wall of charge Q and width w is at
        `position` X [m]. The slope theta' is for a wall at rest. In the family +1,

            cos(theta - theta_bar) = -Q tanh((x - X) / w),  theta' = Q sin(theta - theta_bar) / ub,

        and in the family -1,

            cos(theta + theta_bar) = Q tanh((x - X) / w),  theta' = -Q sin(theta + theta_bar) / ub.

        In the paper, equation `sgd` agrees for the family +1, but `sg` has the opposite sign.
        """
        if sublattice not in (0, 1):
            raise ValueError(f'sublattice = {sublattice!r} must be 0 (even rotors) or 1 (odd)')
        sign = _checked_sign('turn', turn) * (-1) ** sublattice
        rotation = self.rotation(x, position, velocity, charge) + self._assembled
        return np.asarray(self.family * self.chain.rest_angle + sign * rotation)

    def static_slope(self, rotation: ArrayLike) -> Array:
        """Return the slope psi' = sin(psi) / (r sin(theta_bar)) in a kink at rest [rad/m]."""
        return np.asarray(np.sin(rotation) / self.chain.wall_width)

    def elastic_density(self, rotation: ArrayLike, slopes: ArrayLike) -> Array:
        """Return the elastic energy per length, (K / (2 a)) [psi' - sin(psi) / ub]^2 [J/m]."""
        misfit = np.asarray(slopes) - self.static_slope(rotation)
        return np.asarray(self.effective_stiffness * misfit**2 / (2 * self.chain.spacing))

    def kinetic_density(self, rates: ArrayLike) -> Array:
        """Return the kinetic energy per length, (I / (2 a)) psi_t^2 [J/m]."""
        inertia = self.chain.moment_of_inertia
        return np.asarray(inertia * np.square(rates) / (2 * self.chain.spacing))

    def extensions(
        self,
        x: ArrayLike,
        position: float = 0.0,
        velocity: float = 0.0,
        charge: int = 1,
        turn: int = 1,
    ) -> Array:
        """Return the extension [m] of springs on the right of even rotors at positions x [m].

        With the lever L = r^2 a sin(2 theta_bar) / lbar, the extension is
        turn * family * L (Q gamma - 1) sin(psi) / ub. Springs on the right of odd rotors have the
        opposite extension.
        """
        sign = _checked_sign('turn', turn) * self.family
        factor = sign * self._lever * self._misfit(velocity, charge)
        slope = self.static_slope(self.rotation(x, position, velocity, charge))
        return np.asarray(factor * slope)

    def state(
        self, position: float, velocity: float = 0.0, charge: int = 1, turn: int = 1
    ) -> tuple[Array, Array]:
        """Return angles [rad] and rates [rad/s] of a chain with a wall at a position [m].

        In the family +1, the angles phi are those of the right-leaning state plus turn psi. In the
        family -1, they are those of the left-leaning state plus turn (psi - pi). The rates follow
        from psi_t = -v psi'.
        """
        pivots = self._pivots()
        rotation = self.rotation(pivots, position, velocity, charge)
        slopes = charge * np.sin(rotation) / self.width(velocity)
        sign = _checked_sign('turn', turn)
        angles = self.chain.uniform_state(self.family) + sign * (rotation + self._assembled)
        return angles, -velocity * sign * slopes

    @property
    def _assembled(self) -> float:
        return 0.0 if self.family > 0 else -math.pi

    @property
    def _lever(self) -> float:
        """Ratio of an extension to psi' - sin(psi) / ub, (r^2 a / lbar) sin(2 theta_bar) [m^2]."""
        chain = self.chain
        across = chain.rotor_length**2 * math.sin(2 * chain.rest_angle)
        return across * chain.spacing / chain.rest_length


def wall_theory(chain: Chain) -> WallTheory:
    """Return the `SpinnerTheory` or the `FlipperTheory` of a chain."""
    return SpinnerTheory(chain) if chain.motion is Motion.SPINNER else FlipperTheory(chain)


def _checked_sign(name: str, sign: int) -> int:
    if sign not in (-1, 1):
        raise ValueError(f'{name} = {sign!r} must be +1 or -1')
    return sign


def _sech_squared(scaled: Array) -> Array:
    tangents = np.tanh(scaled)
    return np.asarray((1 - tangents) * (1 + tangents))
