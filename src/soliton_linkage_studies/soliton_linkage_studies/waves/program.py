# SPDX-License-Identifier: Apache-2.0
"""Move walls and create walls by wave packets from the edge; show the results on one page."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from scipy.optimize import brentq

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linear.bands import band_edges, dispersion
from soliton_linkage.linear.normal_modes import normal_modes
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.active.runs import follow_charge, wall_sites
from soliton_linkage_studies.experiments import energy_per_rotor
from soliton_linkage_studies.figure_report import FigureReport, new_report, save_page
from soliton_linkage_studies.palette import BLACK, BLUE, GREY, ORANGE, PALE, RED, WHITE
from soliton_linkage_studies.program import run_parallel, study_command
from soliton_linkage_studies.settings import Section, load_settings, setting

_FIRST = 3
"""Index of the first rotor at which the arrival of a packet is timed [1]; rotors nearer to rotor 0
are in its near field."""
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
        """Displacement of the kink, averaged over the last fifth of the frames [spacings]."""
        return float(np.mean(self._last) - self.sites[0])

    @property
    def displacement_error(self) -> float:
        """Standard deviation of the site in the last fifth of the frames [rotor spacings]."""
        return float(np.std(self._last))

    @property
    def _last(self) -> Array:
        return self.sites[-len(self.sites) // 5 :]


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
    """Return the group velocity of phonons [rotor spacings/s], given their frequency [rad/s].

    The result is 0 for a frequency outside the phonon band.
    """
    low, high = band_edges(chain)
    if not low < frequency < high:
        return 0.0

    def above(phase: float) -> float:
        return float(dispersion(chain, phase / chain.spacing)) - frequency

    phase, step = float(brentq(above, 1e-6, math.pi - 1e-6)), 1e-5
    return abs(above(phase + step) - above(phase - step)) / (2 * step)


def packet_velocity(chain: Chain, recording: Recording, last: int) -> float:
    """Return the velocity of a wave packet between rotor 3 and rotor `last` [rotor spacings/s].

    The packet arrives at a rotor when the energy of this rotor and its two neighbours is largest.
    """
    energies = energy_per_rotor(chain, recording.angles, recording.rates)
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

    For the participation numbers, the modes of `normal_modes` are multiplied by the square roots
    of the moments of inertia.
    """
    angles = static_wall(chain, site)
    found = normal_modes(chain, angles)
    participations = 1 / (chain.moments_of_inertia**2 @ found.shapes**4)
    return Spectrum(found.frequencies, participations, float(chain.elastic_energy(angles)))


_CAPTION = """
Wave packets that a torque on rotor 0 sends into a chain with a resting kink, and into a uniform
chain.

(a) Energy of each rotor over time. The slope of the dashed lines is the group velocity of linear
theory; they start at the beginning and at the end of the burst. The red line is the zero of the
displacement u, which moves unevenly from rotor to rotor. The orange line is the site of the kink
that the analyser estimates. This site is proportional to the arc length of the orbit. Gaps of the
line are frames in which the analyser has lost the kink. (b) Displacement of the zero of u against
the angular frequency of the burst, for each amplitude, averaged over the last fifth of the
simulation. Error bars are the standard deviation in this time; they are long if the kink still
moves. Linear theory predicts no displacement outside the phonon band (grey). (c) Displacement of
the zero of u against the number of cycles of the burst.

(d) Number of walls in a uniform chain after a burst, against amplitude and angular frequency. The
dashed lines are the edges of the phonon band. (e) Angular frequencies of small vibrations about a
kink (dots) against its site; vibrations of few rotors are red. The grey band is the phonon band.
(f) Energy of the springs along the orbit, divided by k_e lbar²; there is no barrier above the
rounding error.
"""
_TITLES = {
    'a': 'a  Wave packet and kink',
    'b': 'b  Displacement of the kink against frequency',
    'c': 'c  Displacement of the kink against cycles',
    'd': 'd  Walls created in a uniform chain',
    'e': 'e  Vibrations about a kink',
    'f': 'f  Energy of a resting kink',
}
_FREQUENCY = 'angular frequency [rad/s]'
_MOVED = 'displacement [rotor spacings]'
_SITE = 'site [rotor spacings]'
_TIME = 'time [s]'
_FEW = 10.0
"""A vibration counts as localised if its participation number is below this [rotors]."""
_PACKET = (10.0, 0.01)
"""Cycles [1] and amplitude [rad] of the small burst whose packet velocity is measured."""
_SITES = 33
"""Number of kink sites, over two rotor spacings, at which the spectrum is computed [1]."""


@dataclass(frozen=True)
class WaveStudy:
    """Chain and bursts that a settings file specifies."""

    chain: Chain
    site: float
    """Initial site of the resting kink [rotor spacings]."""
    burst: Burst
    """Burst in panel a."""
    frequencies: tuple[float, ...]
    amplitudes: tuple[float, ...]
    cycles: tuple[float, ...]
    created_frequencies: tuple[float, ...]
    created_amplitudes: tuple[float, ...]
    duration: float = setting('duration of each simulation', 's', 0.01, 1e3)

    @staticmethod
    def read(settings: Section, quick: bool) -> WaveStudy:
        """Read the settings. Raises ValueError if they are invalid."""
        chain, every = settings.chain(), slice(None, None, 4 if quick else 1)
        kink, uniform, burst = (settings.section(key) for key in ('kink', 'uniform', 'burst'))
        kink.check_keys('frequencies', 'amplitudes', 'cycles')
        uniform.check_keys('frequencies', 'amplitudes')
        return WaveStudy(
            chain,
            settings.number('site', 0.5, chain.number_of_rotors - 1.5),
            Burst(**burst.values_of(Burst)),
            kink.numbers('frequencies', 1e-3, 1e6)[every],
            kink.numbers('amplitudes', 0.0, 10.0),
            kink.numbers('cycles', 0.5, 1e4)[every],
            uniform.numbers('frequencies', 1e-3, 1e6)[every],
            uniform.numbers('amplitudes', 0.0, 10.0)[every],
            **settings.values_of(WaveStudy, 'chain', 'site', 'burst', 'kink', 'uniform'),
        )

    @property
    def tasks(self) -> dict[tuple[Any, ...], WaveTask]:
        """All tasks. A key consists of the panel name and the parameter values."""
        burst, site = self.burst, self.site
        sent: dict[tuple[Any, ...], tuple[Burst, float | None]] = {
            ('a',): (burst, site),
            ('packet',): (Burst(burst.frequency, *_PACKET), None),
        }
        for size, frequency in product(self.amplitudes, self.frequencies):
            sent['b', size, frequency] = Burst(frequency, burst.cycles, size), site
        for size, cycles in product(self.amplitudes, self.cycles):
            sent['c', size, cycles] = Burst(burst.frequency, cycles, size), site
        for size, frequency in product(self.created_amplitudes, self.created_frequencies):
            sent['d', size, frequency] = Burst(frequency, burst.cycles, size), None
        return {
            key: WaveTask(self.chain, each, self.duration, place)
            for key, (each, place) in sent.items()
        }


Runs = Mapping[tuple[Any, ...], WaveRun]
"""Runs by the key of their task."""


def page(study: WaveStudy, runs: Runs) -> FigureReport:
    """Return the page with its data and the comparisons for the table."""
    report = new_report(_CAPTION, 11.0, 10.5)
    panels = report.figure.subplot_mosaic('ab;cd;ef')
    low, high = band_edges(study.chain)
    _draw_packet(report, panels['a'], study, runs['a',])
    frequency, last = study.burst.frequency, study.chain.number_of_rotors // 2
    report.add_comparison(
        f'velocity of a small packet [rotors/s] at {frequency:g} rad/s',
        '',
        'dω/dk',
        packet_velocity(study.chain, runs['packet',].recording, last),
        group_velocity(study.chain, frequency),
    )
    report.add_comparison(
        'displacement of the zero of u in panel a, 1 s after the centre of the packet [rotors]',
        '',
        '',
        _after_packet(study, runs['a',]),
    )
    for panel, axis in (('b', _FREQUENCY), ('c', 'cycles [1]')):
        for amplitude, colour in zip(study.amplitudes, (BLUE, RED, BLACK, GREY), strict=False):
            keys = [key for key in runs if key[:2] == (panel, amplitude)]
            x, moved = [key[2] for key in keys], [runs[key].displacement for key in keys]
            errors, series = [runs[key].displacement_error for key in keys], f'{amplitude:g} rad'
            look: Any = {'fmt': 'o-', 'color': colour, 'markersize': 4, 'label': series}
            panels[panel].errorbar(x, moved, errors, **look)
            report.add_points(panel, series, (axis, _MOVED), x, moved)
            report.add_points(panel, f'{series}: standard deviation', (axis, _MOVED), x, errors)
        panels[panel].set(xlabel=axis, ylabel=_MOVED)
        panels[panel].legend(fontsize='x-small')
    panels['b'].axvspan(low, high, color=PALE, zorder=0)
    _draw_created(report, panels['d'], study, runs)
    sites = study.chain.number_of_rotors / 2 + np.linspace(-1, 1, _SITES)
    _draw_spectra(report, panels, study.chain, sites)
    gap = [runs[key].displacement for key in runs if key[0] == 'b' and not low < key[2] < high]
    if gap:
        quantity = 'largest displacement by bursts in the gap'
        report.add_comparison(quantity, '', 'none', float(np.abs(gap).max()), 0.0)
    for name, axes in panels.items():
        axes.set_title(_TITLES[name], loc='left', fontsize='medium')
    return report


def _after_packet(study: WaveStudy, run: WaveRun) -> float:
    velocity = group_velocity(study.chain, study.burst.frequency)
    arrival = study.burst.duration / 2 + study.site / velocity
    frame = int(np.searchsorted(run.recording.times, arrival + 1.0))
    return float(run.sites[min(frame, len(run.sites) - 1)] - run.sites[0])


def _draw_packet(report: FigureReport, axes: Axes, study: WaveStudy, run: WaveRun) -> None:
    chain, times, burst = study.chain, run.recording.times, study.burst
    energies = energy_per_rotor(chain, run.recording.angles, run.recording.rates)
    largest = float(energies.max())
    extent = 0.0, float(times[-1]), -0.5, chain.number_of_rotors - 0.5
    look: Any = {'cmap': 'Greys', 'norm': LogNorm(1e-6 * largest, largest), 'extent': extent}
    shown = np.maximum(energies, 1e-6 * largest).T
    image = axes.imshow(shown, origin='lower', aspect='auto', **look)
    speed = group_velocity(chain, burst.frequency)
    for start in (0.0, burst.duration):
        axes.plot(times, speed * (times - start), '--', color=BLUE, linewidth=1)
    axes.figure.colorbar(image, ax=axes, label='energy of a rotor [J]')
    axes.plot(times, run.sites, color=RED, linewidth=1.5)
    names = _TIME, _SITE
    estimates = analysed_sites(chain, run.recording)
    report.plot(axes, ('a', 'analyser'), names, times, estimates, color=ORANGE, linewidth=1.5)
    axes.set(xlabel=_TIME, ylabel='rotor n [1]', ylim=(-0.5, chain.number_of_rotors - 0.5))
    report.add_points('a', 'kink', (_TIME, 'zero of u [rotor spacings]'), times, run.sites)


def _draw_created(report: FigureReport, axes: Axes, study: WaveStudy, runs: Runs) -> None:
    frequencies, amplitudes = study.created_frequencies, study.created_amplitudes
    counts = np.array([[runs['d', a, f].walls for f in frequencies] for a in amplitudes])
    image = axes.pcolormesh(frequencies, amplitudes, counts, cmap='Blues', shading='nearest')
    axes.figure.colorbar(image, ax=axes, label='walls [1]')
    for edge in band_edges(study.chain):
        axes.axvline(edge, color=WHITE, linewidth=2.5)
        axes.axvline(edge, color=BLACK, linestyle='--', linewidth=1)
    axes.set(xlabel=_FREQUENCY, ylabel='amplitude [rad]')
    axes.set_ylim(bottom=0)
    for amplitude, row in zip(amplitudes, counts, strict=True):
        report.add_points('d', f'{amplitude:g} rad', (_FREQUENCY, 'walls [1]'), frequencies, row)
    made = counts.max(axis=1) > 0
    if made.any():
        smallest = float(np.array(amplitudes)[made].min())
        report.add_comparison('smallest amplitude that creates a wall [rad]', '', '', smallest)
    report.add_comparison('largest number of created walls', '', '', float(counts.max()))


def _draw_spectra(
    report: FigureReport, panels: Mapping[str, Axes], chain: Chain, sites: Array
) -> None:
    found: list[Spectrum] = [spectrum(chain, float(site)) for site in sites]
    axes = panels['e']
    axes.axhspan(*band_edges(chain), color=PALE, zorder=0)
    for site, one in zip(sites, found, strict=True):
        few = one.participations < _FEW
        x = np.full(len(few), site)
        axes.plot(x[~few], one.frequencies[~few], '.', color=GREY, markersize=2)
        axes.plot(x[few], one.frequencies[few], '.', color=RED, markersize=4)
        report.add_points('e', 'localised', (_SITE, _FREQUENCY), x[few], one.frequencies[few])
    axes.set(xlabel=_SITE, ylabel=_FREQUENCY)
    highest = [float(one.frequencies[-1]) for one in found]
    for name, value in (('lowest', min(highest)), ('highest', max(highest))):
        quantity = f'{name} frequency of the uppermost localised vibration [rad/s]'
        report.add_comparison(quantity, '', '', value)
    energies = np.array([one.energy for one in found])
    energies /= chain.stiffness * chain.rest_length**2
    panels['f'].plot(sites, energies, '.-', color=BLUE)
    panels['f'].set(xlabel=_SITE, ylabel='V / (k_e lbar²) [1]')
    report.add_points('f', 'energy', (_SITE, 'V / (k_e lbar^2) [1]'), sites, energies)
    barrier = float(np.ptp(energies))
    report.add_comparison('Peierls-Nabarro barrier / (k_e lbar²)', '', 'none', barrier, 0.0)


def _waves(options: argparse.Namespace) -> str:
    study = WaveStudy.read(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    runs = run_parallel('waves', study.tasks, options.workers)
    return save_page(page(study, runs), options.output, 'waves')


main = study_command(_waves, 'no new files are written', 'waves', __doc__, 'fewer runs')
