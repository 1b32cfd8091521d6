# SPDX-License-Identifier: Apache-2.0
"""The closed orbit of a linkage: all that its bars allow, as a wall goes round its cycle.

The configurations that a chain of rigid bars can reach form a closed curve, along which the wall
runs to and fro: four legs for flippers, each of whose reflections toggles an edge rotor, two for
spinners, whose edge rotors turn through 2 pi instead. The arc length along it is weighted by the
inertia, sqrt(sum_n I_n dphi_n^2 / I) with I = M r^2 of the chain's parameters, so that free
motion has constant speed; without deviations it is that of the angles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from soliton_linkage.actuation import Edge
from soliton_linkage.chain import Array, Chain
from soliton_linkage.rigid_simulation import RigidSimulation
from soliton_linkage.rigidity import mode_towards_last, zero_mode
from soliton_linkage.statics import unstretched

_MOST_SAMPLES = 1_000_000
_COINCIDENT = 1e-3


@dataclass(frozen=True)
class Orbit:
    """A closed orbit in samples; its last one is the first, but for whole turns of rotors."""

    chain: Chain
    """The chain whose orbit it is."""
    arcs: Array
    """Arc length of each sample [rad], from 0 to that of the whole orbit, shape (K,)."""
    angles: Array
    """Actual angles [rad], without jumps, shape (K, N)."""

    @property
    def length(self) -> float:
        """Arc length of the whole orbit [rad]."""
        return float(self.arcs[-1])

    @cached_property
    def turns(self) -> Array:
        """Whole turns that each rotor makes in a cycle, shape (N,): 0 for flippers."""
        return np.asarray(np.round((self.angles[-1] - self.angles[0]) / (2 * math.pi)))

    @cached_property
    def directions(self) -> Array:
        """+1 where the wall of a sample runs on towards the last rotor, else -1, shape (K,)."""
        towards = [
            mode_towards_last(self.chain, each) @ zero_mode(self.chain, each)
            for each in self.angles
        ]
        return np.sign(towards)

    @cached_property
    def reflections(self) -> tuple[tuple[float, Edge], ...]:
        """Arc length [rad] and edge of each reflection of the wall, in the order of the cycle.

        A flipper's is where its edge rotor passes the line from its pivot to its neighbour's
        mass, a spinner's where the sum of all horizontal positions turns back.
        """
        turning = np.flatnonzero(np.diff(self.directions))
        return tuple(
            (
                float(self.arcs[sample] + self.arcs[sample + 1]) / 2,
                Edge.LAST if self.directions[sample] > 0 else Edge.FIRST,
            )
            for sample in turning
        )

    def configuration(self, arc: float) -> Array:
        """Angles at an arc length [rad], every bar at its length, shape (N,).

        The arc may be any number; each cycle adds the turns that the rotors make in it.
        """
        cycles, within = divmod(arc, self.length)
        between = unstretched(self.chain, np.asarray(self._spline(within)))
        return between + 2 * math.pi * cycles * self.turns

    @cached_property
    def _spline(self) -> CubicHermiteSpline:
        tangents = [_tangent(self.chain, each) for each in self.angles]
        return CubicHermiteSpline(self.arcs, self.angles, np.array(tangents))


def closed_orbit(chain: Chain, start: Array, spacing: float = 0.05) -> Orbit:
    """Follow the linkage from a configuration until it returns, in samples of arc length [rad].

    Starts in the direction of the zero mode; the samples are evenly spaced but for the last.
    Raises ValueError for a spacing that is not above 0, and as `RigidSimulation` does.
    """
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f'spacing = {spacing} rad must be a finite number above 0')
    begin = unstretched(chain, start)
    tangent = _tangent(chain, begin)
    simulation = RigidSimulation(chain, begin, tangent, period=spacing)
    samples, left = [simulation.angles], -math.inf
    while not 0 <= left + _COINCIDENT * spacing <= spacing:
        if len(samples) > _MOST_SAMPLES:
            raise ValueError(
                f'the orbit did not close within {_MOST_SAMPLES} samples {spacing} rad apart; '
                'take a larger spacing'
            )
        simulation.advance()
        samples.append(simulation.angles)
        left = _to_go(chain, samples[-1], begin)
    if left < _COINCIDENT * spacing:
        left += spacing
        samples.pop()
    turns = np.round((samples[-1] - begin) / (2 * math.pi))
    arcs = spacing * np.arange(len(samples), dtype=np.float64)
    closed = [*samples, begin + 2 * math.pi * turns]
    return Orbit(chain, np.append(arcs, arcs[-1] + left), np.array(closed))


def toggled_angle(chain: Chain, angles: Array, edge: Edge) -> float:
    """Angle of the edge rotor that is its reflection at the line to its neighbour's mass [rad].

    phi_t = 2 psi - phi, with psi the direction from the pivot of the edge rotor to the mass of
    its neighbour. The bar between them has the same length, and a wall that is reflected leaves
    the edge rotor there.
    """
    rotor, neighbour = (-1, -2) if edge is Edge.LAST else (0, 1)
    offset = float(chain.spacings[rotor]) * (-1 if edge is Edge.LAST else 1)
    horizontal, vertical = chain.positions(angles)
    towards = math.atan2(offset + float(horizontal[neighbour]), float(vertical[neighbour]))
    return 2 * towards - float(angles[rotor])


def _tangent(chain: Chain, angles: Array) -> Array:
    """Unit vector along the orbit in the metric sum_n (I_n / I) dphi_n^2, shape (N,)."""
    mode = zero_mode(chain, angles)
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    return np.asarray(mode / math.sqrt(float(weights @ mode**2)))


def _to_go(chain: Chain, angles: Array, goal: Array) -> float:
    """Arc length to a configuration that is close, up to turns of rotors; else infinite [rad]."""
    difference = np.remainder(goal - angles + math.pi, 2 * math.pi) - math.pi
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    distance = math.sqrt(float(weights @ difference**2))
    along = float((weights * _tangent(chain, angles)) @ difference)
    return along if distance < 1.5 * abs(along) else math.inf
