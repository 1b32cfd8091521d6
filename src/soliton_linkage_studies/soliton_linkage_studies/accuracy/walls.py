# SPDX-License-Identifier: Apache-2.0
"""True wall positions in noiseless frames: the position of the nearest static wall.

Static kinks (`static_wall`) have zero energy at every position. The energy of an anti-kink depends
on its position. Therefore, static anti-kinks are the states of least energy while a constraint
holds the anti-kink at its position (`anti_kink_path`). If these states are unstable at some
positions, the anti-kink is pinned: it cannot move continuously along the chain. Then only one of
its equilibria is used, repeated every two rotor spacings (`resting_anti_kink`).

The time unit is `Chain.time_unit`, sqrt(M / k_e).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import savgol_coeffs

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.bands import penetration_depth, speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.anti_kink import (
    anti_kink_path,
    barrier_speed,
    continuum_anti_kink,
    resting_anti_kink,
)
from soliton_linkage.solitons.static_wall import static_wall

TOLERANCE = 1e-8
"""Largest integration error of the angles in a step of the solver [rad], far below the noise."""
WINDOWS, FORCED_WINDOWS = 3, 6
"""Length of the window for the fit of a slope, divided by the length of the averaging window [1].
The second value is for chains with force terms."""
_STOPPED = 0.02
"""With force terms, a wall counts as stopped if its speed is below this fraction of its largest
speed [1]."""
_SAMPLES = 65
"""Number of static walls over two spacings [1]; a spline interpolates them to 1e-6 rad."""
_LONGEST = 0.3
"""Largest change of the angles in one Gauss-Newton step towards the nearest point [rad]."""
_GAUSS_STEPS = 6
"""Largest number of Gauss-Newton steps [1]; two are sufficient if the search starts at the result
of the previous frame."""
_CLOSE = 1e-6
"""The Gauss-Newton search ends when a step is smaller than this [rad]."""


def reach(chain: Chain) -> float:
    """Return the distance from a wall at which its tails have decayed to 1 % [rotor spacings]."""
    return 2.5 * max(chain.wall_width, penetration_depth(chain)) / chain.spacing + 3


def extent(chain: Chain) -> int:
    """Return the even number of rotors on either side of the wall in a `WallPath` [1]."""
    return 2 * math.ceil((3 * reach(chain)) / 2)


@dataclass(frozen=True)
class WallPath:
    """Static walls of one charge in an infinite chain, at all positions.

    If the walls are pinned (see the module docstring), the path contains only one wall position
    per two rotor spacings.

    A wall is stored as the angles of a window, which are M successive rotors around the wall. Wall
    positions in the fields below are relative to the first rotor of the window [rotor spacings].
    """

    charge: int
    base: int
    """First wall position of `spline`, which covers two rotor spacings."""
    spline: CubicSpline | None
    """Spline from the wall position to the window angles [rad], shape (M,); None if pinned."""
    resting: Array
    """Angles of the window at `rest_position` [rad], shape (M,)."""
    rest_position: float
    """Wall position of least energy; it is repeated every two rotor spacings."""
    left: Array
    """Angles of an even and an odd rotor far to the left of the wall [rad], shape (2,)."""
    barrier_speed: float = 0.0
    """Speed below which an anti-kink oscillates in a well of its energy [spacings/s]; 0 for
    kinks."""

    @property
    def pinned(self) -> bool:
        """Whether the path contains only one position per two rotor spacings."""
        return self.spline is None

    def window(self, position: float) -> tuple[int, Array, Array]:
        """Return the first rotor of the window, its angles and their derivatives.

        The angles [rad] and their derivatives with respect to the wall position [rad/spacing] have
        shape (M,).
        """
        if self.spline is None:
            shift = 2 * round((position - self.rest_position) / 2)
            return shift, self.resting, np.zeros_like(self.resting)
        shift = 2 * math.floor((position - self.base) / 2)
        within = position - shift
        return shift, self.spline(within), self.spline(within, 1)

    def nearest_allowed(self, position: float) -> float:
        """Return the position of this path nearest to `position` [rotor spacings]."""
        return self.nearest_minimum(position) if self.pinned else position

    def nearest_minimum(self, position: float) -> float:
        """Return the wall position of least energy nearest to `position` [rotor spacings]."""
        return self.rest_position + 2 * round((position - self.rest_position) / 2)

    def relative_angles(self, rotors: int, position: float) -> Array:
        """Return the angles minus those of the uniform state left of the wall [rad], (rotors,)."""
        first, angles, _ = self.window(position)
        relative = angles - np.tile(self.left, len(angles) // 2 + 1)[: len(angles)]
        added = _placed(rotors, first, relative)
        beyond = np.arange(max(first + len(angles), 0), rotors)
        added[beyond] = relative[-3:-1][(beyond - first - len(angles) + 1) % 2]
        return added

    def derivative(self, rotors: int, position: float) -> Array:
        """Return d(angles) / d(wall position) of all rotors [rad/spacing], shape (rotors,)."""
        first, _, slope = self.window(position)
        return _placed(rotors, first, slope)

    def nearest(self, angles: Array, position: float, within: float) -> float:
        """Return the position of the static wall nearest to the angles [rotor spacings].

        The search starts at `position`. Only rotors nearer than `within` [rotor spacings] to the
        wall count.
        """
        if self.pinned:
            return self.nearest_allowed(position)
        for _ in range(_GAUSS_STEPS):
            residual, slope = self._near(angles, position, within)
            size = float(slope @ slope)
            step = float(residual @ slope) / size
            step = min(max(step, -_LONGEST / math.sqrt(size)), _LONGEST / math.sqrt(size))
            position += step
            if abs(step) * math.sqrt(size) < _CLOSE:
                break
        return position

    def misfit(self, angles: Array, position: float, within: float) -> float:
        """Return the rms difference [rad] of `angles` from a static wall at `position`.

        Only rotors nearer than `within` [rotor spacings] to the wall count.
        """
        residual, _ = self._near(angles, position, within)
        return math.sqrt(float(residual @ residual) / max(len(residual), 1))

    def _near(self, angles: Array, position: float, within: float) -> tuple[Array, Array]:
        first, wall, slope = self.window(position)
        low, high = max(first, 0), min(first + len(wall), len(angles))
        near = np.abs(np.arange(low, high) - position) < within
        part = slice(low - first, high - first)
        return wrapped(angles[low:high] - wall[part])[near], slope[part][near]


def _placed(rotors: int, first: int, values: Array) -> Array:
    """Return an array of shape (rotors,): `values` from index `first` on, 0 elsewhere."""
    placed = np.zeros(rotors)
    numbers = np.arange(first, first + len(values))
    inside = (numbers >= 0) & (numbers < rotors)
    placed[numbers[inside]] = values[inside]
    return placed


def nearest_arc(orbit: Orbit, angles: Array, arc: float) -> float:
    """Return the arc length [rad] of the orbit point nearest to the angles; `arc` is a guess."""
    for _ in range(_GAUSS_STEPS):
        segment = orbit.segment(arc)
        end = segment.first + len(segment.angles)
        residual = wrapped(angles[segment.first : end] - segment.angles)
        size = float(segment.tangent @ segment.tangent)
        step = min(max(float(residual @ segment.tangent) / size, -_LONGEST), _LONGEST)
        arc += step
        if abs(step) < _CLOSE:
            break
    return arc


@cache
def wall_path(chain: Chain, charge: int, leg: int = 0) -> WallPath:
    """Return the static walls of a charge; `leg` is the orbit leg of a kink in a spinner."""
    beside = extent(chain)
    window = replace(chain, number_of_rotors=2 * beside + 3, deviations=NO_DEVIATIONS)
    positions = np.linspace(beside, beside + 2, _SAMPLES)
    if charge > 0:
        walls = np.unwrap([static_wall(window, position, leg) for position in positions], axis=0)
        walls[:, 0], walls[:, -1] = walls[:, 2], walls[:, -3]
        left = walls[0, 2:4] - wrapped(walls[0, 2:4] - chain.uniform_state(1)[:2])
        spline = CubicSpline(positions, walls)
        return WallPath(1, beside, spline, walls[0], float(positions[0]), left)
    left = continuum_anti_kink(window, beside)[:2]
    try:
        counted, found = anti_kink_path(window, beside)
    except ArithmeticError:
        rest_position, rest = resting_anti_kink(window, beside + 0.5)
        return WallPath(-1, beside, None, rest, rest_position, left)
    least = int(np.argmin(window.elastic_energy(found)))
    spline = CubicSpline(counted, found)
    speed = barrier_speed(window, counted, found)
    return WallPath(-1, beside, spline, found[least], float(counted[least]), left, speed)


_SETTLING = (60.0, 400.0)
"""Shortest and longest simulation in which a moving wall loses its phonons [time units]."""
_ABSORPTION = 0.5
"""Decay rate of rotors outside a moving wall, which absorbs the phonons [1 / time unit]."""
_BROKEN = 0.15
"""A wall counts as broken if its misfit, divided by the angle by which a wall turns a rotor, is
above this [1]."""
_STEP = 0.5
"""Interval between position measurements of a wall that is losing its phonons [time units]. After
each interval, the rates of the rotors far from the wall are reduced, so that phonons decay."""
_SLOWER = 0.8
"""After a wall was destroyed, the initial speed is multiplied by this for the next try [1]."""
_TRIES = 25
"""Largest number of initial speeds that are tried [1]; the last one is 1 / 200 of the first."""


@dataclass(frozen=True)
class SteadyWall:
    """Moving wall without phonons, stored as difference from a static wall at this position."""

    position: float
    """Wall position in the chain in which the wall was simulated [rotor spacings]."""
    first: int
    """Rotor of this chain to which the first element of `offsets` and of `rates` belongs."""
    offsets: Array
    """Angles minus the angles of the static wall [rad], shape (M,)."""
    rates: Array
    """Rates of the same rotors [rad/s], shape (M,)."""
    speed: float
    """Wall speed [rotor spacings / s]."""


def launch_speed(chain: Chain, share: float) -> float:
    """Return the initial speed [spacings/s] of a wall that settles at `share` [speed of sound].

    The speed follows from the energy of a wall in continuum theory, and is therefore approximate.
    """
    sound = speed_of_sound(chain) / chain.spacing
    return sound * math.sqrt(2 * (1 / math.sqrt(1 - share**2) - 1))


@lru_cache(maxsize=8)
def steady_wall(chain: Chain, leg: int, share: float) -> SteadyWall:
    """Return a wall without phonons that moves at about the speed `share` [speed of sound].

    The initial speed is `launch_speed`. If a wall of this speed breaks up in the simulation,
    slower walls are tried, and the first one that survives is returned. Raises ArithmeticError if
    all break up.
    """
    speed = launch_speed(chain, share)
    for _ in range(_TRIES):
        found = _settled(chain, wall_path(chain, 1, leg), speed)
        if found is not None:
            return found
        speed *= _SLOWER
    raise ArithmeticError(
        f'every moving wall is destroyed in a chain with d = {chain.lean_ratio:.4g}'
    )


def _settled(chain: Chain, path: WallPath, speed: float) -> SteadyWall | None:
    near, unit = reach(chain), chain.time_unit
    shortest, longest = _SETTLING
    time = min(max(2 * near / (speed * unit), shortest), longest)
    rotors = math.ceil(6 * near + 1.3 * speed * unit * time)
    lengths = chain.spacing, chain.rotor_length, chain.rest_angle
    long = Chain(rotors + rotors % 2, *lengths, chain.mass, chain.stiffness)
    static = left_of(long, 1) + path.relative_angles(long.number_of_rotors, 3 * near)
    rates = speed * path.derivative(long.number_of_rotors, 3 * near)
    simulation = ElasticSimulation(long, static, rates, _STEP * chain.time_unit, TOLERANCE)
    track = _positions(simulation, path, 3 * near, near, round(time / _STEP))
    if track is None:
        return None
    late = np.array(track[-len(track) // 3 :])
    found = float(np.polyfit(np.arange(len(late)), late, 1)[0]) / simulation.period
    if found <= 0:
        return None
    first = 2 * (round(track[-1] - 1.5 * near) // 2)
    window = slice(first, first + 2 * round(1.5 * near) + 1)
    static = left_of(long, 1) + path.relative_angles(long.number_of_rotors, track[-1])
    beside = wrapped(simulation.angles - static)[window]
    return SteadyWall(track[-1], first, beside, simulation.rates[window], found)


def _positions(
    simulation: ElasticSimulation, path: WallPath, position: float, near: float, frames: int
) -> list[float] | None:
    chain = simulation.chain
    rotors = np.arange(chain.number_of_rotors)
    absorbed = -math.expm1(-_ABSORPTION * _STEP) * chain.moments_of_inertia
    track = [position]
    for _ in range(frames):
        simulation.advance()
        simulation.kick(-absorbed * (np.abs(rotors - position) > near) * simulation.rates)
        ahead = track[-1] - track[-2] if len(track) > 1 else 0.0
        position = path.nearest(simulation.angles, track[-1] + ahead, near)
        track.append(position)
        inside = near < position < chain.number_of_rotors - 1 - near
        if not inside or is_broken(path, chain, simulation.angles, position, near):
            return None
    return track


def add_motion(wall: SteadyWall, shift: int, angles: Array, rates: Array, sense: int) -> None:
    """Add the offsets and rates of `wall`, shifted by `shift` rotors, to `angles` and `rates`.

    `angles` must contain a static wall at the shifted position. The wall moves to the right if
    `sense` is 1, and to the left if it is -1.
    """
    angles += _placed(len(angles), wall.first + shift, wall.offsets)
    rates += sense * _placed(len(rates), wall.first + shift, wall.rates)


def left_of(chain: Chain, charge: int) -> Array:
    """Return the uniform state to the left of a wall with the given charge [rad], shape (N,)."""
    if charge > 0:
        return chain.uniform_state(1)
    if chain.motion is Motion.SPINNER:
        return chain.uniform_state(1) + math.pi
    return chain.uniform_state(-1)


def is_broken(path: WallPath, chain: Chain, angles: Array, position: float, within: float) -> bool:
    """Return whether the rotors nearer than `within` [spacings] to `position` form no wall."""
    swing = math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle
    return path.misfit(angles, position, within) > _BROKEN * swing


def averages_and_slopes(
    values: Array,
    beside: int,
    breaks: Sequence[int] = (),
    cubic: bool = False,
    forced: bool = False,
) -> tuple[Array, Array]:
    """Return a moving average and a slope for each value.

    The average is over 2 b + 1 values around each index, with b = `beside`. The slope is the slope
    of a line, or of a cubic if `cubic` is true, that is fitted to 3 b values before and 3 b values
    after the index. No average and no fit extends across an index in `breaks`.

    `forced`, which requires `cubic`, is for chains with force terms. The fit then extends over 6 b
    values before and after the index. If the second derivative of the cubic is x'', the average is
    too large by x'' b (b + 1) / 6; this error is subtracted. If the wall starts or stops within
    the fit, the average is replaced by the value itself, and the slope by half the difference of
    both neighbours. The wall counts as stopped at values whose slope is below 2 % of the largest
    slope.
    """
    means, slopes = np.empty_like(values), np.empty_like(values)
    for begin, end in pairwise([0, *breaks, len(values)]):
        if end > begin:
            piece = values[begin:end]
            about = min(beside, len(piece) - 1)
            wide = min((FORCED_WINDOWS if forced else WINDOWS) * beside, len(piece) - 1)
            means[begin:end] = _convolved(piece, np.full(2 * about + 1, 1 / (2 * about + 1)))
            order = min(3 if cubic else 1, max(2 * wide - 1, 0))
            weights = savgol_coeffs(2 * wide + 1, order, deriv=1, use='dot')
            slopes[begin:end] = _convolved(piece, weights)
            if forced:
                curvature = savgol_coeffs(2 * wide + 1, order, deriv=2, use='dot')
                means[begin:end] -= _convolved(piece, curvature) * about * (about + 1) / 6
                near, differences = _near_stop(piece, wide)
                means[begin:end][near] = piece[near]
                slopes[begin:end][near] = differences[near]
    return means, slopes


def _near_stop(values: Array, beside: int) -> tuple[NDArray[np.bool_], Array]:
    differences = np.gradient(values)
    still = np.abs(differences) < _STOPPED * np.abs(differences).max()
    window = 2 * beside + 1
    stopped = still.astype(np.float64)
    changes = minimum_filter1d(stopped, window) < maximum_filter1d(stopped, window)
    return changes, differences


def _convolved(values: Array, weights: Array) -> Array:
    padded = np.pad(values, len(weights) // 2, mode='reflect', reflect_type='odd')
    return np.convolve(padded, weights[::-1], 'valid')
