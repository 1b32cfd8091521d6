# SPDX-License-Identifier: Apache-2.0
"""Wave packets from the first rotor in simulations, and small vibrations about a wall.

A burst of n cycles turns rotor 0 by the torque

    tau(t) = I omega^2 A sin(omega t) sin(pi t omega / (2 pi n))^2,    0 < t < 2 pi n / omega,

where A [rad] is the amplitude of a free rotor of moment of inertia I. Wave packets propagate if
omega lies in the phonon band, with the group velocity d omega / dk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.bands import band_edges, dispersion
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.active.runs import wall_sites

_FIRST = 3
"""First rotor in the measurement of a velocity [1], outside the near field of the driven rotor."""
_TOLERANCE = 1e-8
"""Integration error per step [rad], far below the amplitudes of bursts."""


@dataclass(frozen=True)
class Burst:
    """Torque on the first rotor, with a Hann window."""

    frequency: float
    """Angular frequency [rad/s]."""
    cycles: float
    amplitude: float
    """Amplitude of a free rotor [rad]."""

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return 2 * math.pi * self.cycles / self.frequency

    def torque(self, inertia: float, time: float) -> float:
        """Return the torque at a time since the start [N m] on a moment of inertia [kg m^2]."""
        if not 0 < time < self.duration:
            return 0.0
        window = math.sin(math.pi * time / self.duration) ** 2
        largest = inertia * self.frequency**2 * self.amplitude
        return largest * window * math.sin(self.frequency * time)


@dataclass(frozen=True)
class WaveTask:
    """Task to send a burst into a chain, with or without a kink."""

    chain: Chain
    burst: Burst
    duration: float
    """[s]."""
    site: float | None = None
    """Initial site of the resting kink [rotor spacings]; None for the left-leaning state."""
    frames: int = 400

    def __call__(self) -> WaveRun:
        """Run the simulation and find the walls in each frame."""
        chain, inertia = self.chain, float(self.chain.moments_of_inertia[0])

        def force(time: float, angles: Array, _rates: Array) -> Array:
            torques = np.zeros_like(angles)
            torques[0] = self.burst.torque(inertia, time)
            return torques

        site = self.site
        angles = chain.uniform_state(-1) if site is None else static_wall(chain, site)
        simulation = ElasticSimulation(
            chain,
            angles,
            period=self.duration / self.frames,
            tolerance=_TOLERANCE,
            forces=[force],
            integrator='DOP853',
        )
        recording = simulation.record(self.duration)
        found = [wall_sites(chain, each) for each in recording.angles]
        last = math.nan if site is None else site
        sites = []
        for walls in found:
            near = [zero for zero, charge in walls if charge > 0 and abs(zero - last) < 2]
            last = min(near, key=lambda zero: abs(zero - last)) if near else math.nan
            sites.append(last)
        return WaveRun(recording, np.array(sites), len(found[-1]))


@dataclass(frozen=True)
class WaveRun:
    """Motion of a chain after a burst."""

    recording: Recording
    sites: Array
    """Site of the kink [rotor spacings], NaN if there is none, shape (T,)."""
    walls: int
    """Number of walls in the last frame."""

    @property
    def displacement(self) -> float:
        """Displacement of the kink [rotor spacings], the mean of the last fifth of the frames."""
        return float(np.mean(self.sites[-len(self.sites) // 5 :]) - self.sites[0])


def energy_per_rotor(chain: Chain, recording: Recording) -> Array:
    """Return the kinetic energy of each rotor plus half the energy of its springs [J], (T, N)."""
    of_springs = 0.5 * chain.stiffnesses * chain.spring_extensions(recording.angles) ** 2
    kinetic = 0.5 * chain.moments_of_inertia * recording.rates**2
    return kinetic + chain.gathered(of_springs / 2, of_springs / 2)


def group_velocity(chain: Chain, frequency: float) -> float:
    """Return abs(d omega / dk) of phonons [rotors/s]; 0 outside the band."""
    low, high = band_edges(chain)
    if not low < frequency < high:
        return 0.0

    def above(phase: float) -> float:
        return float(dispersion(chain, phase / chain.spacing)) - frequency

    phase, step = float(brentq(above, 1e-6, math.pi - 1e-6)), 1e-5
    return abs(above(phase + step) - above(phase - step)) / (2 * step)


def packet_velocity(chain: Chain, recording: Recording, last: int) -> float:
    """Return the velocity of a wave packet between rotors 3 and `last` [rotors/s].

    The packet arrives at a rotor when the energy of this rotor and its neighbours is largest.
    """
    energies = energy_per_rotor(chain, recording)
    smooth = energies[:, 2:-2] + energies[:, 1:-3] + energies[:, 3:-1]
    arrivals = recording.times[np.argmax(smooth, axis=0)]
    rotors = np.arange(2, chain.number_of_rotors - 2)
    used = (rotors >= _FIRST) & (rotors <= last)
    return float(1 / np.polyfit(rotors[used], arrivals[used], 1)[0])


@dataclass(frozen=True)
class Spectrum:
    """Small vibrations about a resting kink."""

    frequencies: Array
    """Angular frequencies [rad/s] in ascending order, shape (N,); the first is 0."""
    participations: Array
    """Number of rotors that take part in each mode, 1 / sum_n e_n^4, shape (N,)."""
    energy: float
    """Energy of the springs at rest [J]."""


def spectrum(chain: Chain, site: float) -> Spectrum:
    """Return the vibrations about a kink that rests at a site [rotor spacings].

    The modes e obey K e = omega^2 I e, with the stiffness matrix K of the resting chain.
    """
    angles = static_wall(chain, site)
    roots = np.sqrt(chain.moments_of_inertia)
    matrix = stiffness_matrix(chain, angles).toarray() / np.outer(roots, roots)
    squares, modes = np.linalg.eigh(matrix)
    return Spectrum(
        np.sqrt(np.maximum(squares, 0.0)),
        1 / (modes**4).sum(axis=0),
        float(chain.elastic_energy(angles)),
    )
