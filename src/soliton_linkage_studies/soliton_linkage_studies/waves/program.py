# SPDX-License-Identifier: Apache-2.0
"""Move walls and create walls by wave packets from the edge; show the results on one page."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.figure_report import FigureReport, save_page
from soliton_linkage_studies.palette import BLACK, BLUE, GREY, ORANGE, PALE, RED, WHITE
from soliton_linkage_studies.program import run_parallel, study_command
from soliton_linkage_studies.settings import Section, load_settings, setting
from soliton_linkage_studies.waves.runs import (
    Burst,
    Spectrum,
    WaveRun,
    WaveTask,
    analysed_sites,
    energy_per_rotor,
    group_velocity,
    packet_velocity,
    spectrum,
)

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


def page(study: WaveStudy, runs: Mapping[tuple[Any, ...], WaveRun]) -> FigureReport:
    """Return the page with its data and the comparisons for the table."""
    report = FigureReport(Figure(figsize=(11.0, 10.5), layout='constrained'), _CAPTION)
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
    energies = energy_per_rotor(chain, run.recording)
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


def _draw_created(
    report: FigureReport, axes: Axes, study: WaveStudy, runs: Mapping[tuple[Any, ...], WaveRun]
) -> None:
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
    report: FigureReport, panels: Mapping[str, Axes], chain: Chain, sites: np.ndarray[Any, Any]
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
