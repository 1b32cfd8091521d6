# SPDX-License-Identifier: Apache-2.0
"""A recording on axes: its space-time picture and the path of its soliton."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.track import Crossing, Track
from soliton_linkage.studies.captions import description
from soliton_linkage.studies.drawing import displacement
from soliton_linkage.studies.palette import BLACK, BLUE, LEAN_COLOURS, RED

_MOST_COLUMNS = 2000
"""Frames of a kymograph, of which more would not be pixels of their own."""


def kymograph(axes: Axes, chain: Chain, recording: Recording, track: Track) -> Axes:
    """Draw u_n(t) as a picture of rotors against time, with the soliton's track over it."""
    every = max(1, len(recording.times) // _MOST_COLUMNS)
    largest = chain.rotor_length * np.sin(chain.rest_angle)
    image = axes.imshow(
        displacement(chain, recording.angles[::every]).T,
        origin='lower',
        aspect='auto',
        interpolation='nearest',
        cmap=LEAN_COLOURS,
        vmin=-largest,
        vmax=largest,
        extent=(*_edges(recording.times), -0.5, chain.number_of_rotors - 0.5),
    )
    border = [withStroke(linewidth=3.5, foreground='white')]
    axes.plot(track.times, track.rotors, color=BLACK, label='soliton', path_effects=border)
    axes.legend(loc='upper right')
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel='time [s]', ylabel='rotor n', title=description(chain))
    axes.figure.colorbar(image, ax=axes, label='horizontal displacement u [m]', extend='both')
    return axes


def track_places(axes: Axes, chain: Chain, track: Track) -> Axes:
    """Draw the soliton's place over time."""
    axes.plot(track.times, track.rotors, color=BLACK)
    axes.set(ylabel='soliton at rotor', ylim=(0, chain.number_of_rotors - 1))
    axes.set(xlabel='time [s]', title=description(chain))
    return axes


def track_velocities(axes: Axes, track: Track, crossings: tuple[Crossing, ...]) -> Axes:
    """Draw the soliton's velocity over time, and the mean of each crossing."""
    axes.plot(track.times, track.place_rates, color=BLUE, linewidth=0.8)
    for number, crossing in enumerate(crossings):
        axes.plot(
            [crossing.start, crossing.end],
            [crossing.direction * crossing.place_rate] * 2,
            color=RED,
            linewidth=2,
            label=None if number else 'mean of a crossing',
        )
    axes.axhline(0, color='0.8', linewidth=0.8, zorder=0)
    axes.set(xlabel='time [s]', ylabel='velocity [rotors/s]')
    if crossings:
        axes.legend(loc='upper right')
        fastest = max(crossing.place_rate for crossing in crossings)
        axes.set_ylim(-2 * fastest, 2 * fastest)
    return axes


def kymograph_figure(chain: Chain, recording: Recording, track: Track) -> Figure:
    """Return a figure of its own for `kymograph`."""
    figure = Figure(figsize=(8, 4), layout='constrained')
    kymograph(figure.subplots(), chain, recording, track)
    return figure


def track_figure(chain: Chain, track: Track, crossings: tuple[Crossing, ...]) -> Figure:
    """Return a figure with the soliton's place and, beneath it, its velocity."""
    figure = Figure(figsize=(8, 5.5), layout='constrained')
    above, below = figure.subplots(2, sharex=True)
    track_places(above, chain, track).label_outer()
    track_velocities(below, track, crossings)
    return figure


def _edges(times: Array) -> tuple[float, float]:
    period = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0
    return float(times[0] - period / 2), float(times[-1] + period / 2)
