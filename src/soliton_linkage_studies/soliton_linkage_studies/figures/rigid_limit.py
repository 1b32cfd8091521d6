# SPDX-License-Identifier: Apache-2.0
"""Convergence of chains of stiff springs to the chain of rigid bars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.solitons.track import follow
from soliton_linkage_studies.experiments import kick_rates
from soliton_linkage_studies.figure_report import FigureReport, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.palette import MEASURED, MECHANICS_COLOURS, THEORY, scale_colours
from soliton_linkage_studies.settings import Section


def convergence_order(stiffnesses: ArrayLike, distances: ArrayLike) -> float:
    """Return the order of convergence in 1 / k_e [1], fitted to the three largest stiffnesses.

    `distances` are the angle differences from rigid bars [rad], one per stiffness k_e. The
    stiffnesses must increase and may have any unit.
    """
    stiffest, nearest = np.log(np.asarray(stiffnesses)[-3:]), np.log(np.asarray(distances)[-3:])
    return -float(np.polyfit(stiffest, nearest, 1)[0])


def draw_convergence(axes: Axes, stiffnesses: ArrayLike, distances: ArrayLike, label: str) -> None:
    """Draw the angle differences from rigid bars [rad] as a function of stiffness (any unit).

    The differences are dots. Both axes are logarithmic. A dashed line of slope -1 passes through
    the dot of the last stiffness.
    """
    across, up = np.asarray(stiffnesses), np.asarray(distances)
    first_order = up[-1] * across[-1] / across
    axes.loglog(across, up, 'o', color=MEASURED, label=label)
    axes.loglog(across, first_order, '--', color=THEORY, label=r'order 1, $\propto 1/k_e$')
    axes.set(ylabel='largest angle deviation [rad]')
    axes.legend()


_CAPTION = """
Chains of stiff springs converge to the chain of rigid bars after the same kick. (a) Path of the
wall for multiples of the stiffness k_e (solid lines, paler for stiffer chains) and for rigid bars
(dashed red). The unit of time is √(M/k_e) of the softest chain. (b) Largest deviation of an angle
from the chain of rigid bars, over all rotors and times, against the stiffness (dots). The dashed
line has slope −1 and passes through the last dot.
"""
_TRACKED = 3
"""Number of the smallest stiffnesses whose wall paths are drawn [1]."""
_PATH = ('time [sqrt(M/k_e)]', 'wall at rotor [rotor spacings]')


@FIGURES.add('elastic_against_rigid')
def rigid_limit_figure(section: Section, quick: bool) -> FigureReport:
    """Draw wall paths for increasing stiffness, and differences of angles from rigid bars."""
    section.check_keys('chain', 'kick', 'duration', 'factors')
    chain = section.chain()
    factors = section.numbers('factors', 1.0, 1e9)
    duration = section.number('duration', 0.0, 1e6) * chain.time_unit
    rest = chain.uniform_state(1)
    rates = kick_rates(chain, rest, section.number('kick', 1e-6, 100.0))
    period = duration / 200
    rigid = RigidSimulation(chain, rest, rates, period).record(duration)
    report = new_report(_CAPTION, 11, 4.8)
    paths, distances = report.figure.subplots(1, 2)
    apart = []
    colours = scale_colours(_TRACKED)
    shown = factors[:3] if quick else factors
    for number, factor in enumerate(shown):
        stiff = replace(chain, stiffness=chain.stiffness * factor)
        elastic = simulate(stiff, rest, rates, duration, period)
        apart.append(float(np.abs(elastic.angles - rigid.angles).max()))
        times = elastic.times / chain.time_unit
        if number < _TRACKED:
            track = follow(stiff, elastic)
            where = ('a', f'k_e times {factor:g}')
            look = {'label': f'$k_e \\times {factor:g}$', 'color': colours[number]}
            report.plot(paths, where, _PATH, times, track.sites, linewidth=1.5, **look)
    look = {'color': MECHANICS_COLOURS['rigid'], 'label': 'rigid bars'}
    track, times = follow(chain, rigid), rigid.times / chain.time_unit
    report.plot(paths, ('a', 'rigid bars'), _PATH, times, track.sites, '--', **look)
    paths.set(xlabel=r'time [$\sqrt{M/k_e}$]', ylabel='wall position [rotor spacings]')
    paths.set_title('a  paths of the wall', loc='left')
    paths.legend()
    draw_convergence(distances, shown, apart, 'springs from bars')
    distances.set(xlabel='stiffness / stiffness of the chain [1]')
    distances.set_title('b  deviation from rigid bars', loc='left')
    names = ('stiffness / stiffness of the chain [1]', 'largest deviation of an angle [rad]')
    report.add_points('b', 'springs from bars', names, shown, apart)
    report.add_comparison(
        'order of the deviation of springs from rigid bars in 1/kₑ',
        'the linkage is the limit kₑ → ∞',
        'first order at fixed speed',
        convergence_order(shown, apart),
        1.0,
    )
    return report
