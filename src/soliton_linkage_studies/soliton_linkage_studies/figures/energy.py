# SPDX-License-Identifier: Apache-2.0
"""Energy of anti-kinks at rest, and of kinks as a function of speed (paper, Movie S1)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from soliton_linkage.linear.bands import largest_group_velocity, penetration_depth, speed_of_sound
from soliton_linkage.linear.statics import equilibrium
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.solitons.continuum import FlipperTheory, WallTheory, wall_theory
from soliton_linkage_studies.drawing import parameters
from soliton_linkage_studies.experiments import first_passage, record_moving_wall, wall_positions
from soliton_linkage_studies.figure_report import FigureReport, Formula, chain_formula, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.palette import BLACK, MARKERS, MEASURED, THEORY, WHITE, chain_colours
from soliton_linkage_studies.settings import Section

_ANTI_KINKS = """
Energy of an anti-kink at rest in a ring of springs against d = 2 r sin θ̄ / a. An anti-kink has
charge −1 and, unlike a kink, stretches the springs. The energy is divided by the continuum value
(16/3) k_e a ū³ / l̄², with ū = r sin θ̄ and l̄ the rest length of the springs. Blue dots: rings in
equilibrium with one kink and one anti-kink. Dashed line: continuum theory, the limit of small d.
"""


@FIGURES.add('anti_kink_cost')
def anti_kink_figure(section: Section, quick: bool) -> FigureReport:
    """Draw the energy of an anti-kink at rest as a function of the lean ratio d.

    The energy is divided by the energy that continuum theory gives for an anti-kink at rest.
    """
    section.check_keys('rotor_length_ratio', 'lean_ratios')
    ratio = section.number('rotor_length_ratio', 1e-3, 1e3)
    wanted = section.numbers('lean_ratios', 1e-3, 1.0)
    report = new_report(_ANTI_KINKS, 7, 4.8)
    axes = report.figure.subplots()
    shown = np.array(wanted[::3] if quick else wanted)
    chains = []
    for lean_ratio in shown:
        depth = 1 / math.log((1 + lean_ratio) / (1 - lean_ratio))
        shape = 4 * math.ceil(7 * depth + 5), 1.0, ratio, math.asin(lean_ratio / (2 * ratio))
        chains.append(Chain(*shape, 1.0, 1.0, periodic=True))
    costs = np.array([_anti_kink_cost(chain) for chain in chains])
    shares = costs / np.array([wall_theory(chain).energy(0.0, charge=-1) for chain in chains])
    names = ('d = 2 r sin(theta_bar) / a [1]', 'energy / energy of the continuum [1]')
    look = {'color': MEASURED, 'label': 'ring of springs'}
    report.plot(axes, ('', 'anti-kink'), names, shown, shares, 'o-', **look)
    label = r'continuum: $(16/3)\,k_e\,a\,\bar u^3 / \bar l^2$'
    axes.axhline(1, color=THEORY, linestyle='--', label=label)
    axes.set(xlabel='d = 2 r sin θ̄ / a [1]', ylabel='energy of an anti-kink / continuum [1]')
    axes.set_ylim(0.6, 1.05)
    axes.legend()
    for chain, cost in zip(chains, costs, strict=True):
        lean = chain.rotor_length * math.sin(chain.rest_angle)
        limit = 16 / 3 * lean**3 / (chain.spacing * chain.rest_length**2)
        report.add_comparison(
            f'energy of an anti-kink at rest / (kₑ a²), d = {chain.lean_ratio:.3g}',
            'finite',
            chain_formula('(16/3) ū³ / (a l̄²)', limit, chain, 'for d ≪ 1'),
            float(cost) / (chain.stiffness * chain.spacing**2),
        )
    return report


def _anti_kink_cost(ring: Chain) -> float:
    rotors, theory = ring.number_of_rotors, FlipperTheory(ring)
    positions = ring.spacing * np.arange(rotors)
    kink, anti_kink = (ring.spacing * (rotors * share - 0.5) for share in (0.25, 0.75))
    first = theory.displacements(positions, kink, charge=1)
    second = theory.displacements(positions, anti_kink, charge=-1)
    lean = np.where(np.arange(rotors) < rotors // 2, first, second)
    angles = equilibrium(ring, staggered(np.arcsin(lean / ring.rotor_length)))
    return float(ring.elastic_energy(angles))


_CAPTION = """
Energy of walls in chains of springs against their relative speed v / c, where c is the speed of
sound. Each chain has its own marker and colour. Values are means over the frames with the wall in
the middle of the chain. (a) Total energy in units of E_s = M_eff c², half the continuum energy of
an anti-kink at rest. Dashed: theory (γ − 1) M_eff c² for the first chain, γ = 1 / √(1 − v²/c²).
(b) Ratio of elastic to kinetic energy; dashed: theory (γ − 1)/(γ + 1). (c) Fraction of the total
energy in the wake, which begins eight penetration depths and at least three rotors behind the
wall. Hollow markers are upper bounds, because reflected phonons of the kick may have reached the
wake.
"""
_REACH = 8
"""The wake begins behind a wall, at a distance of this number of penetration depths plus three
rotor spacings [1]."""
_CONTINUUM = 0.3
"""Chains with a lean ratio d below this are compared with continuum theory [1]. The error of this
theory is O(d^2)."""
_ENERGIES = {
    'a': 'total energy / E_s [1]',
    'b': 'elastic / kinetic energy [1]',
    'c': 'energy behind the wall / total energy [1]',
}
_SLOW = 0.87
"""Walls whose speed is below this [speed of sound] are compared with theory, whose error is then a
few per cent."""


@FIGURES.add('energy_against_speed')
def energy_figure(section: Section, quick: bool) -> FigureReport:
    """Draw three properties of moving walls as functions of their speed.

    They are the total energy, the ratio of elastic to kinetic energy, and the fraction of the
    total energy that is in the wake.
    """
    section.check_keys('chains')
    report = new_report(_CAPTION, 13, 4.8)
    panels = report.figure.subplots(1, 3)
    theories = []
    studied = section.sections('chains')
    chains = [each.chain() for each in studied.values()]
    for (name, each), chain, colour, marker in zip(
        studied.items(), chains, chain_colours(chains), MARKERS, strict=False
    ):
        each.check_keys('chain', 'kicks')
        kicks = each.numbers('kicks', 1e-6, 100.0)
        label = f'{name}: {parameters(chain)}'
        rows = [_energies(chain, kick) for kick in (kicks[::4] if quick else kicks)]
        speed, kinetic, elastic, wake, echo = np.array(rows).T
        whole = (kinetic + elastic) / wall_theory(chain).energy_scale
        shares = elastic / kinetic
        left = wake / (kinetic + elastic)
        for axes, letter, values in zip(panels, 'abc', (whole, shares, left), strict=True):
            report.add_points(letter, label, ('v / c [1]', _ENERGIES[letter]), speed, values)
            known, look = (echo == 0) | (letter != 'c'), {'color': colour, 'linewidth': 0.6}
            axes.plot(speed[known], values[known], marker + '-', label=label, **look)
            axes.plot(speed[~known], values[~known], marker, color=colour, fillstyle='none')
        if chain.lean_ratio < _CONTINUUM:
            _compare_energies(report, chain, speed, whole, shares)
            theories.append(wall_theory(chain))
    for theory in theories[:1]:
        _draw_theory(panels, theory)
    titles = ('total energy of the wall', 'elastic / kinetic energy', 'energy in the wake')
    for axes, (letter, label), title in zip(panels, _ENERGIES.items(), titles, strict=True):
        axes.set_title(f'{letter}  {title}', loc='left')
        axes.set(xlabel='speed v / c [1]', ylabel=label.replace('E_s', '$E_s$'), yscale='log')
    label = 'may contain reflected phonons of the kick'
    panels[2].plot([], [], 'o', color=BLACK, markerfacecolor=WHITE, label=label)
    panels[0].legend(fontsize=8)
    for axes in panels[1:]:
        axes.legend(handles=axes.lines[-1:], fontsize=8, loc='lower right')
    return report


def _draw_theory(panels: Sequence[Axes], theory: WallTheory) -> None:
    fine = np.linspace(0.05, 0.97, 300)
    velocities = (fine * theory.speed_of_sound).tolist()
    energies = np.array([theory.energy(velocity) for velocity in velocities])
    shares = [theory.elastic_energy(each) / theory.kinetic_energy(each) for each in velocities]
    for axes, values, law in (
        (panels[0], energies / theory.energy_scale, r'$(\gamma - 1)\,M_{eff}\,c^2 / E_s$'),
        (panels[1], shares, r'$(\gamma - 1)/(\gamma + 1)$'),
    ):
        axes.plot(fine, values, '--', color=THEORY, label=f'theory: {law}')


def _energies(chain: Chain, kick: float) -> tuple[float, float, float, float, float]:
    """Return the wall speed [speed of sound], three energies [J], and a flag for echoes.

    The energies are the kinetic and the elastic energy of the chain, and the energy of the wake.
    The wake is the part of the chain that the wall has passed and that is farther from the wall
    than `_REACH` specifies. Energies are means over the frames in which the wall first passes the
    middle of the chain. The flag is 1 if the first rotor may have reflected phonons of the kick so
    early that they met the wall before the last of these frames, otherwise 0.
    """
    recording, speed = record_moving_wall(chain, kick)
    positions = wall_positions(chain, recording)
    # Use only the first passage, because a fast wall is reflected and passes the middle again.
    inside = first_passage(chain, positions)
    angles, rates = recording.angles[inside], recording.rates[inside]
    stretched = 0.5 * chain.stiffnesses * chain.spring_extensions(angles) ** 2
    moving = 0.5 * chain.moments_of_inertia * rates**2
    reach = _REACH * penetration_depth(chain) / chain.spacing + 3
    behind = np.arange(chain.number_of_rotors) > positions[inside][:, None] + reach
    wake = np.where(behind, moving, 0).sum() + np.where(behind[:, :-1], stretched, 0).sum()
    fastest = largest_group_velocity(chain) / chain.spacing
    back = 2 * (chain.number_of_rotors - 1) / (fastest + speed)
    sums = np.array([moving.sum(), stretched.sum(), wake]) / len(angles)
    echo = float(recording.times[inside][-1] > back)
    return speed * chain.spacing / speed_of_sound(chain), *sums.tolist(), echo


def _compare_energies(
    report: FigureReport, chain: Chain, speed: Array, whole: Array, share: Array
) -> None:
    slow, theory = speed < _SLOW, wall_theory(chain)
    for v, energy, ratio in zip(speed[slow], whole[slow], share[slow], strict=True):
        gamma = theory.lorentz_factor(float(v) * theory.speed_of_sound)
        scale = theory.effective_mass * theory.speed_of_sound**2 / theory.energy_scale
        symbols, limit = (
            {'γ': gamma, 'M_eff c²/E_s': scale},
            'with the exact c; its limit is γ − 1',
        )
        report.add_comparison(
            f'energy of a wall / E_s at v = {v:.3f} c, {parameters(chain)}',
            'zero energy at rest; no value given',
            Formula('(γ − 1) M_eff c²/E_s', (gamma - 1) * scale, symbols, limit),
            float(energy),
        )
        report.add_comparison(
            f'elastic / kinetic energy at v = {v:.3f} c, {parameters(chain)}',
            'not given',
            Formula('(γ − 1) / (γ + 1)', (gamma - 1) / (gamma + 1), {'γ': gamma}),
            float(ratio),
        )
