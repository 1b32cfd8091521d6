# SPDX-License-Identifier: Apache-2.0
"""Figure of the survival rate of walls against the disorder of their chains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage_studies.drawing import LEGEND_ABOVE, parameters
from soliton_linkage_studies.figure_report import FigureReport, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.measures import OUTCOMES, SweepTrial, measure_survival
from soliton_linkage_studies.palette import MARKERS, chain_colours
from soliton_linkage_studies.settings import Section


def score_interval(share: Array, count: int, deviations: float = 1.0) -> tuple[Array, Array]:
    """Return the lower and upper ends of the Wilson score intervals of fractions of `count` draws.

    For a fraction s in `share`, the ends are the two solutions p of |s - p| = deviations sqrt(p (1
    - p) / count). The ends differ even if all draws have the same result.
    """
    pull = deviations**2 / count
    middle = share + pull / 2
    half = np.sqrt(pull * (share * (1 - share) + pull / 4))
    low, high = (middle - half) / (1 + pull), (middle + half) / (1 + pull)
    return np.clip(low, 0.0, share), np.clip(high, share, 1.0)


_CAPTION = """ Fraction of chains in which the wall crosses and returns, against the disorder of
the chain. Rotor lengths, spacings and stiffnesses have the same relative standard deviation. (a)
Chains of rigid bars. (b) Chains of springs. Each class of chain has its own marker and colour.
Each point is a fraction of {count} random chains; its bar is the 95 % Wilson score interval.
Points at the same deviation are shifted horizontally so that their bars do not overlap. In chains
of rigid bars, no wall can pass a bond that is too short for its two rotors.
"""
_TITLES = {'rigid': 'a  rigid bars', 'elastic': 'b  springs'}
_AXES = (
    'relative standard deviation of r, a and k_e [1]',
    'fraction of chains that the wall crosses and returns [1]',
)
_NORMAL = 1.959964
"""Half width of the central 95 % of a normal distribution [standard deviations]."""


@FIGURES.add('disorder_against_passage')
def disorder_figure(section: Section, quick: bool) -> FigureReport:
    """Draw the fraction of chains whose wall crosses and returns, as a function of disorder."""
    section.check_keys('chains', 'fractions', 'seeds')
    fractions = section.numbers('fractions', 0.0, 0.5)
    seeds = section.whole_number('seeds', 1, 10_000)
    shown = np.array(fractions[::4] if quick else fractions)
    count = min(seeds, 3) if quick else seeds
    report = new_report(_CAPTION.format(count=count), 10, 4.6)
    panels = report.figure.subplots(1, 2, sharey=True)
    rigid: list[tuple[Array, Array]] = []
    studied = section.sections('chains')
    chains = [each.chain() for each in studied.values()]
    looks = zip(studied.items(), chains, chain_colours(chains), MARKERS, strict=False)
    for number, ((name, each), chain, colour, marker) in enumerate(looks):
        each.check_keys('chain', 'kick')
        kick = each.number('kick', 1e-6, 100.0)
        drawn = [
            [_deviating(chain, fraction, seed) for seed in range(count)] for fraction in shown
        ]
        open_ = np.array([[not blocked_bonds(one).any() for one in row] for row in drawn])
        label = f'{name}: {parameters(chain)}, N = {chain.number_of_rotors}'
        for axes, mechanics in zip(panels, _TITLES, strict=True):
            passed = np.array([[_returns(one, kick, mechanics) for one in row] for row in drawn])
            shares = passed.mean(axis=1)
            ends = np.array(score_interval(shares, count, _NORMAL))
            look = {'fmt': f'{marker}-', 'color': colour, 'capsize': 3, 'linewidth': 1}
            aside = 100 * shown + 0.4 * (number - 1)
            axes.errorbar(aside, shares, np.abs(ends - shares), label=label, **look)
            axes.set_title(_TITLES[mechanics], loc='left')
            report.add_points(mechanics, label, _AXES, shown, shares)
            for series, end in zip(('lower', 'upper'), ends, strict=True):
                report.add_points(mechanics, f'{label}, {series} end of 95 %', _AXES, shown, end)
            if mechanics == 'rigid':
                rigid.append((open_, passed))
    for axes in panels:
        axes.set(xlabel=r'standard deviation of $r$, $a$ and $k_e$ [%]', ylim=(-0.05, 1.05))
    panels[0].set_ylabel(f'fraction whose wall crosses and returns [1],\n{count} chains each')
    look = {'loc': LEGEND_ABOVE, 'ncols': len(chains)}
    report.figure.legend(*panels[0].get_legend_handles_labels(), **look)
    _compare_passage(report, shown, *np.concatenate(rigid, axis=2))
    return report


def _deviating(chain: Chain, fraction: float, seed: int) -> Chain:
    drawn = drawn_deviations(
        chain.number_of_rotors, seed, rotor_length=fraction, spacing=fraction, stiffness=fraction
    )
    return replace(chain, deviations=drawn)


def _compare_passage(report: FigureReport, fractions: Array, free: Array, passed: Array) -> None:
    """Add to `report` the fractions of rigid-bar chains in which the wall crosses and returns.

    `fractions` contains F strengths of disorder, and there are K chains for each. Blocked bonds
    are bonds that may stop a wall (`blocked_bonds`). For each strength, one row is for all chains,
    and another row is for only those chains that have no blocked bond. `free` contains whether a
    chain has no blocked bond, and `passed` whether its wall crossed and returned, both with shape
    (F, K).
    """
    for fraction, sufficient, passes in zip(fractions, free, passed, strict=True):
        name = f'deviations of {100 * fraction:g} %, rigid'
        met, count = int(sufficient.sum()), len(passes)
        report.add_comparison(
            f'share of all {count} chains that pass, {name}',
            'robust against disorder',
            'falls as more chains have a blocked bond',
            float(passes.mean()),
        )
        if met:
            report.add_comparison(
                f'share that pass of the {met} chains without a blocked bond, {name}',
                'not given',
                'all: l̄ₙ > aₙ + |rₙ − rₙ₊₁| on every bond suffices',
                float(passes[sufficient].mean()),
                1.0,
            )


def _returns(chain: Chain, kick: float, mechanics: str) -> bool:
    try:
        found = measure_survival(chain, SweepTrial(kick=kick, mechanics=mechanics))
    except (ArithmeticError, ValueError):
        return False
    return found['outcome'] == OUTCOMES[0]
