# SPDX-License-Identifier: Apache-2.0
"""Pictures of a recording, of an identification, and of the check of a rig."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from soliton_linkage.linkage.chain import Array, Chain, displacement
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.track import Crossing, Track
from soliton_linkage_studies import palette
from soliton_linkage_studies.drawing import description, show_leans
from soliton_linkage_studies.figure_report import save_caption, save_figure
from soliton_linkage_studies.palette import BLUE, GREEN, ORANGE, RED

if TYPE_CHECKING:  # the demo does not compile the loops of the identification
    from soliton_linkage.identification.result import Identification
    from soliton_linkage.identification.rig_check import RigFindings

_KYMOGRAPH = """
Horizontal displacement u = r sin φ of the mass of each rotor over time: purple for rotors that
lean right, orange for rotors that lean left, and white for upright rotors. The scale goes from −r
to r, where r is the rotor length. It is stretched about the two rest states, so that oscillations
of a few per cent are visible. Colours darker than a rest state show displacements beyond it, for
example beside the wall of a wobbling flipper. The black lines with a white border are the tracks
of the solitons, where they are detected.

An edge rotor has two rest angles, because it has only one spring. After a reflection it rests at
the other angle, so that the colour of its row may differ from that of the neighbouring rows.
"""
_TRACK = """
Top: position of the soliton. Middle: its velocity, positive towards the last rotor. Thin blue
lines are measurements of single frames. The pale blue band extends two standard deviations to both
sides and may be thinner than the line. Bottom: these standard deviations of the position (blue)
and the velocity (dotted black), on a logarithmic scale. Dashed black lines are the mean velocities
of crossings, fitted to the positions between the outer fifths of the chain. The thin grey line
marks velocity 0. Lines are interrupted in frames without a detected soliton, for example at
reflections.
"""
_NOTE = (
    'An edge rotor has two rest angles, so its row may be paler. '
    'A colour darker than at rest means that the rotor leans beyond its rest angle.'
)
_MOST_COLUMNS = 2000
"""Largest number of frames in a kymograph [1], because an image does not resolve more."""

_JUMP = 5.0
"""If a track jumps by more than this between frames, it follows another wall [rotor spacings]."""


def kymograph(axes: Axes, chain: Chain, recording: Recording, track: Track) -> Axes:
    """Draw the displacements u_n(t) as an image over time, and the tracks of all solitons."""
    every = max(1, len(recording.times) // _MOST_COLUMNS)
    leans = displacement(chain, recording.angles[::every]).T
    edges = (*_edges(recording.times), -0.5, chain.number_of_rotors - 0.5)
    image = show_leans(axes, chain, leans, edges)
    border = [withStroke(linewidth=3.5, foreground=palette.WHITE)]
    for number, sites in enumerate((track.sites, *track.others)):
        label, shown = None if number else 'soliton', unbroken(sites)
        axes.plot(track.times, shown, color=palette.BLACK, label=label, path_effects=border)
    axes.legend(loc='upper right')
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel='time [s]', ylabel='rotor n [1]', title=description(chain))
    marks, names = (
        palette.lean_ticks(chain),
        ('left, −r', 'at rest', 'upright', 'at rest', 'right, r'),
    )
    words = [f'{mark:.3g}  {name}' for mark, name in zip(marks, names, strict=True)]
    bar = axes.figure.colorbar(image, ax=axes, ticks=marks)
    bar.ax.set_yticks(marks, words, fontsize=8)
    bar.ax.minorticks_off()
    bar.set_label('displacement u = r sin φ [m]')
    return axes


def unbroken(sites: Array) -> Array:
    """Return the sites of a track, with NaN where the track changes to another soliton."""
    shown = sites.copy()
    shown[1:][np.abs(np.diff(sites)) > _JUMP] = np.nan
    return shown


def track_positions(axes: Axes, chain: Chain, track: Track) -> Axes:
    """Draw the soliton position over time, with a band of +- 2 standard deviations."""
    sites = unbroken(track.sites)
    axes.plot(track.times, sites, color=palette.MEASURED, linewidth=0.8, label='measured')
    _draw_band(axes, track.times, sites, track.site_deviations)
    axes.set(ylabel='position [rotor spacings]', ylim=(0, chain.number_of_rotors - 1))
    axes.set(xlabel='time [s]', title=description(chain))
    return axes


def track_velocities(axes: Axes, track: Track, crossings: tuple[Crossing, ...]) -> Axes:
    """Draw the soliton velocity, its standard deviation, and the mean velocity of crossings."""
    axes.plot(
        track.times, track.site_rates, color=palette.MEASURED, linewidth=0.8, label='measured'
    )
    _draw_band(axes, track.times, track.site_rates, track.site_rate_deviations)
    for number, crossing in enumerate(crossings):
        ends, mean = [crossing.start, crossing.end], crossing.direction * crossing.site_rate
        label = None if number else 'mean of a crossing'
        axes.plot(ends, [mean] * 2, '--', color=palette.BLACK, linewidth=1, zorder=3, label=label)
    axes.axhline(0, color=palette.PALE, linewidth=0.8, zorder=0)
    axes.set(xlabel='time [s]', ylabel='velocity [rotor spacings/s]')
    axes.legend(loc='center', ncols=3, fontsize=8)
    if crossings:
        fastest = max(crossing.site_rate for crossing in crossings)
    else:
        # The first velocities of a new wall are uncertain; they do not determine the axis.
        speeds = np.abs(track.site_rates[np.isfinite(track.site_rates)])
        fastest = float(np.quantile(speeds, 0.99)) if len(speeds) else 0.0
    if fastest:
        axes.set_ylim(-1.4 * fastest, 1.4 * fastest)
    return axes


def track_deviations(axes: Axes, track: Track) -> Axes:
    """Draw the standard deviations of position and velocity over time."""
    for values, style, colour, label in (
        (track.site_deviations, '-', palette.MEASURED, 'position [rotor spacings]'),
        (track.site_rate_deviations, ':', palette.BLACK, 'velocity [rotor spacings/s]'),
    ):
        axes.semilogy(track.times, values, style, color=colour, label=label)
    axes.set(xlabel='time [s]', ylabel='standard deviation')
    axes.legend(loc='best', ncols=2, fontsize=8)
    return axes


def _draw_band(axes: Axes, times: Array, middle: Array, deviations: Array) -> None:
    if len(deviations):
        low, high = middle - 2 * deviations, middle + 2 * deviations
        label = '± 2 standard deviations'
        axes.fill_between(times, low, high, color=palette.SKY, alpha=0.5, linewidth=0, label=label)


def kymograph_figure(chain: Chain, recording: Recording, track: Track) -> Figure:
    """Return a figure whose only panel is a `kymograph`."""
    figure = Figure(figsize=(8, 4.2), layout='constrained')
    kymograph(figure.subplots(), chain, recording, track)
    figure.supxlabel(_NOTE, fontsize=8)
    return figure


def track_figure(chain: Chain, track: Track, crossings: tuple[Crossing, ...]) -> Figure:
    """Return a figure of soliton position and velocity, with standard deviations if known."""
    known = len(track.site_deviations) > 0
    figure = Figure(figsize=(8, 7 if known else 5.5), layout='constrained')
    ratios = [2, 2, 1][: 3 if known else 2]
    above, below, *last = figure.subplots(len(ratios), sharex=True, height_ratios=ratios)
    track_positions(above, chain, track).label_outer()
    track_velocities(below, track, crossings)
    if known:
        below.label_outer()
        track_deviations(last[0], track)
    return figure


def save_run(
    chain: Chain, recording: Recording, track: Track, crossings: tuple[Crossing, ...], folder: Path
) -> None:
    """Write kymograph.png and track.png into a folder, each with its caption as a .txt file."""
    for name, figure, caption in (
        ('kymograph', kymograph_figure(chain, recording, track), _KYMOGRAPH),
        ('track', track_figure(chain, track, crossings), _TRACK),
    ):
        save_figure(figure, folder / f'{name}.png')
        save_caption(f'{caption}\n\nThe chain: {description(chain)}.', folder / f'{name}.txt')


def _edges(times: Array) -> tuple[float, float]:
    period = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0
    return float(times[0] - period / 2), float(times[-1] + period / 2)


_CAPTION = """
Top: relative deviations of each rotor length (blue), pivot spacing (green) and spring or bar
length (red) from their means, with error bars of one standard deviation. Middle: offset of each
encoder with its standard deviation. Bottom: noise of a reading, estimated from the residual of
each bond. The black line is the noise estimated from differences between frames, without a model
of the chain. Bonds far above this line have the largest residuals; the three worst bonds are
numbered. Springs and bars are drawn between the two rotors that they join.
"""


def report_page(found: Identification) -> Figure:
    """Return a page with identified lengths, encoder offsets and noise.

    The noise is the standard deviation of a reading [rad], estimated separately from the residuals
    at each bond.
    """
    figure = Figure(figsize=(8, 9), layout='constrained')
    lengths, offsets, bonds = figure.subplots(3, sharex=True, height_ratios=[3, 2, 2])
    for name, label, colour, shift in (
        ('rotor_length', 'rotor r', BLUE, 0.0),
        ('spacing', 'pivot spacing a', GREEN, 0.4),
        ('rest_length', 'spring or bar l', RED, 0.6),
    ):
        fractions = np.array(getattr(found.chain.deviations, name))
        positions = np.arange(len(fractions)) + shift
        spreads = 100 * found.deviations[name] * (1 + fractions)
        look: Any = {'fmt': 'o', 'ms': 3, 'color': colour, 'label': label}
        lengths.errorbar(positions, 100 * fractions, spreads, **look)
    lengths.axhline(0, color=palette.PALE, linewidth=0.8, zorder=0)
    lengths.set(ylabel='deviation from the mean [%]')
    lengths.legend(ncols=3, fontsize=8)
    rotors = np.arange(found.chain.number_of_rotors)
    offsets.errorbar(
        rotors, found.offsets, found.offset_deviations, fmt='o', ms=3, color=palette.BLUE
    )
    offsets.axhline(0, color=palette.PALE, linewidth=0.8, zorder=0)
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


def _draw_bonds(axes: Axes, found: Identification) -> None:
    positions = np.arange(len(found.bond_noise)) + 0.5
    axes.bar(positions, found.bond_noise, color=palette.BLUE, width=0.7)
    axes.axhline(found.reading_noise, color=palette.BLACK, linewidth=0.8)
    top = float(np.max(found.bond_noise))
    for bond in found.worst_bonds[:3]:
        axes.text(bond + 0.5, found.bond_noise[bond] + 0.02 * top, f'{bond}', ha='center')
    axes.set(ylabel='noise estimated from each bond [rad]', ylim=(0, 1.15 * top))
    axes.set_xlabel('rotor n [1]')
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


_PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>Check of the rig</title>
<style>body {{font: 16px/1.4 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em}}
td {{padding: .3em .8em .3em 0; vertical-align: top}} svg {{max-width: 100%; height: auto}}</style>
<h1>Check of the rig: {verdict}</h1><p>{chain}; joints {joints}.</p>
<table>{rows}</table>{picture}</html>
"""


def rig_page(found: RigFindings, names: Sequence[str], chain: str) -> str:
    """Return the results of a rig check as HTML.

    `names` are the names of the joints, and `chain` is a description of the chain.
    """
    from soliton_linkage.identification.rig_bonds import DOUBTFUL, RIGHT, WRONG

    colours = {RIGHT: GREEN, DOUBTFUL: ORANGE, WRONG: RED}
    rows = ''.join(
        f'<tr><td style="color:{colours[each.verdict]}"><b>{each.verdict}</b></td>'
        f'<td>{each.subject}</td><td>{html.escape(each.text)}</td></tr>\n'
        for each in found.findings
    )
    figure = Figure(figsize=(9, 4.5), layout='constrained')
    above, below = figure.subplots(2, 1, sharex=True)
    above.bar(np.arange(len(found.noise)), found.noise, color=BLUE)
    above.set(ylabel='noise [rad]')
    below.bar(np.arange(len(found.stretches)) + 0.5, 100 * found.stretches, color=BLUE)
    below.set(xlabel='rotor n [1]', ylabel='bond length minus\nconfigured length [%]')
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    picture = io.StringIO()
    figure.savefig(picture, format='svg', metadata={'Date': None})
    return _PAGE.format(
        verdict='nothing is wrong' if found.sound else 'something is wrong',
        chain=html.escape(chain[:1].upper() + chain[1:]),
        joints=html.escape(f'{names[0]} to {names[-1]}'),
        rows=rows,
        picture=picture.getvalue().partition('?>')[2].partition('.dtd">')[2],
    )
