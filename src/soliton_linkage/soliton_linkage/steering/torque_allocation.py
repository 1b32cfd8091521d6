# SPDX-License-Identifier: Apache-2.0
"""What actuators on some of the rotors can do to a wall.

A force F along the orbit takes torques tau with t . tau = F. Those of the least norm on the
actuated rotors S are tau_n = F t_n / q, with q = sum of t_n^2 over S. On all rotors q is 1 and
tau is orthogonal to every phonon; on some, what is left of tau strains the springs by

    dphi = R^T (R R^T)^(-1) f / k_e,    R^T f = tau - F t,

which grows without bound where q goes to 0: from an edge as e^(2 x / ell) with the distance x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linear.statics import gram_matrix_bands, min_norm_change
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit

_STEPS_A_SITE = 4
"""How often the way of a wall is looked at [1/site]: on it t_n^2 changes smoothly."""
_LEAST_SHARE = 1e-12
"""q below which no actuator feels the wall [1]: the orbit leaves out all |t_n| < 1e-6."""


@dataclass(frozen=True)
class Effort:
    """What it costs to push a wall with a force at a place.

    torque: largest torque of an actuator [N m].
    strain: largest angle by which the springs give way [rad]; 0 with actuators on all rotors.
    """

    torque: float
    strain: float


@dataclass(frozen=True)
class Reach:
    """Places between which actuators carry a wall that is there [rotor spacings].

    NaN where they cannot hold it at all.
    """

    first: float
    last: float


class TorqueAllocation:
    """Actuators on some rotors of a chain, all if none are named.

    Raises ValueError for a rotor that the chain has not.
    """

    def __init__(
        self,
        orbit: Orbit,
        rotors: tuple[int, ...] = (),
        torque_limit: float = math.inf,
        strain_limit: float = 0.1,
    ) -> None:
        """Limits are for each actuator [N m] and for the springs [rad]."""
        count = orbit.chain.number_of_rotors
        for rotor in rotors:
            if rotor not in range(count):
                raise ValueError(
                    f'actuated rotor {rotor} must be one of 0 to {count - 1}; name rotors of the '
                    'chain, or none for all of them'
                )
        self.orbit = orbit
        self.torque_limit = torque_limit
        self.strain_limit = strain_limit
        self._actuated = np.zeros(count, dtype=bool)
        self._actuated[list(rotors)] = True
        self._everywhere = not rotors or len(set(rotors)) == count
        if self._everywhere:
            self._actuated[:] = True

    def torques(self, arc: float, force: float) -> tuple[Array, float]:
        """Torques [N m], shape (N,), of a force along the orbit [N m], and the force they have.

        All are lowered together where one would be beyond its limit.
        """
        unit = self._unit_torques(self.orbit.tangent(arc))
        wanted = force * unit
        largest = float(np.abs(wanted).max())
        kept = min(1.0, self.torque_limit / largest) if largest > 0 else 1.0
        return kept * wanted, kept * force * float(unit.any())

    def effort(self, arc: float, force: float) -> Effort:
        """Return what it costs to push with a force [N m] at an arc length [rad]."""
        tangent = self.orbit.tangent(arc)
        torques = force * self._unit_torques(tangent)
        if not torques.any() and force:
            return Effort(math.inf, math.inf)
        largest = float(np.abs(torques).max())
        if self._everywhere:
            return Effort(largest, 0.0)
        return Effort(largest, self._strain(arc, torques))

    def carries(self, start: float, goal: float, force: float) -> bool:
        """Whether a force [N m] can be had all the way between two arc lengths [rad]."""
        if self._everywhere and abs(force) <= self.torque_limit:
            return True
        return all(self._has(arc, force) for arc in self._way(start, goal))

    def least_share(self, start: float, goal: float) -> float:
        """Return the least q between two arc lengths [rad], to whose root torques are inverse."""
        if self._everywhere:
            return 1.0
        tangents = np.array([self.orbit.tangent(arc) for arc in self._way(start, goal)])
        return float((tangents[:, self._actuated] ** 2).sum(axis=1).min())

    def reach(self, arc: float, force: float) -> Reach:
        """Places that can be reached from an arc length [rad] on its leg with a force [N m]."""
        orbit = self.orbit
        here, leg = orbit.site(arc), orbit.leg(arc)
        last = orbit.chain.number_of_rotors - 1
        if not self._has(arc, force):
            return Reach(math.nan, math.nan)
        ends = []
        for way, edge in ((-1, 0), (1, last)):
            place = here
            for step in range(1, math.ceil(abs(edge - here) * _STEPS_A_SITE) + 1):
                beyond = here + way * min(step / _STEPS_A_SITE, abs(edge - here))
                if not self._has(orbit.arc_at(beyond, leg), force):
                    break
                place = beyond
            ends.append(place)
        return Reach(*ends)

    def _way(self, start: float, goal: float) -> list[float]:
        """Arc lengths from one to another [rad], a few in every spacing."""
        steps = math.ceil(abs(goal - start) / self.orbit.site_arc * _STEPS_A_SITE)
        return [float(arc) for arc in np.linspace(start, goal, steps + 1)]

    def _has(self, arc: float, force: float) -> bool:
        effort = self.effort(arc, force)
        return effort.torque <= self.torque_limit and effort.strain <= self.strain_limit

    def _unit_torques(self, tangent: Array) -> Array:
        """Least torques of a unit force, 0 where no actuator feels the wall."""
        held = np.where(self._actuated, tangent, 0.0)
        share = float(held @ held)
        return held / share if share > _LEAST_SHARE else 0 * held

    def _strain(self, arc: float, torques: Array) -> float:
        """Largest angle by which the springs give way under torques [rad]."""
        chain = self.orbit.chain
        angles = self.orbit.configuration(arc)
        first, second = rigidity_bands(chain, angles)
        work = first * torques[:-1] + second * torques[1:]
        tensions = solveh_banded(gram_matrix_bands(first, second), work)
        return float(np.abs(min_norm_change(chain, angles, tensions / chain.stiffnesses)).max())
