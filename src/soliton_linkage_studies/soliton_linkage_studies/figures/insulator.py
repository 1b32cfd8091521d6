# SPDX-License-Identifier: Apache-2.0
"""Figure of the chain as a mechanical insulator: zero mode, penetration depth and phonons."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from soliton_linkage.linear.bands import couplings, dispersion, penetration_depth, winding_number
from soliton_linkage.linear.normal_modes import mode_frequencies
from soliton_linkage.linear.rigidity import mode_centre, zero_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies import drawing
from soliton_linkage_studies.figure_report import FigureReport, chain_formula, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.palette import GREY, MARKERS, chain_colours
from soliton_linkage_studies.settings import Section

_CAPTION = f"""
The chain as a mechanical insulator (paper, Fig. 1). {drawing.LINKAGE}

(a) The linkage of rigid bars (solid red) in its uniform right-leaning state. (b) The same chain
with springs (dashed red) and its zero mode, which stretches no spring and is localised at the last
rotor: {drawing.MODE}. (c) A wall at rest between right-leaning and left-leaning rotors, in a chain
of rigid bars. (d) {drawing.PROJECTIONS}

(e) Absolute components of the normalised zero mode of three chains against the distance from the
last rotor, one colour for each chain. The lines decay by a factor of e per penetration depth
ℓ = a / ln((1 + d)/|1 − d|). (f) Phonon frequencies against the wave number of the staggered
angles. Lines: theory of the infinite chain. Markers: finite chain with free ends. No phonon has a
frequency below the gap, which is the lowest point of each line. The thin grey line is the zero
frequency of the zero mode.
"""
_TITLES = (
    'a  the linkage of rigid bars (red), leaning right',
    'b  springs (dashed) and the zero mode (green), localised at the last rotor',
    'c  a wall at rest,   d  the horizontal projections of its rotors',
)
_LONG = 400
"""Number of rotors of a long chain [1], whose values equal those of the infinite chain to 1e-4."""


@FIGURES.add('figure_1')
def figure_1(section: Section, quick: bool) -> FigureReport:
    """Draw a uniform chain, the decay of its zero mode, a wall, and phonons (paper, Fig. 1)."""
    section.check_keys('chain', 'chains')
    chain = section.chain()
    others = list(section.chains().values())
    report = new_report(_CAPTION, 10, 9.5)
    figure = report.figure
    grid = figure.add_gridspec(4, 2, height_ratios=[1, 1, 1.2, 2.4])
    top = [figure.add_subplot(grid[row, :]) for row in range(3)]
    rest = chain.uniform_state(1)
    uniform = drawing.ChainPicture(top[0], chain, rest, rigid=True)
    wall = static_wall(chain, (chain.number_of_rotors - 1) / 2)
    moving = drawing.ChainPicture(top[1], chain, rest, zero_mode(chain, rest))
    waiting = drawing.ChainPicture(top[2], chain, wall, projections=True, rigid=True)
    drawing.expand_limits([uniform, moving])
    waiting.axes.set_xlim(moving.axes.get_xlim())
    for axes, title in zip(top, _TITLES, strict=True):
        axes.set_title(title, loc='left')
    names, rotors = ('rotor n', 'phi [rad]'), np.arange(chain.number_of_rotors)
    report.add_points('a', 'leaning right', names, rotors, rest)
    report.add_points('c', 'wall', names, rotors, wall)
    drawing.add_legend(figure)
    chains = [chain, *others]
    _draw_depths(report, figure.add_subplot(grid[3, 0]), chains)
    _draw_bands(report, figure.add_subplot(grid[3, 1]), chains)
    for each in chains:
        _compare(report, each, 100 if quick else _LONG)
    return report


def _draw_depths(report: FigureReport, axes: Axes, chains: list[Chain]) -> None:
    for chain, colour, marker in zip(chains, chain_colours(chains), MARKERS, strict=False):
        mode = np.abs(zero_mode(chain, chain.uniform_state(1)))
        from_edge = np.arange(chain.number_of_rotors)[::-1]
        depth = penetration_depth(chain) / chain.spacing
        name, names = drawing.parameters(chain), ('rotors from the last', 'zero mode |t| [1]')
        look = {'color': colour, 'label': name}
        report.plot(axes, ('e', name), names, from_edge, mode, marker, **look)
        axes.plot(from_edge, mode[-1] * np.exp(-from_edge / depth), '-', color=colour)
    axes.set(yscale='log', ylim=(1e-7, 2), xlabel='distance from the last rotor [rotor spacings]')
    axes.set(ylabel='component of the zero mode |t| [1]')
    axes.set(title='e  decay of the zero mode with the penetration depth ℓ')
    axes.plot([], [], '-', color=GREY, label=r'$e^{-n a / \ell}$, theory')
    axes.legend()


def _draw_bands(report: FigureReport, axes: Axes, chains: list[Chain]) -> None:
    for chain, colour, marker in zip(chains, chain_colours(chains), MARKERS, strict=False):
        numbers = np.linspace(0, math.pi, 200)
        line = dispersion(chain, numbers / chain.spacing) * chain.time_unit
        axes.plot(numbers, line, '-', color=colour)
        rotors = chain.number_of_rotors
        found = mode_frequencies(chain, chain.uniform_state(1))[1:] * chain.time_unit
        steps = np.arange(1, rotors) * math.pi / rotors
        ascending = np.argsort(dispersion(chain, steps / chain.spacing))
        placed = np.empty(rotors - 1)
        placed[ascending] = found
        look = {'color': colour, 'label': drawing.parameters(chain), 'markersize': 4}
        names = ('wave number k a [rad]', 'frequency omega sqrt(M/k_e) [1]')
        report.plot(axes, ('f', drawing.parameters(chain)), names, steps, placed, marker, **look)
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.set(xlabel='wave number k a of the staggered angles [rad]')
    axes.set(ylabel=r'frequency $\omega\,\sqrt{M/k_e}$ [1]', title='f  no phonon below the gap')
    axes.plot([], [], '-', color=GREY, label='infinite chain, theory')
    axes.legend()


def _compare(report: FigureReport, chain: Chain, rotors: int) -> None:
    name, spacing, unit = drawing.parameters(chain), chain.spacing, chain.time_unit
    lengths = spacing, chain.rotor_length, chain.rest_angle
    long_chain = Chain(rotors, *lengths, chain.mass, chain.stiffness)
    frequencies = mode_frequencies(long_chain, long_chain.uniform_state(1))[1:] * unit
    mode = np.abs(zero_mode(chain, chain.uniform_state(1)))
    r, rest, d = chain.rotor_length, chain.rest_length, chain.lean_ratio
    paper = r**2 * math.sin(2 * chain.rest_angle) / (rest * spacing)
    plus, minus = (abs(one) for one in couplings(chain))
    # The two lowest modes of a finite chain, j = 1 and 2, have the wave numbers k a = pi j / N.
    squares = np.sort(frequencies)[:2] ** 2
    report.add_comparison(
        f'gap ω₀ √(M/kₑ), {name}',
        chain_formula('r² sin(2 θ̄) / (l̄ a)', paper, chain),
        chain_formula('||q₊| − |q₋|| / r', abs(plus - minus) / r, chain),
        math.sqrt((4 * squares[0] - squares[1]) / 3),
    )
    remark = 'the same, about the lowest frequency'
    report.add_comparison(
        f'speed of sound c √(M/kₑ) / a, {name}',
        'cos θ̄ √|4 r² sin² θ̄ − a²| / l̄',
        chain_formula('√|q₊ q₋| / r', math.sqrt(plus * minus) / r, chain, remark),
        math.sqrt((squares[1] - squares[0]) / 3) * rotors / math.pi,
    )
    report.add_comparison(
        f'largest group velocity √(M/kₑ) / a, {name}',
        'c, without a gap',
        chain_formula('min(|q₊|, |q₋|) / r', min(plus, minus) / r, chain),
        float(np.abs(np.diff(np.sort(frequencies))).max()) * rotors / math.pi,
    )
    depth = 1 / math.log((1 + d) / abs(1 - d))
    report.add_comparison(
        f'penetration depth ℓ / a, {name}',
        'the same',
        chain_formula('1 / ln((1 + d) / |1 − d|)', depth, chain, 'd is 2 r sin θ̄ / a'),
        -1 / float(np.log(mode[-2] / mode[-1])),
    )
    centre = mode_centre(zero_mode(long_chain, long_chain.uniform_state(1)))
    report.add_comparison(
        f'zero mode of the right-leaning state, {name} (0 first edge, 1 last)',
        'winding number 0: right edge (but ℓ > 0 stated as left)',
        f'winding number {winding_number(chain, 1)}: last edge',
        float(centre > rotors / 2),
        1.0,
    )
