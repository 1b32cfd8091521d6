# SPDX-License-Identifier: Apache-2.0
"""Figures of overshoot and oscillations next to wobbling walls (paper, Figs. S1 and S2)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage_studies import experiments
from soliton_linkage_studies.drawing import shape
from soliton_linkage_studies.figure_report import FigureReport, Formula, chain_formula, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.palette import GREY, MARKERS, MEASURED, PAPER, THEORY, chain_colours
from soliton_linkage_studies.settings import Section

_PROFILES = """
Wall profiles of wobbling flippers (paper, Fig. S1): displacements u = r sin φ of the rotors in
units of the rest value ū = r sin θ̄, against the distance from the wall. Each chain of rigid bars
has its own marker and shade. Its {count} snapshots cover a slow motion of the wall by one rotor
spacing. Grey lines: uniform states ±ū. The rotors overshoot these states on both sides of the
wall, and the overshoot increases with d = 2 r sin θ̄ / a.
"""
_TAILS = """
Oscillations next to walls of wobbling flippers, one row for each chain (paper, Fig. S2). Dots:
{count} snapshots of a slow motion of rigid bars. (a) Deviation of u from the tanh profile of
flippers, in units of the rotor spacing a. (b) Deviation of u from the uniform state ū = r sin θ̄,
on a logarithmic scale. Lines: decaying oscillation that changes sign from rotor to rotor, fitted
to the dots beyond 1.5 rotor spacings; (b) shows its envelope. Decay length: exact penetration
depth ℓ of the zero mode (black), or r sin θ̄ of the paper (dashed red).
"""
_BEYOND = 'rotors from the wall [rotor spacings]'
_QUICK_SNAPSHOTS = 4
"""Number of snapshots of each chain in a quick figure [1]."""
_BESIDE = 10
"""Largest distance from a wall at which the oscillation is drawn [rotor spacings]."""
_NEAR = 1.5
"""Smallest distance from a wall at which the oscillation is fitted [rotor spacings]."""


@FIGURES.add('figure_s1')
def figure_s1(section: Section, quick: bool) -> FigureReport:
    """Draw profiles of slowly moving walls in wobbling flippers (paper, Fig. S1)."""
    section.check_keys('chains')
    chains = list(section.chains().values())
    count = _QUICK_SNAPSHOTS if quick else experiments.SNAPSHOTS
    report = new_report(_PROFILES.format(count=count), 9, 5.5)
    axes = report.figure.subplots()
    for chain, colour, marker in zip(chains, chain_colours(chains), MARKERS, strict=False):
        seen = _slow_snapshots(chain, count)
        near = np.abs(seen.distances) < 9
        name, names = shape(chain), (experiments.DISTANCE_LABEL, 'u / ub [1]')
        points = seen.distances[near], seen.fields[near]
        look: Any = {'color': colour, 'markersize': 4, 'label': name}
        report.plot(axes, ('', name), names, *points, marker, **look)
        _compare_overshoot(report, chain)
    for side, label in ((1, 'uniform states ±ū'), (-1, None)):
        axes.axhline(side, color=GREY, linewidth=0.8, label=label)
    axes.set(xlabel='distance from the wall n − X [rotor spacings]', ylabel='u / ū [1]')
    axes.set_title(f'wobbling flippers overshoot: {count} snapshots of each chain')
    axes.legend()
    return report


@FIGURES.add('figure_s2')
def figure_s2(section: Section, quick: bool) -> FigureReport:
    """Draw oscillations next to walls, and the theory of their decay (paper, Fig. S2)."""
    section.check_keys('chains')
    chains = list(section.chains().values())
    count = _QUICK_SNAPSHOTS if quick else experiments.SNAPSHOTS
    report = new_report(_TAILS.format(count=count), 12, 3 * len(chains))
    panels = report.figure.subplots(len(chains), 2, sharex=True, squeeze=False)
    for (linear, logarithmic), chain in zip(panels, chains, strict=True):
        seen = _slow_snapshots(chain, count)
        beyond = (seen.distances < 0) & (seen.distances > -_BESIDE)
        positions = -seen.distances[beyond]
        lean = chain.lean_ratio / 2
        from_tanh = lean * (seen.fields[beyond] - np.tanh(positions * 2 * lean))
        from_rest = lean * (seen.fields[beyond] - 1)
        for axes, values in ((linear, from_tanh), (logarithmic, np.abs(from_rest))):
            axes.plot(positions, values, 'o', color=MEASURED, markersize=4, label='chain')
        _draw_decays(report, linear, logarithmic, chain, positions, from_rest)
        name = shape(chain)
        report.add_points(name, 'chain', (_BEYOND, '(u - u_tanh) / a [1]'), positions, from_tanh)
        report.add_points(name, 'chain', (_BEYOND, '(u - ub) / a [1]'), positions, from_rest)
        linear.set(ylabel=r'$(u - u_{\tanh}) / a$ [1]')
        linear.set_title(f'a  deviation from tanh, {name}', loc='left')
        logarithmic.set(ylabel=r'$|u - \bar u| / a$ [1]', yscale='log', ylim=(1e-9, 3))
        logarithmic.set_title(f'b  decay, {name}', loc='left')
        _compare_tail(report, chain)
    for axes in panels[-1]:
        axes.set(xlabel='distance from the wall [rotor spacings]')
    for axes in panels[0]:
        axes.legend()
    return report


def _slow_snapshots(chain: Chain, count: int) -> experiments.Snapshots:
    start = static_wall(chain, chain.number_of_rotors // 2 - 0.5)
    period = site_arc(chain) / count
    simulation = RigidSimulation(chain, start, mode_towards_last(chain, start), period)
    return experiments.snapshots(chain, simulation.record((count - 1) * period), count)


def _draw_decays(
    report: FigureReport,
    linear: Axes,
    logarithmic: Axes,
    chain: Chain,
    positions: Array,
    from_rest: Array,
) -> None:
    """Draw fits of a decaying oscillation with two decay lengths: exact, and from the paper.

    A fit at the distance x from the wall is u = ub + e^(-x / depth) (A cos(pi x / a) + B sin(pi x
    / a)), with the decay length `depth` and the rest displacement ub = r sin(theta_bar). A and B
    are fitted to the rotors with x > 1.5 a, with weights e^(x / depth).
    """
    fine = np.linspace(1.0, _BESIDE, 400)
    far = positions > _NEAR
    beside_tanh = chain.lean_ratio / 2 * (1 - np.tanh(fine * chain.lean_ratio))
    for depth, style, colour, label in (
        (penetration_depth(chain) / chain.spacing, '-', THEORY, 'decay exact, ℓ'),
        (chain.lean_ratio / 2, '--', PAPER, 'decay r sin θ̄ (paper)'),
    ):
        waves = np.stack([np.cos(np.pi * positions[far]), np.sin(np.pi * positions[far])], axis=1)
        strengths = np.linalg.lstsq(waves, from_rest[far] * np.exp(positions[far] / depth))[0]
        wave = strengths @ np.stack([np.cos(np.pi * fine), np.sin(np.pi * fine)])
        decay = np.exp(-fine / depth)
        linear.plot(fine, wave * decay + beside_tanh, style, color=colour, label=label)
        envelope = np.hypot(*strengths) * decay
        logarithmic.plot(fine, envelope, style, color=colour, label=f'{label}, envelope')
        report.add_points(shape(chain), label, (_BEYOND, '(u - ub) / a [1]'), fine, wave * decay)


def _compare_overshoot(report: FigureReport, chain: Chain) -> None:
    positions, fields = experiments.static_profile(chain, (chain.number_of_rotors - 1) / 2)
    lean_ratio = chain.lean_ratio
    from_tanh = lean_ratio / 2 * (fields + np.tanh(positions * lean_ratio))
    report.add_comparison(
        f'max |u − u_tanh| / (a d³), {shape(chain)}',
        'a constant: the deviation is ∝ d³',
        'no closed form',
        float(np.abs(from_tanh).max()) / lean_ratio**3,
    )
    report.add_comparison(
        f'overshoot of u above ū, in units of ū, {shape(chain)}',
        '∝ d³',
        'no closed form; 0 for d ≤ 1',
        float(fields.max() - 1),
    )


def _compare_tail(report: FigureReport, chain: Chain) -> None:
    depth = penetration_depth(chain) / chain.spacing
    middle = chain.number_of_rotors // 2
    tail = np.sin(static_wall(chain, middle + 0.5))[middle - int(12 * depth) - 6 : middle - 5]
    deviation = tail - math.sin(chain.rest_angle)
    ratios = deviation[:-1] / deviation[1:]
    name, d = shape(chain), chain.lean_ratio
    report.add_comparison(
        f'decay length of the oscillation / a, {name}',
        chain_formula('r sin θ̄ / a', d / 2, chain),
        chain_formula('1 / ln((d + 1) / (d − 1))', 1 / math.log((d + 1) / (d - 1)), chain),
        -1 / math.log(abs(ratios[0])),
    )
    report.add_comparison(
        f'wavelength of the oscillation / a, {name}',
        Formula('2 π / √8', math.pi / math.sqrt(2), remark='linearised; its figure shows 2'),
        'two rotors: the sign alternates',
        wavelength(deviation),
        2.0,
    )


def wavelength(deviation: Array) -> float:
    """Return twice the mean distance of successive zeros [rotor spacings].

    Zeros are interpolated linearly. For fewer than two zeros the result is infinite.
    """
    before = np.flatnonzero(np.signbit(deviation[:-1]) != np.signbit(deviation[1:]))
    if len(before) < 2:
        return math.inf
    size = np.abs(deviation)
    zeros = before + size[before] / (size[before] + size[before + 1])
    return 2 * float(zeros[-1] - zeros[0]) / (len(zeros) - 1)
