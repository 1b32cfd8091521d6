# SPDX-License-Identifier: Apache-2.0
"""Figure of the energy of an anti-kink at rest."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from soliton_linkage.linear.statics import equilibrium
from soliton_linkage.linkage.chain import Chain, staggered
from soliton_linkage.solitons.continuum import FlipperTheory, wall_theory
from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.formulas import chain_formula
from soliton_linkage_studies.palette import MEASURED, THEORY
from soliton_linkage_studies.settings import Section

_CAPTION = """
Energy of an anti-kink at rest in a ring of springs against d = 2 r sin θ̄ / a. An anti-kink has
charge −1 and, unlike a kink, stretches the springs. The energy is divided by the continuum value
(16/3) k_e a ū³ / l̄², with ū = r sin θ̄ and l̄ the rest length of the springs. Blue dots: rings in
equilibrium with one kink and one anti-kink. Dashed line: continuum theory, the limit of small d.
"""


@FIGURES.add('anti_kink_cost')
def anti_kink_figure(section: Section, quick: bool) -> FigureReport:
    """Draw the energy of an anti-kink at rest, relative to the continuum, against d."""
    section.check_keys('rotor_length_ratio', 'lean_ratios')
    ratio = section.number('rotor_length_ratio', 1e-3, 1e3)
    wanted = section.numbers('lean_ratios', 1e-3, 1.0)
    report = FigureReport(Figure(figsize=(7, 4.8), layout='constrained'), _CAPTION)
    axes = report.figure.subplots()
    shown = np.array(wanted[::3] if quick else wanted)
    chains = [_ring_of_lean(ratio, lean_ratio) for lean_ratio in shown]
    costs = np.array([_anti_kink_cost(chain) for chain in chains])
    shares = costs / np.array([wall_theory(chain).energy(0.0, charge=-1) for chain in chains])
    axes.plot(shown, shares, 'o-', color=MEASURED, label='ring of springs')
    axes.axhline(
        1, color=THEORY, linestyle='--', label=r'continuum: $(16/3)\,k_e\,a\,\bar u^3 / \bar l^2$'
    )
    axes.set(
        xlabel='d = 2 r sin θ̄ / a [1]',
        ylabel='energy of an anti-kink / continuum [1]',
        ylim=(0.6, 1.05),
    )
    axes.legend()
    names = ('d = 2 r sin(theta_bar) / a [1]', 'energy / energy of the continuum [1]')
    report.add_points('', 'anti-kink', names, shown, shares)
    for chain, cost in zip(chains, costs, strict=True):
        report.add_comparison(
            f'energy of an anti-kink at rest / (kₑ a²), d = {chain.lean_ratio:.3g}',
            'finite',
            chain_formula('(16/3) ū³ / (a l̄²)', chain, 'for d ≪ 1'),
            float(cost) / (chain.stiffness * chain.spacing**2),
        )
    return report


def _ring_of_lean(ratio: float, lean_ratio: float) -> Chain:
    """Return a periodic chain, long enough that two walls do not interact."""
    rest_angle = math.asin(lean_ratio / (2 * ratio))
    depth = 1 / math.log((1 + lean_ratio) / (1 - lean_ratio))
    rotors = 4 * math.ceil(7 * depth + 5)
    return Chain(rotors, 1.0, ratio, rest_angle, 1.0, 1.0, periodic=True)


def _anti_kink_cost(ring: Chain) -> float:
    """Return the energy of the ring in equilibrium [J]; its kink has zero energy."""
    rotors, theory = ring.number_of_rotors, FlipperTheory(ring)
    places = ring.spacing * np.arange(rotors)
    kink, anti_kink = (ring.spacing * (rotors * share - 0.5) for share in (0.25, 0.75))
    first = theory.displacements(places, kink, charge=1)
    second = theory.displacements(places, anti_kink, charge=-1)
    lean = np.where(np.arange(rotors) < rotors // 2, first, second)
    return float(
        ring.elastic_energy(equilibrium(ring, staggered(np.arcsin(lean / ring.rotor_length))))
    )
