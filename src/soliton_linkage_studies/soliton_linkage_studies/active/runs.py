# SPDX-License-Identifier: Apache-2.0
"""Theory and simulations of walls in chains with non-reciprocal coupling.

A wall at the site x moves along its orbit q(x) of the coordinates of `Chain.signs`, with
t = dq/dx. In equilibrium the motors provide the power that linear damping c dissipates,

    kappa x_dot g(x) = c x_dot^2 sum_n t_n^2,    g = sum_n (q_n - q_{n+1}) (t_n + t_{n+1}).

The sum of the squares is the same at all sites, so that the terminal velocity is

    v = (kappa / c) <g> / sum_n t_n^2,

with the mean of g over two rotors. For wide walls the ratio of the two sums tends to 2. The sign
of the charge cancels. An anti-kink has an elastic energy V(x) and is pinned if kappa g < dV/dx at
a site.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.bands import dispersion
from soliton_linkage.linkage.chain import Array, Chain, displacement, wrapped
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.anti_kink import anti_kink_path, continuum_anti_kink
from soliton_linkage.solitons.static_wall import static_wall

_SAMPLES = 65
"""Samples of the orbit over two rotors [1]: splines through them are accurate to 1e-6."""
_FROM_END = 8
"""Number of rotors near each end that a measured velocity excludes [1]."""
_STARTUP = 4.0
"""Initial time that a measured velocity excludes, in decay times M r^2 / c of the rates [1]."""
_PIECES = 8
"""Number of pieces of a track whose slopes give the standard error of a velocity [1]."""
_TOLERANCE = 1e-11
"""Integration error per step [rad]: the energy balance of a run then closes to 1e-6."""


@dataclass(frozen=True)
class WallDrive:
    """Effect of motors on a wall, computed along its orbit."""

    ratio: float
    """Terminal velocity divided by kappa / c [rotor spacings]."""
    pinning: float
    """Non-reciprocity below which a resting wall is pinned [N m/rad]; 0 for kinks."""


def wall_drive(chain: Chain, charge: int) -> WallDrive:
    """Return the effect of motors on a kink (+1) or an anti-kink (-1).

    The chain must be so long that the tails of a wall in its middle have decayed at the ends.
    Raises ArithmeticError for an anti-kink without a path of stable states.
    """
    begin = chain.number_of_rotors / 2 - 1
    if charge > 0:
        sites = np.linspace(begin, begin + 2, _SAMPLES)
        states = np.unwrap([static_wall(chain, site) for site in sites], axis=0)
    else:
        sites, states = anti_kink_path(chain, begin)
    slopes = CubicSpline(sites, chain.signs * states)(sites, 1)
    of_bonds = wrapped(-np.diff(coordinates(chain, states)))
    drive = (of_bonds * (slopes[:, :-1] + slopes[:, 1:])).sum(axis=1)
    squares = (slopes**2).sum(axis=1)
    rise = CubicSpline(sites, chain.elastic_energy(states))(sites, 1)
    means = [CubicSpline(sites, each).integrate(sites[0], sites[-1]) for each in (drive, squares)]
    pinning = 0.0 if charge > 0 else float((rise / drive).max())
    return WallDrive(float(means[0] / means[1]), pinning)


def stability_limit(chain: Chain) -> float:
    """Return kappa / c [1/s] above which waves grow in a uniform chain.

    A wave of wave number k obeys I lambda^2 + c lambda + I omega(k)^2 + 2 i kappa sin(k) = 0 and
    decays if 2 kappa abs(sin(k)) < c omega(k). The limit is the smallest omega / (2 sin(k)).
    """
    waves = np.linspace(1e-3, math.pi - 1e-3, 2000)
    return float((dispersion(chain, waves / chain.spacing) / (2 * np.sin(waves))).min())


def coordinates(chain: Chain, angles: Array) -> Array:
    """Return the coordinates of `Chain.signs` [rad], shape (..., N)."""
    return np.asarray(chain.signs * angles + (1 - chain.signs) * math.pi / 2)


def wall_sites(chain: Chain, angles: Array) -> list[tuple[float, int]]:
    """Return site [rotor spacings] and charge of each zero of the displacement, in order.

    Edge rotors are excluded, because each has two rest angles.
    """
    u = displacement(chain, angles)[1:-1]
    left = np.flatnonzero(np.signbit(u[1:]) != np.signbit(u[:-1]))
    sites = 1 + left + u[left] / (u[left] - u[left + 1])
    return [(float(site), 1 if u[n] > 0 else -1) for site, n in zip(sites, left, strict=True)]


@dataclass(frozen=True)
class ActiveRun:
    """Motion of a chain with motors and the track of one wall."""

    recording: Recording
    sites: Array
    """Site of the tracked wall [rotor spacings], NaN after it has vanished, shape (T,)."""
    injected: Array
    """Power of the motors [W], shape (T,)."""
    dissipated: Array
    """Power that the damping dissipates [W], shape (T,)."""
    walls: int
    """Number of walls in the last frame."""
    imbalance: float
    """Error of the energy balance with motors and damping, relative to the largest energy [1]."""


@dataclass(frozen=True)
class ActiveTask:
    """Task to simulate a chain with motors from a state."""

    chain: Chain
    angles: Array
    rates: Array
    duration: float
    """[s]."""
    period: float
    """[s]."""
    charge: int
    """Charge of the tracked wall, the first wall of this charge."""
    fixed: bool = False
    """Whether the end rotors are fixed; otherwise kinks may enter at an end that leans away from a
    wall."""

    def __call__(self) -> ActiveRun:
        """Run the simulation and track the wall."""
        chain = self.chain
        start = chain, self.angles, self.rates, self.period, _TOLERANCE
        ends = (0, chain.number_of_rotors - 1) if self.fixed else ()
        simulation = ElasticSimulation(*start, fixed=ends)
        recording = simulation.record(self.duration)
        energies = chain.elastic_energy(recording.angles) + chain.kinetic_energy(recording.rates)
        gained = energies[-1] - energies[0] + simulation.dissipated
        found = [wall_sites(chain, angles) for angles in recording.angles]
        kappas = chain.non_reciprocities[: chain.number_of_rotors - 1]
        of_bonds = kappas * wrapped(-np.diff(coordinates(chain, recording.angles)))
        rates = recording.rates * chain.signs
        injected = (of_bonds * (rates[:, :-1] + rates[:, 1:])).sum(axis=1)
        return ActiveRun(
            recording,
            follow_charge(found, self.charge),
            injected,
            (chain.dampings * recording.rates**2).sum(axis=1),
            len(found[-1]),
            float(abs(gained) / energies.max()),
        )


def follow_charge(found: Sequence[Sequence[tuple[float, int]]], charge: int) -> Array:
    """Return the site of the first wall of a charge in each frame, NaN after it has vanished.

    In the next frame, the same wall is the nearest wall of this charge within two rotors.
    """
    sites, last = np.full(len(found), math.nan), math.nan
    for frame, walls in enumerate(found):
        known = [site for site, sign in walls if sign == charge]
        if frame:
            known = [site for site in known if abs(site - last) <= 2]
        if not known:
            break
        last = known[0] if not frame else min(known, key=lambda site: abs(site - last))
        sites[frame] = last
    return sites


def terminal_velocity(task: ActiveTask, run: ActiveRun) -> tuple[float, float]:
    """Return the velocity of the wall after its startup and its standard error [rotors/s].

    Both are NaN if fewer than eight frames show the wall after the startup and far from the ends.
    """
    decay = task.chain.moment_of_inertia / task.chain.damping
    last = task.chain.number_of_rotors - 1 - _FROM_END
    times, sites = run.recording.times, run.sites
    with np.errstate(invalid='ignore'):
        used = (times > _STARTUP * decay) & (sites > _FROM_END) & (sites < last)
    if used.sum() < _PIECES * 2:
        return math.nan, math.nan
    times, sites = times[used], sites[used]
    pieces = np.array_split(np.arange(len(times)), _PIECES)
    slopes = [np.polyfit(times[piece], sites[piece], 1)[0] for piece in pieces]
    error = float(np.std(slopes, ddof=1)) / math.sqrt(_PIECES)
    return float(np.polyfit(times, sites, 1)[0]), error


def moving(chain: Chain, site: float, charge: int, velocity: float) -> tuple[Array, Array]:
    """Return angles [rad] and rates [rad/s] of a wall with a velocity [rotors/s], (N,) each."""
    build = static_wall if charge > 0 else continuum_anti_kink
    here = build(chain, site)
    ahead = build(chain, site + _AHEAD)
    return here, np.asarray(wrapped(ahead - here)) * velocity / _AHEAD


_AHEAD = 1e-4
"""Step of a finite difference along an orbit [rotor spacings]."""


def motorised(chain: Chain, decay: float, ratio: float) -> Chain:
    """Return a chain with a decay rate c / (M r^2) [1/s] and a ratio kappa / c [1/s]."""
    damping = decay * chain.moment_of_inertia
    return replace(chain, damping=damping, non_reciprocity=ratio * damping)


def outcome(task: ActiveTask, run: ActiveRun) -> str:
    """Return the fate of a wall: 'runs', 'is pinned', 'breaks up' or 'vanishes'.

    A wall runs if it reaches the last rotors or moves by a rotor in the last quarter of the time.
    """
    sites = run.sites[np.isfinite(run.sites)]
    if not len(sites):
        return 'vanishes'
    if sites[-1] > task.chain.number_of_rotors - 1 - _FROM_END:
        return 'runs'
    if len(sites) < len(run.sites):
        return 'vanishes'
    if run.walls > 1:
        return 'breaks up'
    return 'runs' if sites[-1] - sites[-len(sites) // 4] > 1 else 'is pinned'
