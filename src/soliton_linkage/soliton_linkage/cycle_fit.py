# SPDX-License-Identifier: Apache-2.0
"""Where on its cycle a chain is, from one frame of noisy angles: the nearest point of the orbit.

With independent noise of standard deviation sigma in every angle the likeliest arc length s is
that whose configuration Phi(s) is nearest, sum_n (phi_n - Phi_n(s))^2 least, and no unbiased
estimate has a standard deviation below sigma / |dPhi/ds| = sigma, as the arc has unit speed
(the bound of Cramer and Rao). In rotor spacings that is sigma / Lambda.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.chain import Array
from soliton_linkage.cycle import Cycle

_ITERATIONS = 12
_ENOUGH = 1e-10
_LONGEST_STEP = 0.5
_SEARCH_STEP = 0.2


@dataclass(frozen=True)
class CycleFit:
    """The nearest point of the orbit to a frame."""

    arc: float
    """Arc length from the start of the cycle [rad], 0 to that of the whole cycle."""
    information: float
    """Information on the arc in units of that of a noise of 1 rad [1]: 1 if all rotors are seen.

    The standard deviation of the arc is sigma / sqrt(information) [rad].
    """
    misfit: float
    """Root mean square of what is left of the rotors about the wall [rad]."""


def fit_near(cycle: Cycle, angles: Array, arc: float) -> CycleFit:
    """Nearest point of the orbit to angles [rad], shape (N,), NaN where unknown, near an arc.

    Gauss and Newton's method, arc += t . (phi - Phi) / (t . t) over the rotors that are known,
    with differences counted from -pi to pi. The arc may leave the range of one cycle, so that a
    series of fits counts cycles.
    """
    for _ in range(_ITERATIONS):
        about = cycle.stretch(arc)
        seen = angles[about.first : about.first + len(about.angles)]
        known = np.isfinite(seen)
        difference = _wrapped(seen[known] - about.angles[known])
        tangent = about.tangent[known]
        information = float(tangent @ tangent)
        if information == 0:
            break
        step = float(tangent @ difference) / information
        arc += min(max(step, -_LONGEST_STEP), _LONGEST_STEP)
        if abs(step) < _ENOUGH:
            break
    count = max(int(known.sum()) - 1, 1)
    return CycleFit(arc, information, math.sqrt(float(difference @ difference) / count))


def fit_anywhere(cycle: Cycle, angles: Array) -> CycleFit:
    """Nearest point of the orbit to angles [rad], shape (N,), NaN where unknown.

    Finds the largest likeness sum_n cos(phi_n - Phi_n(s)), which is blind to whole turns, along
    the cycle, and refines it. Where the wall is, to within what a wall is wide, is first told by
    the rotors that are uniform on either side of it: O(N).
    """
    search = _Search(cycle, angles)
    arcs = search.likely_arcs()
    likeness = [search.likeness(arc) for arc in arcs]
    return fit_near(cycle, angles, float(arcs[int(np.argmax(likeness))]))


class _Search:
    """Likeness of a frame to the configurations of a cycle."""

    def __init__(self, cycle: Cycle, angles: Array) -> None:
        self._cycle = cycle
        self._angles = angles
        self._before, self._beyond = [], []
        for leg in range(cycle.number_of_legs):
            left, right = cycle.background(cycle.arc_at(cycle.middle, leg))
            self._before.append(np.concatenate([[0.0], np.cumsum(_cosines(angles - left))]))
            of_right = _cosines(angles - right)
            self._beyond.append(np.concatenate([np.cumsum(of_right[::-1])[::-1], [0.0]]))

    def likely_arcs(self) -> Array:
        """Arc lengths to look at [rad]: in every leg those about the likeliest place."""
        cycle = self._cycle
        sums = np.array(self._before) + np.array(self._beyond)
        place = int(np.argmax(sums.max(axis=0))) - 0.5
        step = min(_SEARCH_STEP, cycle.site_arc)
        arcs = []
        for leg in range(cycle.number_of_legs):
            begin, end = cycle.leg_arcs(leg)
            centre = cycle.arc_at(place, leg)
            low = max(begin, centre - cycle.reach)
            high = min(end, centre + cycle.reach)
            arcs.append(np.arange(low, max(high, low + step), step))
        return np.concatenate(arcs)

    def likeness(self, arc: float) -> float:
        """Return sum_n cos(phi_n - Phi_n) over the rotors that are known."""
        about = self._cycle.stretch(arc)
        leg, beyond = self._cycle.leg(arc), about.first + len(about.angles)
        seen = _cosines(self._angles[about.first : beyond] - about.angles)
        ends = self._before[leg][about.first] + self._beyond[leg][beyond]
        return float(ends + seen.sum())


def _cosines(differences: Array) -> Array:
    """Cosines of differences [rad], 0 where they are not known."""
    return np.asarray(np.where(np.isfinite(differences), np.cos(differences), 0.0))


def _wrapped(differences: Array) -> Array:
    return np.asarray(np.remainder(differences + math.pi, 2 * math.pi) - math.pi)
