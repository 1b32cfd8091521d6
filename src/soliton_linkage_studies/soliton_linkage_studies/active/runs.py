# SPDX-License-Identifier: Apache-2.0
"""Theory and simulations of walls in chains with non-reciprocal coupling.

The site x is the position of a wall along the chain. A chain with a wall at the site x has the
coordinates q(x): q_n = phi_n if `Chain.signs` is +1 for the rotor n, and q_n = pi - phi_n if it is
-1. The tangent is t = dq/dx. Motors with the non-reciprocity kappa apply the torque kappa (q_n -
q_{n+1}) to both coordinates q_n and q_{n+1} of each bond. At the terminal velocity x_dot, the
power of the motors equals the power that the linear damping c dissipates:

    kappa x_dot g(x) = c x_dot^2 sum_n t_n^2,    g = sum_n (q_n - q_{n+1}) (t_n + t_{n+1}).

The site is defined as the arc length of the curve q(x), divided by the arc length per rotor
spacing. Therefore the sum of t_n^2 does not depend on x. The terminal velocity, averaged over two
rotor spacings, is then v = (kappa / c) <g> / sum_n t_n^2 with the mean <g> over the same
distance. For wide walls, v tends to 2 kappa / c, both for kinks and for anti-kinks. The elastic
energy V(x) of an anti-kink depends on x. The anti-kink is pinned if kappa g < dV/dx at one site or
more.
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
"""Number of samples of the orbit over two rotor spacings [1]; the spline error is 1e-6."""
_FROM_END = 8
"""Velocities are measured while the wall is more than this number of rotors from both ends [1]."""
_STARTUP = 4.0
"""Velocities are measured from this time on [decay times M r^2 / c]."""
_PIECES = 8
"""Number of pieces of a track [1]. The scatter of their slopes gives the standard error of the
velocity."""
_TOLERANCE = 1e-11
"""Largest integration error of an angle per step [rad]; the energy balance then closes to 1e-6."""


@dataclass(frozen=True)
class WallDrive:
    """Effect of the motors on a wall, computed from walls at rest in a chain without motors."""

    ratio: float
    """Terminal velocity divided by kappa / c [rotor spacings]."""
    pinning: float
    """Smallest non-reciprocity that moves a wall at rest [N m/rad]; 0 for kinks."""
    squares: float
    """Sum of t_n^2 over all rotors for the tangent t [rad^2]. It is averaged over the sites of the
    wall, because interpolation errors vary from site to site."""

    def velocity(self, chain: Chain) -> float:
        """Return the terminal velocity in a chain with motors [rotor spacings/s]."""
        return chain.non_reciprocity / chain.damping * self.ratio


def wall_drive(chain: Chain, charge: int) -> WallDrive:
    """Return the effect of the motors on a kink (charge +1) or an anti-kink (charge -1).

    The chain must be so long that the tails of a wall in the middle of the chain decay before the
    ends. Raises ArithmeticError if the anti-kink states of least energy at each site do not form a
    continuous path (see `anti_kink_path`).
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
    mean_drive, mean_squares = (float(each) / (sites[-1] - sites[0]) for each in means)
    return WallDrive(mean_drive / mean_squares, pinning, mean_squares)


def stability_limit(chain: Chain) -> float:
    """Return the largest ratio kappa / c [1/s] at which all waves in a uniform chain decay.

    A wave whose phase increases by k from rotor to rotor is proportional to exp(lambda t) with

        I lambda^2 + c lambda + I omega(k)^2 + 2 i kappa sin(k) = 0

    for the moment of inertia I and the phonon frequency omega. The wave decays if 2 kappa
    abs(sin(k)) < c omega(k).
    """
    waves = np.linspace(1e-3, math.pi - 1e-3, 2000)
    return float((dispersion(chain, waves / chain.spacing) / (2 * np.sin(waves))).min())


def coordinates(chain: Chain, angles: Array) -> Array:
    """Return the coordinates q that the module docstring defines [rad], shape (..., N)."""
    return np.asarray(chain.signs * angles + (1 - chain.signs) * math.pi / 2)


def wall_sites(chain: Chain, angles: Array) -> list[tuple[float, int]]:
    """Return the site [rotor spacings] and the charge of each wall, in the order of sites.

    A wall is a zero of the displacement u = r sin(phi), interpolated linearly between two rotors.
    At a kink (charge +1), u changes from positive to negative along the chain. Edge rotors are
    excluded: an edge rotor has two rest angles, because it has only one spring. At one of them, u
    may have the other sign without a wall. Both this site and the x of the module docstring
    increase by 2 while a wall moves by two rotor spacings. In between they differ slightly.
    """
    u = displacement(chain, angles)[1:-1]
    left = np.flatnonzero(np.signbit(u[1:]) != np.signbit(u[:-1]))
    sites = 1 + left + u[left] / (u[left] - u[left + 1])
    return [(float(site), 1 if u[n] > 0 else -1) for site, n in zip(sites, left, strict=True)]


@dataclass(frozen=True)
class ActiveRun:
    """Motion of a chain with motors in T frames, and the track of one wall."""

    chain: Chain
    recording: Recording
    sites: Array
    """Site of the tracked wall [rotor spacings], shape (T,); NaN after the wall has vanished."""
    injected: Array
    """Power of the motors [W], shape (T,)."""
    dissipated: Array
    """Power that the damping dissipates [W], shape (T,)."""
    walls: int
    """Number of walls in the last frame."""
    imbalance: float
    """Error of the energy balance with motors and damping, divided by the largest energy [1]."""


@dataclass(frozen=True)
class ActiveTask:
    """Task to simulate a chain with motors and to track the first wall of a given charge."""

    chain: Chain
    angles: Array
    """Initial angles [rad], shape (N,)."""
    rates: Array
    """Initial angular velocities [rad/s], shape (N,)."""
    duration: float
    """Duration of the simulation [s]."""
    period: float
    """Frame period [s]."""
    charge: int
    """Charge of the tracked wall: +1 for a kink, -1 for an anti-kink."""
    fixed: bool = False
    """Whether both end rotors are fixed, so that no kink can enter the chain there."""

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
            chain,
            recording,
            follow_charge(found, self.charge),
            injected,
            (chain.dampings * recording.rates**2).sum(axis=1),
            len(found[-1]),
            float(abs(gained) / energies.max()),
        )


def follow_charge(found: Sequence[Sequence[tuple[float, int]]], charge: int) -> Array:
    """Track one wall of a given charge; return its site in each frame [rotor spacings].

    The track starts at the first wall of this charge in the first frame. In each later frame it
    continues with the nearest wall of this charge, at most two rotor spacings from the previous
    site. If no such wall exists, the wall has vanished, and all later sites are NaN.
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


def terminal_velocity(run: ActiveRun) -> tuple[float, float]:
    """Return the terminal velocity of the wall and its standard error [rotor spacings/s].

    Frames are used after four decay times, while the wall is more than eight rotors away from both
    ends. Both results are NaN for fewer than 16 such frames.
    """
    decay = run.chain.moment_of_inertia / run.chain.damping
    last = run.chain.number_of_rotors - 1 - _FROM_END
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
    """Return angles [rad] and rates [rad/s] of a wall that moves at `velocity` [spacings/s]."""
    build = static_wall if charge > 0 else continuum_anti_kink
    here = build(chain, site)
    ahead = build(chain, site + _AHEAD)
    return here, np.asarray(wrapped(ahead - here)) * velocity / _AHEAD


_AHEAD = 1e-4
"""Step of the finite difference that gives the tangent of the orbit [rotor spacings]."""


def motorised(chain: Chain, decay: float, ratio: float) -> Chain:
    """Return the chain with the given decay rate c / (M r^2) [1/s] and ratio kappa / c [1/s]."""
    damping = decay * chain.moment_of_inertia
    return replace(chain, damping=damping, non_reciprocity=ratio * damping)


def outcome(run: ActiveRun) -> str:
    """Return the final state of a wall: 'runs', 'is pinned', 'breaks up' or 'vanishes'.

    The first of these conditions that holds decides. The wall runs if its last known site is less
    than eight rotors from the last rotor of the chain. It vanishes if it is not found in the last
    frame. It breaks up if the last frame contains more than one wall. It runs if it has moved by
    more than one rotor spacing in the last quarter of the frames. Otherwise it is pinned.
    """
    sites = run.sites[np.isfinite(run.sites)]
    if not len(sites):
        return 'vanishes'
    if sites[-1] > run.chain.number_of_rotors - 1 - _FROM_END:
        return 'runs'
    if len(sites) < len(run.sites):
        return 'vanishes'
    if run.walls > 1:
        return 'breaks up'
    return 'runs' if sites[-1] - sites[-len(sites) // 4] > 1 else 'is pinned'
