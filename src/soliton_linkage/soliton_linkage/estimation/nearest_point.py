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
from functools import lru_cache

import numpy as np

from soliton_linkage.estimation.places.place_search import PlaceSearch
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings, SearchSettings
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
    """

    arc: float
    information: float
    misfit: float


def fit_near(
    orbit: Orbit, angles: Array, arc: float, settings: SearchSettings = DEFAULTS.search
) -> NearestPoint:
    """Nearest point of the orbit to angles [rad], shape (N,), NaN where unknown, near an arc.

    Gauss and Newton's method, arc += t . (phi - Phi) / (t . t) over the rotors that are known,
    with differences counted from -pi to pi. The arc may leave the range of one round, so that a
    series of fits counts cycles. Raises ValueError for angles of another shape or infinite ones,
    and for an arc that is not finite.
    """
    if not math.isfinite(arc):
        raise ValueError(f'arc = {arc} rad must be a finite number; start with fit_anywhere')
    return _fit_near(orbit, _checked(orbit, angles), arc, settings)


def fit_anywhere(
    orbit: Orbit, angles: Array, settings: EstimationSettings = DEFAULTS
) -> NearestPoint:
    """Nearest point of the orbit to angles [rad], shape (N,), NaN where unknown.

    It is near the likeliest of all places, as `PlaceSearch` finds it. The arc is from 0 to that
    of the whole orbit; of frames without any known angle it is NaN, and the information 0. Raises
    ValueError for angles of another shape or infinite ones.
    """
    frame = _checked(orbit, angles)
    found = _search(orbit, settings).find(frame, 0.0, (False,)).places
    if not found:
        return NearestPoint(math.nan, 0.0, math.nan)
    nearest = _fit_near(orbit, frame, found[0].arc, settings.search)
    return replace(nearest, arc=nearest.arc % orbit.length)


@lru_cache(maxsize=1)
def _search(orbit: Orbit, settings: EstimationSettings) -> PlaceSearch:
    """Search of an orbit, of which sampling it is the most: frames come from one at a time."""
    return PlaceSearch(orbit, settings.likelihood, settings.scan)


def _fit_near(orbit: Orbit, frame: Array, arc: float, settings: SearchSettings) -> NearestPoint:
    for _ in range(settings.iterations):
        difference, tangent = _compared(frame, orbit.stretch(arc))
        information = float(tangent @ tangent)
        if information < settings.least_information:
            break
        step = float(tangent @ difference) / information
        step = min(max(step, -settings.longest_step), settings.longest_step)
        arc += step
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
