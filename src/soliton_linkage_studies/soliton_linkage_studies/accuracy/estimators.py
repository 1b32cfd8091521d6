# SPDX-License-Identifier: Apache-2.0
"""Estimators of the wall position from one noisy frame, and their errors on known walls.

If no spring is stretched, a chain with a wall can only move along a closed curve in the space of
the angles, the orbit. The arc length from the start of the orbit to a state is the integral of
sqrt(sum_n dphi_n^2) [rad]. Lambda is the increase of the arc length while the wall moves by one
rotor spacing [rad]. The Cramer-Rao bound of the position is sigma / Lambda [rotor spacings]. The
noise of the angles is independent and has the standard deviation sigma [rad].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.random import Generator
from scipy.special import stdtrit

from soliton_linkage.estimation.relocalisation import NearestPoint, fit_anywhere, fit_near
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons, order_field
from soliton_linkage_studies.experiments import zero_crossing
from soliton_linkage_studies.settings import setting

ZERO_CROSSING = 'zero crossing of u'
SHIFTED_CROSSING = 'zero crossing of cos(θ − θ̄)'
TANH_FIT = 'tanh fit'
ORBIT_NEAR = 'nearest point of the orbit'
ORBIT_COLD = 'the same, without a guess'

_FROM_EDGE = 2.0
"""Smallest distance of a tested wall from the edges [wall widths], because edges change its
shape."""
_LOST_WIDTHS = 2.0
"""An estimate has failed if its error is above both this [wall widths] and `_LOST_BOUNDS`."""
_LOST_BOUNDS = 6.0
"""Second limit for the error of a failed estimate [Cramer-Rao bounds]; see `_LOST_WIDTHS`."""
_QUANTILE = 0.975
"""Probability below the upper end of a 95 % interval [1]."""


@dataclass(frozen=True)
class Estimate:
    """Estimate of a wall; some estimators provide no `margin` (NaN) or no `leg` (None)."""

    position: float
    """Wall position [rotor spacings]."""
    margin: float = math.nan
    """Half the width of the stated 95 % interval [rotor spacings]."""
    leg: int | None = None
    """Leg of the orbit (passage of the wall from edge to edge) on which the wall is."""


@dataclass(frozen=True)
class EstimatorTrial:
    """Parameters of the frames on which estimators are tested."""

    noise: float
    """Standard deviation of the noise of each angle [rad]."""
    frames: int = setting('number of frames', '1', 2, 10_000_000)
    coarse_start: float = setting('largest error of a guess', 'rotor spacings', 0.0, 1.0)
    cold_every: int = setting('frames per test of the slow cold search', '1', 1, 1_000_000)


Estimator = Callable[[UniformOrbit, Array, float], Estimate]
"""Function of the orbit, the angles [rad], shape (N,), and a guess of the arc length of the state
[rad]; only `ORBIT_NEAR` uses the guess."""


def bound(chain: Chain, noise: float) -> float:
    """Return the Cramer-Rao bound sigma / Lambda of the position error [rotor spacings]."""
    return noise / site_arc(chain)


def inner_positions(chain: Chain) -> tuple[float, float]:
    """Return the lowest and highest tested position [spacings], two wall widths from the edges."""
    low = _FROM_EDGE * chain.wall_width / chain.spacing
    return low, chain.number_of_rotors - 1 - low


def estimators_of(chain: Chain) -> dict[str, Estimator]:
    """Return the estimators of the wall position that are tested on a chain, by name.

    `SHIFTED_CROSSING` is tested on spinners only, because it equals `ZERO_CROSSING` in flippers.
    """
    omitted = () if chain.motion is Motion.SPINNER else (SHIFTED_CROSSING,)
    return {name: each for name, each in ESTIMATORS.items() if name not in omitted}


def errors(chain: Chain, trial: EstimatorTrial, generator: Generator) -> dict[str, Array]:
    """Return the errors and margins of each estimator in the frames of a trial [rotor spacings].

    Each array has shape (frames, 2): error and margin. The estimator `ORBIT_COLD`, which searches
    the whole orbit, is slow. Therefore it is tested only on one of `trial.cold_every` frames, and
    its array is shorter. A margin is half the width of the stated 95 % interval. The true walls
    are at random positions within `inner_positions`, on random legs. The error is NaN if the
    estimator finds no wall, several walls or a wrong leg, or if its error exceeds both two wall
    widths and six Cramer-Rao bounds.
    """
    orbit = orbit_of(chain)
    widths = _LOST_WIDTHS * chain.wall_width / chain.spacing
    lost = max(widths, _LOST_BOUNDS * bound(chain, trial.noise))
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in estimators_of(chain)}
    for frame in range(trial.frames):
        position = float(generator.uniform(*inner_positions(chain)))
        leg = int(generator.integers(orbit.number_of_legs))
        arc = orbit.arc_at(position, leg)
        noise = trial.noise * generator.standard_normal(chain.number_of_rotors)
        angles = orbit.configuration(arc) + noise
        guess = arc + trial.coarse_start * orbit.site_arc * float(generator.uniform(-1, 1))
        for name, estimator in estimators_of(chain).items():
            if name == ORBIT_COLD and frame % trial.cold_every:
                continue
            estimate = estimator(orbit, angles, guess)
            error = estimate.position - position
            failed = not abs(error) <= lost or estimate.leg not in (None, leg)
            found[name].append((math.nan if failed else error, estimate.margin))
    return {name: np.array(pairs).reshape(-1, 2) for name, pairs in found.items()}


def bias_by_position(chain: Chain, points: int) -> tuple[Array, dict[str, Array]]:
    """Return the error of each estimator without noise, at positions that cover two spacings.

    Returns the distance of each wall from a fixed even rotor, and the errors by estimator name.
    All arrays have shape (points,) and the unit [rotor spacings]. The walls are computed by
    `static_wall`, independently of the orbit.
    """
    orbit = orbit_of(chain)
    rotor = 2 * (chain.number_of_rotors // 4)
    beyond = np.linspace(0.0, 2.0, points)
    walls = [static_wall(chain, float(rotor + step)) for step in beyond]
    found = {}
    for name, estimator in estimators_of(chain).items():
        positions = [
            estimator(orbit, wall, orbit.arc_at(float(rotor + step), 0)).position
            for wall, step in zip(walls, beyond, strict=True)
        ]
        found[name] = np.array(positions) - rotor - beyond
    return beyond, found


@cache
def orbit_of(chain: Chain) -> UniformOrbit:
    """Return the orbit of a chain, cached per process."""
    return UniformOrbit(chain)


def _tanh_fit(orbit: UniformOrbit, angles: Array, _guess: float) -> Estimate:
    walls = find_solitons(orbit.chain, angles)
    if len(walls) != 1:
        return Estimate(math.nan)
    margin = stdtrit(math.inf, _QUANTILE) * walls[0].position_deviation / orbit.chain.spacing
    return Estimate(walls[0].rotor, float(margin))


def _orbit_estimate(orbit: UniformOrbit, fit: NearestPoint) -> Estimate:
    freedom = len(orbit.segment(fit.arc).angles) - 1
    deviation = fit.misfit / math.sqrt(fit.information) / orbit.site_arc
    margin = float(stdtrit(freedom, _QUANTILE)) * deviation
    return Estimate(orbit.site(fit.arc), margin, orbit.leg(fit.arc))


ESTIMATORS: dict[str, Estimator] = {
    ZERO_CROSSING: lambda _, angles, guess: Estimate(zero_crossing(np.sin(staggered(angles)))),
    SHIFTED_CROSSING: lambda orbit, angles, guess: Estimate(
        zero_crossing(order_field(orbit.chain, angles)[0])
    ),
    TANH_FIT: _tanh_fit,
    ORBIT_NEAR: lambda orbit, *given: _orbit_estimate(orbit, fit_near(orbit, *given)),
    ORBIT_COLD: lambda orbit, angles, _: _orbit_estimate(orbit, fit_anywhere(orbit, angles)),
}
"""Estimators of the wall position by name.

- `ZERO_CROSSING` returns the zero of u = r sin(phi) along the chain, interpolated linearly between
  two rotors. The paper uses it for flippers (Fig. 5).
- `SHIFTED_CROSSING` returns the zero of cos(theta - theta_bar) with the staggered angles theta
  (`staggered`). The paper uses it for spinners (Fig. 6).
- `TANH_FIT` fits a tanh profile to the order field of the rotors (`find_solitons`). The order
  field is +1 in the right-leaning uniform state and -1 in the left-leaning one.
- `ORBIT_NEAR` returns the wall position at the orbit point nearest to the frame. The search starts
  at the guess.
- `ORBIT_COLD` returns the same, but searches the whole orbit without a guess."""
