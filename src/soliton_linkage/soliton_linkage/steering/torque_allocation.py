# SPDX-License-Identifier: Apache-2.0
"""Torques of actuators that exert a given force on a wall; each actuator acts on one rotor.

Let t be the tangent of the orbit. To exert a force F along the orbit, the torques tau must satisfy
t^T tau = F. The torques of least norm on a set S of rotors are tau_n = F t_n / q, with the
coupling q = sum of t_n^2 over S. If S is not the whole chain, the torques also deflect the rotors
against the springs. The deflection is

    dphi = R^T (R R^T)^(-1) f / k_e,    R^T f = tau - F t,

with the spring forces f, the rigidity matrix R and the stiffness k_e. If the actuators are at an
edge, the deflection grows as e^(2 x / ell), with the distance x of the wall from the edge and the
penetration depth ell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linear.statics import gram_matrix_bands, min_norm_change
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit

_SAMPLES_PER_SITE = 4
"""Number of positions per rotor spacing at which a path is checked [1]."""
_MIN_COUPLING = 1e-12
"""Actuators count as having no effect if their coupling q is smaller than this [1]."""


class Effort(NamedTuple):
    """Largest torque of an actuator [N m], and largest deflection of a rotor [rad].

    The deflection is against the springs; it is 0 if all rotors are actuated.
    """

    torque: float
    strain: float


class Reach(NamedTuple):
    """Range of sites to which actuators can move a wall [rotor spacings].

    Both limits are NaN if the actuators cannot hold the wall where it is.
    """

    first: float
    last: float


class TorqueAllocation:
    """Allocation of torques to actuators on the given rotors, or on every rotor if none are given.

    `torque_limit` limits the torque of each actuator [N m], and `strain_limit` limits the
    deflection of a rotor against the springs [rad]. Raises ValueError for an unknown rotor.
    """

    def __init__(
        self,
        orbit: Orbit,
        rotors: tuple[int, ...] = (),
        torque_limit: float = math.inf,
        strain_limit: float = 0.1,
    ) -> None:
        count = orbit.chain.number_of_rotors
        for rotor in rotors:
            if rotor not in range(count):
                raise ValueError(
                    f'actuated rotor {rotor} must be one of 0 to {count - 1}; specify rotors of '
                    'the chain, or none to actuate all of them'
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
        """Return the torques [N m] for a force on a wall at an arc length, and the exerted force.

        If a torque exceeds its limit, all torques and the force [N m] are reduced by one factor.
        """
        unit = self._unit_torques(self.orbit.tangent(arc))
        required = force * unit
        largest = float(np.abs(required).max())
        scale = min(1.0, self.torque_limit / largest) if largest > 0 else 1.0
        return scale * required, scale * force * float(unit.any())

    def effort(self, arc: float, force: float) -> Effort:
        """Return the effort for a force [N m] on a wall at an arc length [rad]."""
        tangent = self.orbit.tangent(arc)
        torques = force * self._unit_torques(tangent)
        if not torques.any() and force:
            return Effort(math.inf, math.inf)
        largest = float(np.abs(torques).max())
        if self._everywhere:
            return Effort(largest, 0.0)
        chain, angles = self.orbit.chain, self.orbit.configuration(arc)
        first, second = rigidity_bands(chain, angles)
        work = first * torques[:-1] + second * torques[1:]
        tensions = solveh_banded(gram_matrix_bands(first, second), work)
        strains = min_norm_change(chain, angles, tensions / chain.stiffnesses)
        return Effort(largest, float(np.abs(strains).max()))

    def can_move(self, start: float, goal: float, force: float) -> bool:
        """Return whether a force [N m] can be exerted everywhere between two arc lengths [rad]."""
        if self._everywhere and abs(force) <= self.torque_limit:
            return True
        return all(self._is_available(arc, force) for arc in self._path(start, goal))

    def min_coupling(self, start: float, goal: float) -> float:
        """Return the smallest coupling q between two arc lengths [rad]."""
        if self._everywhere:
            return 1.0
        tangents = np.array([self.orbit.tangent(arc) for arc in self._path(start, goal)])
        return float((tangents[:, self._actuated] ** 2).sum(axis=1).min())

    def reach(self, arc: float, force: float) -> Reach:
        """Return the sites to which a force [N m] can move a wall from an arc length [rad].

        The result refers to the leg of the orbit that contains `arc`.
        """
        orbit = self.orbit
        here, leg = orbit.site(arc), orbit.leg(arc)
        last = orbit.chain.number_of_rotors - 1
        if not self._is_available(arc, force):
            return Reach(math.nan, math.nan)
        ends = []
        for direction, edge in ((-1, 0), (1, last)):
            site = here
            for step in range(1, math.ceil(abs(edge - here) * _SAMPLES_PER_SITE) + 1):
                beyond = here + direction * min(step / _SAMPLES_PER_SITE, abs(edge - here))
                if not self._is_available(orbit.arc_at(beyond, leg), force):
                    break
                site = beyond
            ends.append(site)
        return Reach(*ends)

    def _path(self, start: float, goal: float) -> list[float]:
        steps = math.ceil(abs(goal - start) / self.orbit.site_arc * _SAMPLES_PER_SITE)
        return [float(arc) for arc in np.linspace(start, goal, steps + 1)]

    def _is_available(self, arc: float, force: float) -> bool:
        effort = self.effort(arc, force)
        return effort.torque <= self.torque_limit and effort.strain <= self.strain_limit

    def _unit_torques(self, tangent: Array) -> Array:
        actuated = np.where(self._actuated, tangent, 0.0)
        coupling = float(actuated @ actuated)
        return actuated / coupling if coupling > _MIN_COUPLING else 0 * actuated
