# SPDX-License-Identifier: Apache-2.0
"""A naive closed orbit: a rigid linkage followed along its zero mode until it returns."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import Edge, mode_towards_last, zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class SampledOrbit:
    """Samples of a closed orbit; the last one equals the first, except for whole turns."""

    chain: Chain
    arcs: Array
    """Arc length of each sample in the metric sum_n (I_n / I) dphi_n^2 [rad], shape (K,)."""
    angles: Array
    """Actual angles [rad], without jumps, shape (K, N)."""

    @property
    def length(self) -> float:
        return float(self.arcs[-1])

    @cached_property
    def directions(self) -> Array:
        """+1 where the wall of a sample moves towards the last rotor, else -1, shape (K,)."""
        return np.array([direction(self.chain, each) for each in self.angles])

    @cached_property
    def reflections(self) -> list[tuple[float, Edge]]:
        """Arc length [rad] and edge of each reflection, found to 1e-10 rad by halving."""
        found = []
        for sample in np.flatnonzero(np.diff(self.directions)):
            before, after = self.arcs[sample : sample + 2].tolist()
            while after - before > 1e-10:
                between = (before + after) / 2
                same = (
                    direction(self.chain, self.configuration(between)) == self.directions[sample]
                )
                before, after = (between, after) if same else (before, between)
            edge = Edge.LAST if self.directions[sample] > 0 else Edge.FIRST
            found.append(((before + after) / 2, edge))
        return found

    def configuration(self, arc: float) -> Array:
        """Angles at an arc length within the orbit [rad], shape (N,)."""
        return unstretched(self.chain, np.asarray(self._spline(arc % self.length)))

    @cached_property
    def _spline(self) -> BSpline:
        return make_interp_spline(self.arcs, self.angles, k=7)


def closed_orbit(chain: Chain, start: Array, spacing: float = 0.05) -> SampledOrbit:
    """Follow the linkage from a configuration until it returns, in samples of arc length [rad]."""
    begin = unstretched(chain, start)
    simulation = RigidSimulation(chain, begin, tangent(chain, begin), period=spacing)
    samples, left = [simulation.angles], -math.inf
    while not abs(left) <= spacing / 2:
        assert len(samples) < 100_000, 'the orbit does not close'
        simulation.advance()
        samples.append(simulation.angles)
        along, distance = apart(chain, samples[-1], begin)
        left = along if distance < 1.5 * abs(along) + 1e-3 * spacing else math.inf
    if left < spacing / 2:
        left += spacing
        samples.pop()
    last_step = RigidSimulation(chain, samples[-1], tangent(chain, samples[-1]), period=left)
    last_step.advance()
    left += apart(chain, last_step.angles, begin)[0]
    turns = np.round((samples[-1] - begin) / (2 * math.pi))
    arcs = spacing * np.arange(len(samples), dtype=np.float64)
    closed = [*samples, begin + 2 * math.pi * turns]
    return SampledOrbit(chain, np.append(arcs, arcs[-1] + left), np.array(closed))


def direction(chain: Chain, angles: Array) -> int:
    """+1 where the wall moves along the zero mode towards the last rotor, else -1."""
    return 1 if float(mode_towards_last(chain, angles) @ zero_mode(chain, angles)) > 0 else -1


def tangent(chain: Chain, angles: Array) -> Array:
    """Unit vector along the orbit in the metric of the inertia, shape (N,)."""
    mode = zero_mode(chain, angles)
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    return np.asarray(mode / math.sqrt(float(weights @ mode**2)))


def apart(chain: Chain, angles: Array, goal: Array) -> tuple[float, float]:
    """Distance to a configuration along the orbit and in all, up to turns of rotors [rad]."""
    difference = np.remainder(goal - angles + math.pi, 2 * math.pi) - math.pi
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    along = float((weights * tangent(chain, angles)) @ difference)
    return along, math.sqrt(float(weights @ difference**2))
