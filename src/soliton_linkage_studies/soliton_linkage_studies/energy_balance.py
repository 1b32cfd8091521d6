# SPDX-License-Identifier: Apache-2.0
"""The energy of a simulation's frames against the work of all that acts on it."""

from __future__ import annotations

from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.dynamics.work import work_of_kick, work_of_torques
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import Gravity


class EnergyBalance:
    """Acts on a simulation, and holds the work of all that acts against the energy of its frames.

    E(t) = E(0) + sum of W - D,    E = kinetic + elastic + gravitational energy,

    where gravity that turns at an instant does as work what the masses then are higher in it, and
    damping takes D. Rigid bars hold no energy.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Begin with the energy of the current frame."""
        self.simulation = simulation
        self._start = simulation.energy
        self._given = 0.0
        self._largest = abs(self._start)
        self._dissipated_before = simulation.dissipated

    @property
    def imbalance(self) -> float:
        """Energy that is missing or too much, over the largest in any frame so far [1]."""
        energy = self.simulation.energy
        taken = self.simulation.dissipated - self._dissipated_before
        missing = self._start + self._given - taken - energy
        largest = max(self._largest, abs(energy))
        return abs(missing) / largest if largest else 0.0

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses [N m s], shape (N,); bars bear what is not along the mode."""
        before = self.simulation.rates
        self.simulation.kick(impulses)
        self._given += work_of_kick(impulses, before, self.simulation.rates)

    def turn(self, gravity: Gravity) -> None:
        """Change gravity at the instant of the current frame."""
        before = self.simulation.energy
        self.simulation.turn_gravity(gravity)
        self._given += self.simulation.energy - before

    def advance(self, torques: Array) -> None:
        """Go on by a period under torques [N m], shape (N,)."""
        before = self.simulation.angles
        self.simulation.hold(torques)
        self.simulation.advance()
        self._given += work_of_torques(torques, self.simulation.angles - before)
        self._largest = max(self._largest, abs(self.simulation.energy))
