# SPDX-License-Identifier: Apache-2.0
"""Pictures of a recording: its space-time picture and the path of its soliton."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.track import Crossing, Track

_TRACK_COLOUR = '#111111'
_RESOLUTION = 150
_MOST_COLUMNS = 2000


def draw_kymograph(chain: Chain, recording: Recording, track: Track, path: Path) -> None:
    """Draw u_n(t) as a picture of rotors against time, with the soliton's track over it."""
    every = max(1, len(recording.times) // _MOST_COLUMNS)
    lean = chain.rotor_length * np.sin(recording.angles[::every])
    largest = chain.rotor_length * np.sin(chain.rest_angle)
    figure, axes = _new_figure(1)
    image = axes[0].imshow(
        lean.T,
        origin='lower',
        aspect='auto',
        interpolation='nearest',
        cmap='PuOr',
        vmin=-largest,
        vmax=largest,
        extent=(*_edges(recording.times), -0.5, chain.number_of_rotors - 0.5),
    )
    axes[0].plot(
        track.times,
        track.rotors,
        color=_TRACK_COLOUR,
        linewidth=1.5,
        label='soliton',
        path_effects=[withStroke(linewidth=3.5, foreground='white')],
    )
    axes[0].legend(loc='upper right')
    axes[0].yaxis.set_major_locator(MaxNLocator(integer=True))
    axes[0].set(xlabel='time [s]', ylabel='rotor n', title=_title(chain))
    figure.colorbar(image, ax=axes[0], label='horizontal displacement u [m]', extend='both')
    figure.savefig(path, dpi=_RESOLUTION)


def draw_track(chain: Chain, track: Track, crossings: tuple[Crossing, ...], path: Path) -> None:
    """Draw the soliton's place and velocity over time, and the speed of each crossing."""
    figure, (place, velocity) = _new_figure(2)
    place.plot(track.times, track.rotors, color=_TRACK_COLOUR, linewidth=1.2)
    place.set(ylabel='soliton at rotor', ylim=(0, chain.number_of_rotors - 1), title=_title(chain))
    velocity.plot(track.times, track.velocities, color='#0072b2', linewidth=0.8)
    for number, crossing in enumerate(crossings):
        velocity.plot(
            [crossing.start, crossing.end],
            [crossing.direction * crossing.speed] * 2,
            color='#d55e00',
            linewidth=2,
            label=None if number else 'mean of a crossing',
        )
    velocity.axhline(0, color='0.8', linewidth=0.8, zorder=0)
    velocity.set(xlabel='time [s]', ylabel='velocity [rotors/s]')
    if crossings:
        velocity.legend(loc='upper right')
        fastest = max(crossing.speed for crossing in crossings)
        velocity.set_ylim(-2 * fastest, 2 * fastest)
    figure.savefig(path, dpi=_RESOLUTION)


def _new_figure(rows: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(8, 4 + 1.5 * (rows - 1)), layout='constrained')
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


def _edges(times: Array) -> tuple[float, float]:
    period = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0
    return float(times[0] - period / 2), float(times[-1] + period / 2)


def _title(chain: Chain) -> str:
    return (
        f'{chain.motion.value}, {chain.number_of_rotors} rotors, '
        f'r/a = {chain.rotor_length / chain.spacing:g}, '
        f'rest angle {chain.rest_angle:g} rad'
    )
