# SPDX-License-Identifier: Apache-2.0
"""Simulations of wave packets in chains with and without a kink."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linear.bands import band_edges, dispersion
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.active.runs import follow_charge, wall_sites
from soliton_linkage_studies.settings import setting

_FIRST = 3
"""First rotor at which the arrival of a packet is timed [1], outside the near field of rotor 0."""
_TOLERANCE = 1e-8
"""Largest integration error of an angle per step [rad], far smaller than amplitudes of bursts."""


@dataclass(frozen=True)
class Burst:
    """Burst of torque on rotor 0: a sine with a Hann window.

    The torque of a burst of n cycles is

        tau(t) = I omega^2 A sin(omega t) sin(pi t omega / (2 pi n))^2,    0 < t < 2 pi n / omega

    with the moment of inertia I. Without the window, a free rotor would oscillate with the
    amplitude A [rad]. If omega lies in the phonon band, the burst starts a wave packet that moves
    at the group velocity d omega / dk.
    """

    frequency: float = setting('angular frequency omega', 'rad/s', 1e-3, 1e6)
    cycles: float = setting('number of cycles n', '1', 0.5, 1e4)
    amplitude: float = setting('amplitude A', 'rad', 0.0, 10.0)

    @property
    def duration(self) -> float:
        """Duration of the burst [s]."""
        return 2 * math.pi * self.cycles / self.frequency

    def torque(self, inertia: float, time: float) -> float:
        """Return the torque [N m] on a rotor of `inertia` [kg m^2], `time` [s] after the start."""
        if not 0 < time < self.duration:
            return 0.0
        window = math.sin(math.pi * time / self.duration) ** 2
        largest = inertia * self.frequency**2 * self.amplitude
        return largest * window * math.sin(self.frequency * time)


@dataclass(frozen=True)
class WaveTask:
    """Task to send a burst into a chain at rest, with or without a kink."""

    chain: Chain
    burst: Burst
    duration: float
    """Duration of the simulation [s]."""
    site: float | None = None
    """Initial site of the kink [rotor spacings]; None for a left-leaning chain without a kink."""
    frames: int = 400

    def __call__(self) -> WaveRun:
        """Run the simulation and find the walls in each frame."""
        chain, inertia = self.chain, float(self.chain.moments_of_inertia[0])

        def force(time: float, angles: Array, _rates: Array) -> Array:
            torques = np.zeros_like(angles)
            torques[0] = self.burst.torque(inertia, time)
            return torques

        at_rest = chain.uniform_state(-1)
        angles = at_rest if self.site is None else static_wall(chain, self.site)
        start = chain, angles, None, self.duration / self.frames, _TOLERANCE
        simulation = ElasticSimulation(*start, forces=[force], integrator='DOP853')
        recording = simulation.record(self.duration)
        found = [wall_sites(chain, each) for each in recording.angles]
        return WaveRun(recording, follow_charge(found, 1), len(found[-1]))


@dataclass(frozen=True)
class WaveRun:
    """Motion of a chain after a burst."""

    recording: Recording
    sites: Array
    """Site of the kink in each frame [rotor spacings], shape (T,); NaN without a kink."""
    walls: int
    """Number of walls in the last frame."""

    @property
    def displacement(self) -> float:
        """Mean displacement of the kink in the last fifth of the frames [rotor spacings]."""
        return float(np.mean(self._last) - self.sites[0])

    @property
    def displacement_error(self) -> float:
        """Standard deviation of the site in the last fifth of the frames [rotor spacings]."""
        return float(np.std(self._last))

    @property
    def _last(self) -> Array:
        return self.sites[-len(self.sites) // 5 :]


def energy_per_rotor(chain: Chain, recording: Recording) -> Array:
    """Return the kinetic energy of each rotor plus half the energy of its springs [J], (T, N)."""
    of_springs = 0.5 * chain.stiffnesses * chain.spring_extensions(recording.angles) ** 2
    kinetic = 0.5 * chain.moments_of_inertia * recording.rates**2
    return kinetic + chain.gathered(of_springs / 2, of_springs / 2)


def analysed_sites(chain: Chain, recording: Recording) -> Array:
    """Return the site that the analyser estimates in each frame [rotor spacings], shape (T,).

    The site is NaN if the analyser does not find exactly one wall.
    """
    analyser, sites = Analyser(chain), []
    for time, angles in zip(recording.times, recording.angles, strict=True):
        analysis = analyser.analyse(round(1e9 * time), angles)
        walls = analysis.solitons if analysis else ()
        sites.append(walls[0].rotor if len(walls) == 1 else math.nan)
    return np.array(sites)


def group_velocity(chain: Chain, frequency: float) -> float:
    """Return the group velocity of phonons [rotor spacings/s], 0 if none has this `frequency`."""
    low, high = band_edges(chain)
    if not low < frequency < high:
        return 0.0

    def above(phase: float) -> float:
        return float(dispersion(chain, phase / chain.spacing)) - frequency

    phase, step = float(brentq(above, 1e-6, math.pi - 1e-6)), 1e-5
    return abs(above(phase + step) - above(phase - step)) / (2 * step)


def packet_velocity(chain: Chain, recording: Recording, last: int) -> float:
    """Return the velocity of a wave packet between rotor 3 and rotor `last` [rotor spacings/s].

    The packet arrives at a rotor at the time of the largest energy of this rotor and its two
    neighbours.
    """
    energies = energy_per_rotor(chain, recording)
    smooth = energies[:, 2:-2] + energies[:, 1:-3] + energies[:, 3:-1]
    arrivals = recording.times[np.argmax(smooth, axis=0)]
    rotors = np.arange(2, chain.number_of_rotors - 2)
    used = (rotors >= _FIRST) & (rotors <= last)
    return float(1 / np.polyfit(rotors[used], arrivals[used], 1)[0])


@dataclass(frozen=True)
class Spectrum:
    """Normal modes of small vibrations about a resting kink."""

    frequencies: Array
    """Angular frequencies [rad/s] in ascending order, shape (N,). The first one is 0."""
    participations: Array
    """Participation number 1 / sum_n e_n^4 of each mode e with |e| = 1 [rotors], shape (N,)."""
    energy: float
    """Elastic energy of the chain with the resting kink [J]."""


def spectrum(chain: Chain, site: float) -> Spectrum:
    """Return the small vibrations about a kink that rests at a site [rotor spacings].

    The modes e obey K e = omega^2 I e with the stiffness matrix K and the moments of inertia I.
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
