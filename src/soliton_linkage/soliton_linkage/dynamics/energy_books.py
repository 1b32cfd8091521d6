# SPDX-License-Identifier: Apache-2.0
"""Energy books of a simulation: what all that acts on it gives and takes, each by its own law.

    E(t) = E(0) + sum of W - D,    E = kinetic + elastic + gravitational energy,

where a kick J does the work W = J . (phi_dot before + phi_dot after) / 2, a torque tau that is
held for a period W = tau . (phi after - phi before), gravity that turns at an instant what the
masses then are higher in it, and damping takes D. Rigid bars hold no energy.
"""

from __future__ import annotations

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import Gravity


class EnergyBooks:
    """Acts on a simulation, and adds up the work of it."""

    def __init__(self, simulation: Simulation) -> None:
        """Begin with the energy of the current frame."""
        self.simulation = simulation
        self._springs = not isinstance(simulation, RigidSimulation)
        self._start = self.energy
        self._given = 0.0
        self._largest = abs(self._start)
        self._dissipated_before = simulation.dissipated

    @property
    def energy(self) -> float:
        """Energy that the frame shows, kinetic, elastic and of gravity [J]."""
        chain, angles = self.simulation.chain, self.simulation.angles
        energy = float(chain.kinetic_energy(self.simulation.rates))
        energy += float(self.simulation.gravity.energy(chain, angles))
        return energy + (float(chain.elastic_energy(angles)) if self._springs else 0.0)

    @property
    def imbalance(self) -> float:
        """Energy that is missing or too much, over the largest in any frame so far [1]."""
        energy = self.energy
        taken = self.simulation.dissipated - self._dissipated_before
        missing = self._start + self._given - taken - energy
        largest = max(self._largest, abs(energy))
        return abs(missing) / largest if largest else 0.0

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses [N m s], shape (N,); bars bear what is not along the mode."""
        before = self.simulation.rates
        self.simulation.kick(impulses)
        self._given += float(impulses @ (before + self.simulation.rates)) / 2

    def turn(self, gravity: Gravity) -> None:
        """Change gravity at the instant of the current frame."""
        before = self.energy
        self.simulation.turn_gravity(gravity)
        self._given += self.energy - before

    def advance(self, torques: Array) -> None:
        """Go on by a period under torques [N m], shape (N,)."""
        before = self.simulation.angles
        self.simulation.hold(torques)
        self.simulation.advance()
        self._given += float(torques @ (self.simulation.angles - before))
        self._largest = max(self._largest, abs(self.energy))
