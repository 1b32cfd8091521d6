# SPDX-License-Identifier: Apache-2.0
"""Report page of an identified chain: lengths, encoder offsets and bond residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from soliton_linkage.identification.identification import Identification
from soliton_linkage_studies.captions import description
from soliton_linkage_studies.figure_report import save_caption, save_figure
from soliton_linkage_studies.palette import BLACK, BLUE, GREEN, PALE, RED

_WORST = 3
"""Number of worst bonds that are labelled [1]."""
_CAPTION = """
Top: relative deviations of each rotor length (blue), pivot spacing (green) and spring or bar
length (red) from their means, with error bars of one standard deviation. Middle: offset of each
encoder with its standard deviation. Bottom: noise of a reading, estimated from the residual of
each bond. The black line is the noise estimated from differences between frames, without a model
of the chain. Bonds far above this line have the largest residuals; the three worst bonds are
numbered. Springs and bars are drawn between the two rotors that they join.
"""


def report_page(found: Identification) -> Figure:
    """Draw a page with the lengths, the encoder offsets and the residual noise of each bond."""
    figure = Figure(figsize=(8, 9), layout='constrained')
    lengths, offsets, bonds = figure.subplots(3, sharex=True, height_ratios=[3, 2, 2])
    _draw_lengths(lengths, found)
    rotors = np.arange(found.chain.number_of_rotors)
    offsets.errorbar(rotors, found.offsets, found.offset_deviations, fmt='o', ms=3, color=BLUE)
    offsets.axhline(0, color=PALE, linewidth=0.8, zorder=0)
    offsets.set(ylabel='offset of the encoder [rad]')
    _draw_bonds(bonds, found)
    figure.suptitle(description(found.chain), fontsize=10)
    return figure


def save_report(found: Identification, folder: Path) -> None:
    """Write identification.png, identification.pdf and their caption into a folder."""
    page = report_page(found)
    for suffix in ('png', 'pdf'):
        save_figure(page, folder / f'identification.{suffix}')
    paragraphs = [f'The chain: {description(found.chain)}.', *found.warnings]
    save_caption('\n\n'.join([_CAPTION, *paragraphs]), folder / 'identification.txt')


def _draw_lengths(axes: Axes, found: Identification) -> None:
    for name, label, colour in (
        ('rotor_length', 'rotor r', BLUE),
        ('spacing', 'pivot spacing a', GREEN),
        ('rest_length', 'spring or bar l', RED),
    ):
        fractions = np.array(getattr(found.chain.deviations, name))
        places = np.arange(len(fractions)) + (0.0 if name == 'rotor_length' else 0.5)
        spreads = 100 * found.deviations[name] * (1 + fractions)
        shift = {'spacing': -0.1, 'rest_length': 0.1}.get(name, 0.0)
        axes.errorbar(
            places + shift, 100 * fractions, spreads, fmt='o', ms=3, color=colour, label=label
        )
    axes.axhline(0, color=PALE, linewidth=0.8, zorder=0)
    axes.set(ylabel='deviation from the mean [%]')
    axes.legend(ncols=3, fontsize=8)


def _draw_bonds(axes: Axes, found: Identification) -> None:
    places = np.arange(len(found.bond_noise)) + 0.5
    axes.bar(places, found.bond_noise, color=BLUE, width=0.7)
    axes.axhline(found.reading_noise, color=BLACK, linewidth=0.8)
    top = float(np.max(found.bond_noise))
    for bond in found.worst_bonds[:_WORST]:
        axes.text(bond + 0.5, found.bond_noise[bond] + 0.02 * top, f'{bond}', ha='center')
    axes.set(
        xlabel='rotor n [1]', ylabel='noise estimated from each bond [rad]', ylim=(0, 1.15 * top)
    )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
