# SPDX-License-Identifier: Apache-2.0
"""Naive energy balance of a simulation, from its energies and the work of its inputs."""

from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.dynamics.work import work_of_kick, work_of_torques
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import Gravity


class EnergyBalance:
    """Energy balance of a simulation: work of all inputs compared with the energy of its frames.

    E(t) = E(0) + sum of W - D,    E = kinetic + elastic + gravitational energy,

    where D is the energy dissipated by damping. The work of an instantaneous change of gravity is
    the change of the gravitational energy. Rigid bars store no energy.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Start the balance with the energy of the current frame."""
        self.simulation = simulation
        self._start = simulation.energy
        self._given = 0.0
        self._largest = abs(self._start)
        self._dissipated_before = simulation.dissipated

    @property
    def imbalance(self) -> float:
        """Absolute energy imbalance, relative to the largest energy of any frame so far [1]."""
        energy = self.simulation.energy
        taken = self.simulation.dissipated - self._dissipated_before
        missing = self._start + self._given - taken - energy
        largest = max(self._largest, abs(energy))
        return abs(missing) / largest if largest else 0.0

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses [N m s], (N,); bars absorb components normal to the mode."""
        before = self.simulation.rates
        self.simulation.kick(impulses)
        self._given += work_of_kick(impulses, before, self.simulation.rates)

    def turn(self, gravity: Gravity) -> None:
        """Change gravity at the time of the current frame."""
        before = self.simulation.energy
        self.simulation.set_gravity(gravity)
        self._given += self.simulation.energy - before

    def advance(self, torques: Array) -> None:
        """Advance by one period under torques [N m], shape (N,)."""
        before = self.simulation.angles
        self.simulation.hold(torques)
        self.simulation.advance()
        self._given += work_of_torques(torques, self.simulation.angles - before)
        self._largest = max(self._largest, abs(self.simulation.energy))
