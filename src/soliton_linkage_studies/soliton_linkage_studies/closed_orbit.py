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
from scipy.interpolate import BSpline, make_interp_spline

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import Edge, mode_towards_last, zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import check_transition


@dataclass(frozen=True)
class OrbitSettings:
    """Tuning of `closed_orbit`."""

    most_samples: int = 1_000_000
    """Samples without return after which it is given up."""
    coincident: float = 1e-3
    """Distance beside the curve, over the spacing, of configurations that are the same."""
    degree: int = 7
    """Of the splines between samples."""
    coarsest: float = 0.25
    """Spacing beyond which samples draw no curve [rad]."""
    resolution: float = 1e-10
    """Of the arcs at which the wall is reflected [rad]."""


SETTINGS = OrbitSettings()


@dataclass(frozen=True)
class SampledOrbit:
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
        return np.array([float(_direction(self.chain, each)) for each in self.angles])

    @cached_property
    def reflections(self) -> tuple[tuple[float, Edge], ...]:
        """Arc length [rad] and edge of each reflection of the wall, in the order of the cycle.

        A flipper's is where its edge rotor passes the line from its pivot to its neighbour's
        mass, a spinner's where the sum of all horizontal positions turns back.
        """
        turning = np.flatnonzero(np.diff(self.directions))
        return tuple(
            (
                self._turning_arc(int(sample)),
                Edge.LAST if self.directions[sample] > 0 else Edge.FIRST,
            )
            for sample in turning
        )

    def configuration(self, arc: float) -> Array:
        """Angles at an arc length [rad], every bar at its length, shape (N,).

        The arc may be any number; each cycle adds the turns that the rotors make in it.
        """
        orbits, within = divmod(arc, self.length)
        between = unstretched(self.chain, np.asarray(self._spline(within)))
        return between + 2 * math.pi * orbits * self.turns

    def _turning_arc(self, sample: int) -> float:
        """Arc length between a sample and the next where the direction changes [rad]."""
        before, after = self.arcs[sample : sample + 2].tolist()
        while after - before > SETTINGS.resolution:
            between = (before + after) / 2
            if _direction(self.chain, self.configuration(between)) == self.directions[sample]:
                before = between
            else:
                after = between
        return float(before + after) / 2

    @cached_property
    def _spline(self) -> BSpline:
        return make_interp_spline(self.arcs, self.angles, k=SETTINGS.degree)


def closed_orbit(chain: Chain, start: Array, spacing: float = 0.05) -> SampledOrbit:
    """Follow the linkage from a configuration until it returns, in samples of arc length [rad].

    Starts in the direction of the zero mode; the samples are evenly spaced but for the last.
    Raises ValueError for a spacing that is not above 0 or too coarse to draw a curve, for d
    within 1e-9 d_c of d_c, where orbits meet, and as `RigidSimulation` does.
    """
    if not 0 < spacing <= SETTINGS.coarsest:
        raise ValueError(f'spacing = {spacing} rad must lie above 0 and up to {SETTINGS.coarsest}')
    check_transition(chain)
    begin = unstretched(chain, start)
    tangent = _tangent(chain, begin)
    simulation = RigidSimulation(chain, begin, tangent, period=spacing)
    samples, left = [simulation.angles], -math.inf
    while not abs(left) <= spacing / 2:
        if len(samples) > SETTINGS.most_samples:
            raise ValueError(
                f'the orbit did not close within {SETTINGS.most_samples} samples {spacing} rad '
                'apart; take a larger spacing'
            )
        simulation.advance()
        samples.append(simulation.angles)
        left = _to_go(chain, samples[-1], begin, spacing)
    if left < spacing / 2:
        left += spacing
        samples.pop()
    left = _arc_between(chain, samples[-1], begin, left)
    turns = np.round((samples[-1] - begin) / (2 * math.pi))
    arcs = spacing * np.arange(len(samples), dtype=np.float64)
    closed = [*samples, begin + 2 * math.pi * turns]
    return SampledOrbit(chain, np.append(arcs, arcs[-1] + left), np.array(closed))


def _direction(chain: Chain, angles: Array) -> int:
    """+1 where the wall moves along the zero mode towards the last rotor, else -1."""
    return 1 if float(mode_towards_last(chain, angles) @ zero_mode(chain, angles)) > 0 else -1


def _tangent(chain: Chain, angles: Array) -> Array:
    """Unit vector along the orbit in the metric sum_n (I_n / I) dphi_n^2, shape (N,)."""
    mode = zero_mode(chain, angles)
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    return np.asarray(mode / math.sqrt(float(weights @ mode**2)))


def _arc_between(chain: Chain, angles: Array, goal: Array, about: float) -> float:
    """Arc length from a configuration to another, of which an estimate is known [rad]."""
    simulation = RigidSimulation(chain, angles, _tangent(chain, angles), period=about)
    simulation.advance()
    along, _ = _apart(chain, simulation.angles, goal)
    return about + along


def _to_go(chain: Chain, angles: Array, goal: Array, spacing: float) -> float:
    """Arc length to a configuration that lies within a few spacings, else infinite [rad].

    It is off by the curvature of the orbit, to third order.
    """
    along, distance = _apart(chain, angles, goal)
    return along if distance < 1.5 * abs(along) + SETTINGS.coincident * spacing else math.inf


def _apart(chain: Chain, angles: Array, goal: Array) -> tuple[float, float]:
    """How far a configuration is along the orbit, and in all, up to turns of rotors [rad]."""
    difference = np.remainder(goal - angles + math.pi, 2 * math.pi) - math.pi
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    along = float((weights * _tangent(chain, angles)) @ difference)
    return along, math.sqrt(float(weights @ difference**2))
