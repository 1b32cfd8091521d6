# SPDX-License-Identifier: Apache-2.0
"""How well one noisy frame tells the place of a wall: estimators, tried on walls of known place.

With independent noise of standard deviation sigma [rad] in every angle no unbiased estimate of
the place has a standard deviation below sigma / Lambda [rotor spacings] (the bound of Cramer and
Rao). Places count the arc of the zero-energy orbit, as in `UniformOrbit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import stdtrit

from soliton_linkage.estimation.relocalisation import NearestPoint, fit_anywhere, fit_near
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons, order_field
from soliton_linkage_studies.experiments import zero_crossing

ZERO_CROSSING = 'zero crossing of u'
SHIFTED_CROSSING = 'zero crossing of cos(θ − θ̄)'
TANH_FIT = 'tanh fit'
ORBIT_NEAR = 'nearest point of the orbit'
ORBIT_COLD = 'the same, cold'

_FROM_EDGE = 2.0
"""Widths of a wall from an edge, at which the edge changes its shape by 2 % of it."""
_LOST_WIDTHS = 2.0
"""Widths of a wall by which an estimate that is of this wall is off at most."""
_LOST_BOUNDS = 6.0
"""Least standard deviations by which it is off at most, where noise hides the wall."""
_QUANTILE = 0.975
"""Probability below the upper end of an interval of 95 %."""


@dataclass(frozen=True)
class Estimate:
    """Where an estimator has a wall; what it does not tell is NaN or None."""

    place: float
    """Of the wall [rotor spacings]."""
    margin: float = math.nan
    """Half the stated interval of 95 % [rotor spacings]."""
    leg: int | None = None
    """Of the orbit."""


@dataclass(frozen=True)
class EstimatorTrial:
    """Frames to try estimators on."""

    frames: int
    noise: float
    """Standard deviation of an angle [rad]."""
    coarse_start: float
    """Largest error of the guess that a fit starts from [rotor spacings]."""
    cold_every: int
    """The cold search, the slowest by far, takes every so many frames."""


Estimator = Callable[[UniformOrbit, Array, float], Estimate]
"""Takes the orbit, angles [rad] of shape (N,) and a coarse guess of the arc length [rad]."""


def bound(chain: Chain, noise: float) -> float:
    """Least standard deviation of the place [rotor spacings], sigma / Lambda."""
    return noise / site_arc(chain)


def inner_places(chain: Chain) -> tuple[float, float]:
    """Least and largest place [rotor spacings] that is two widths of a wall from both edges."""
    low = _FROM_EDGE * chain.wall_width / chain.spacing
    return low, chain.number_of_rotors - 1 - low


def estimators_of(chain: Chain) -> dict[str, Estimator]:
    """Estimators of the place of a wall by their names; the shifted field is that of spinners."""
    return {
        name: estimator
        for name, estimator in ESTIMATORS.items()
        if name != SHIFTED_CROSSING or chain.motion is Motion.SPINNER
    }


def errors(
    chain: Chain, trial: EstimatorTrial, generator: np.random.Generator
) -> dict[str, Array]:
    """Errors and margins [rotor spacings] by estimator, shape (frames tried, 2) each.

    Walls are at random inner places on all legs. An error is NaN where the estimator failed: it
    told no place or not one alone, one that is off by more than two widths of the wall and by
    six times the bound, or another leg.
    """
    orbit = orbit_of(chain)
    lost = max(
        _LOST_WIDTHS * chain.wall_width / chain.spacing,
        _LOST_BOUNDS * bound(chain, trial.noise),
    )
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in estimators_of(chain)}
    for frame in range(trial.frames):
        place = float(generator.uniform(*inner_places(chain)))
        leg = int(generator.integers(orbit.number_of_legs))
        arc = orbit.arc_at(place, leg)
        noise = trial.noise * generator.standard_normal(chain.number_of_rotors)
        angles = orbit.configuration(arc) + noise
        guess = arc + trial.coarse_start * orbit.site_arc * float(generator.uniform(-1, 1))
        for name, estimator in estimators_of(chain).items():
            if name == ORBIT_COLD and frame % trial.cold_every:
                continue
            estimate = estimator(orbit, angles, guess)
            error = estimate.place - place
            failed = not abs(error) <= lost or estimate.leg not in (None, leg)
            found[name].append((math.nan if failed else error, estimate.margin))
    return {name: np.array(pairs).reshape(-1, 2) for name, pairs in found.items()}


def bias_by_place(chain: Chain, points: int) -> tuple[Array, dict[str, Array]]:
    """Places from an even rotor in the middle to the next but one, and errors without noise.

    Places beyond that rotor and errors by estimator, both [rotor spacings], shape (points,)
    each. The walls are hung bar by bar, so that they owe nothing to the orbit.
    """
    orbit = orbit_of(chain)
    rotor = 2 * (chain.number_of_rotors // 4)
    beyond = np.linspace(0.0, 2.0, points)
    walls = [static_wall(chain, float(rotor + step)) for step in beyond]
    found = {}
    for name, estimator in estimators_of(chain).items():
        places = [
            estimator(orbit, wall, orbit.arc_at(float(rotor + step), 0)).place
            for wall, step in zip(walls, beyond, strict=True)
        ]
        found[name] = np.array(places) - rotor - beyond
    return beyond, found


@cache
def orbit_of(chain: Chain) -> UniformOrbit:
    """Orbit of a chain, built once in a process."""
    return UniformOrbit(chain)


def _crossing_of_u(_orbit: UniformOrbit, angles: Array, _guess: float) -> Estimate:
    """Where u = r sin(theta) first passes through 0 (paper, Fig. 5)."""
    return Estimate(zero_crossing(np.sin(staggered(angles))))


def _crossing_of_shifted_field(orbit: UniformOrbit, angles: Array, _guess: float) -> Estimate:
    """Where cos(theta - theta_bar) first passes through 0 (paper, Fig. 6)."""
    field, _ = order_field(orbit.chain, angles)
    return Estimate(zero_crossing(field))


def _tanh_fit(orbit: UniformOrbit, angles: Array, _guess: float) -> Estimate:
    """Place of the only wall that `find_solitons` finds, its interval that of a normal error."""
    walls = find_solitons(orbit.chain, angles)
    if len(walls) != 1:
        return Estimate(math.nan)
    margin = stdtrit(math.inf, _QUANTILE) * walls[0].position_deviation / orbit.chain.spacing
    return Estimate(walls[0].rotor, float(margin))


def _orbit_near(orbit: UniformOrbit, angles: Array, guess: float) -> Estimate:
    return _orbit_estimate(orbit, fit_near(orbit, angles, guess))


def _orbit_cold(orbit: UniformOrbit, angles: Array, _guess: float) -> Estimate:
    return _orbit_estimate(orbit, fit_anywhere(orbit, angles))


def _orbit_estimate(orbit: UniformOrbit, fit: NearestPoint) -> Estimate:
    """Interval by Student's distribution: the noise is told by the frame's own misfit."""
    freedom = len(orbit.segment(fit.arc).angles) - 1
    deviation = fit.misfit / math.sqrt(fit.information) / orbit.site_arc
    margin = float(stdtrit(freedom, _QUANTILE)) * deviation
    return Estimate(orbit.site(fit.arc), margin, orbit.leg(fit.arc))


ESTIMATORS: dict[str, Estimator] = {
    ZERO_CROSSING: _crossing_of_u,
    SHIFTED_CROSSING: _crossing_of_shifted_field,
    TANH_FIT: _tanh_fit,
    ORBIT_NEAR: _orbit_near,
    ORBIT_COLD: _orbit_cold,
}
