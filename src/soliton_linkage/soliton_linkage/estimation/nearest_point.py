# SPDX-License-Identifier: Apache-2.0
"""Where on its orbit a chain is, from one frame of noisy angles: the nearest point of the orbit.

With independent noise of standard deviation sigma in every angle the likeliest arc length s is
that whose configuration Phi(s) is nearest, sum_n (phi_n - Phi_n(s))^2 least, and no unbiased
estimate has a standard deviation below sigma / |dPhi/ds| = sigma, as the arc has unit speed
(the bound of Cramer and Rao). In rotor spacings that is sigma / Lambda.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.estimation.settings import DEFAULTS, SearchSettings
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, check_shape
from soliton_linkage.orbit.orbit import Orbit, Stretch


@dataclass(frozen=True)
class NearestPoint:
    """The nearest point of the orbit to a frame.

    arc: arc length from the start of the orbit [rad]; NaN where no rotor at all is known.
    information: information on the arc in units of that of a noise of 1 rad [1]: 1 if all rotors
        are seen. The standard deviation of the arc is sigma / sqrt(information) [rad]. Below 1e-6
        the arc is not fitted, but is where it was looked for.
    misfit: root mean square of what is left of the rotors about the wall [rad], NaN for one or
        none. It estimates sigma: the sum of squares is divided by one less than the number of
        rotors.
    lead: how much likelier the arc is than the next best one elsewhere on the orbit [1]. It is the
        difference of sum_n cos(phi_n - Phi_n); divided by sigma^2, the logarithm of the odds. A
        flipper whose edge rotor is not seen may have toggled it or not: then it is near 0.
        Infinite where nothing else comes close; NaN from `fit_near`, which does not look
        elsewhere.
    """

    arc: float
    information: float
    misfit: float
    lead: float = math.nan


def fit_near(
    orbit: Orbit, angles: Array, arc: float, settings: SearchSettings = DEFAULTS.search
) -> NearestPoint:
    """Nearest point of the orbit to angles [rad], shape (N,), NaN where unknown, near an arc.

    Gauss and Newton's method, arc += t . (phi - Phi) / (t . t) over the rotors that are known,
    with differences counted from -pi to pi; after the first step divided by the slope that the
    last one met, which the curvature of the orbit makes other than 1 in a frame off the orbit.
    The arc may leave the range of one round, so that a series of fits counts cycles. Raises
    ValueError for angles of another shape or infinite ones, and for an arc that is not finite.
    """
    if not math.isfinite(arc):
        raise ValueError(f'arc = {arc} rad must be a finite number; start with fit_anywhere')
    return _fit_near(orbit, _checked(orbit, angles), arc, settings)


def fit_anywhere(
    orbit: Orbit, angles: Array, settings: SearchSettings = DEFAULTS.search
) -> NearestPoint:
    """Nearest point of the orbit to angles [rad], shape (N,), NaN where unknown.

    Finds the largest likeness sum_n cos(phi_n - Phi_n(s)), which is blind to whole turns, along
    the orbit, and refines it and the next largest. Where the wall is, to within what a wall is
    wide, is first told by the rotors that are uniform on either side of it: O(N). The arc is
    from 0 to that of the whole orbit; of frames without any known angle it is NaN, and the
    information 0. Raises ValueError for angles of another shape or infinite ones.
    """
    frame = _checked(orbit, angles)
    if np.isnan(frame).all():
        return NearestPoint(math.nan, 0.0, math.nan)
    search = _Search(orbit, frame, settings)
    fits: list[NearestPoint] = []
    for arc in search.peaks():
        fit = _fit_near(orbit, frame, arc, settings)
        apart = [abs(math.remainder(fit.arc - it.arc, orbit.length)) for it in fits]
        if not any(each < settings.same_arc for each in apart):
            fits.append(fit)
        if len(fits) == 2:
            break
    likeness = [search.likeness(fit.arc) for fit in fits]
    best = int(np.argmax(likeness))
    lead = abs(likeness[0] - likeness[1]) if len(fits) == 2 else math.inf
    return replace(fits[best], arc=fits[best].arc % orbit.length, lead=lead)


def _fit_near(orbit: Orbit, frame: Array, arc: float, settings: SearchSettings) -> NearestPoint:
    longest, least_slope = settings.longest_step, settings.least_slope
    ahead_before, step = 0.0, 0.0
    for _ in range(settings.iterations):
        difference, tangent = _compared(frame, orbit.stretch(arc))
        information = float(tangent @ tangent)
        if information < settings.least_information:
            break
        ahead = float(tangent @ difference) / information
        slope = (ahead_before - ahead) / step if step else 1.0
        step = ahead / min(max(slope, least_slope), 1 / least_slope)
        step = min(max(step, -longest), longest)
        arc += step
        ahead_before = ahead
        if abs(step) < settings.close:
            break
    squares, known = float(difference @ difference), len(difference)
    return NearestPoint(
        arc, information, math.sqrt(squares / (known - 1)) if known > 1 else math.nan
    )


def _compared(frame: Array, about: Stretch) -> tuple[Array, Array]:
    """Differences from the orbit [rad], -pi to pi, and tangent [1] of the rotors that are known.

    Only those about the wall, shape (known,) each.
    """
    difference = frame[about.first : about.first + len(about.angles)] - about.angles
    difference -= 2 * math.pi * np.rint(difference * (0.5 / math.pi))
    if math.isfinite(difference @ difference):
        return difference, about.tangent
    known = np.isfinite(difference)
    return difference[known], about.tangent[known]


def _checked(orbit: Orbit, angles: Array) -> Array:
    """Angles as an array; ValueError where they are infinite or not one a rotor."""
    frame = np.asarray(angles, dtype=np.float64)
    check_shape(frame, orbit.chain.number_of_rotors)
    infinite = np.isinf(frame)
    if infinite.any():
        rotor = int(np.argmax(infinite))
        raise ValueError(
            f'angle of rotor {rotor} = {frame[rotor]} must be a finite number, or NaN where it '
            'is unknown'
        )
    return frame


class _Search:
    """Likeness of a frame to the configurations of an orbit."""

    def __init__(self, orbit: Orbit, frame: Array, settings: SearchSettings) -> None:
        self._orbit = orbit
        self._longest_step = settings.search_step
        self._frame = frame
        self._before, self._beyond = [], []
        for leg in range(orbit.number_of_legs):
            left, right = orbit.background(orbit.arc_at(orbit.middle, leg))
            self._before.append(np.concatenate([[0.0], np.cumsum(_cosines(frame - left))]))
            of_right = _cosines(frame - right)
            self._beyond.append(np.concatenate([np.cumsum(of_right[::-1])[::-1], [0.0]]))

    def peaks(self) -> list[float]:
        """Arc lengths of the maxima of the likeness [rad], up to a step, the largest first."""
        arcs = self._likely_arcs()
        likeness = np.array([self.likeness(arc) for arc in arcs.tolist()])
        peaks = (likeness >= np.roll(likeness, 1)) & (likeness >= np.roll(likeness, -1))
        order = np.argsort(-likeness[peaks], kind='stable')
        return [float(arc) for arc in arcs[peaks][order]]

    def likeness(self, arc: float) -> float:
        """Return sum_n cos(phi_n - Phi_n) over the rotors that are known."""
        about = self._orbit.stretch(arc)
        leg, beyond = self._orbit.leg(arc), about.first + len(about.angles)
        seen = _cosines(self._frame[about.first : beyond] - about.angles)
        ends = self._before[leg][about.first] + self._beyond[leg][beyond]
        return float(ends + seen.sum())

    def _likely_arcs(self) -> Array:
        """Arc lengths to look at [rad], growing: in every leg those about the likeliest place."""
        orbit = self._orbit
        sums = np.array(self._before) + np.array(self._beyond)
        place = int(np.argmax(sums.max(axis=0))) - 0.5
        depth = penetration_depth(orbit.chain) / orbit.chain.spacing
        step = min(self._longest_step, max(depth, 1.0) * orbit.site_arc)
        arcs = []
        for leg in range(orbit.number_of_legs):
            begin, end = orbit.leg_arcs(leg)
            centre = orbit.arc_at(place, leg)
            low = max(begin, centre - orbit.reach)
            high = min(end, centre + orbit.reach)
            arcs.append(np.arange(low, max(high, low + step), step))
        return np.concatenate(arcs)


def _cosines(differences: Array) -> Array:
    """Cosines of differences [rad], 0 where they are not known."""
    cosines = np.cos(differences)
    cosines[np.isnan(cosines)] = 0.0
    return np.asarray(cosines)
