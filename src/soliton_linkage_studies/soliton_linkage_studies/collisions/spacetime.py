# SPDX-License-Identifier: Apache-2.0
"""Pictures of single collisions in space and time."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage_studies.captions import parameters
from soliton_linkage_studies.collisions.runs import APART, Collision, frames, order
from soliton_linkage_studies.palette import LEAN_COLOURS
from soliton_linkage_studies.plates import Plate

_CAPTION = """
Kinks (from the left) and anti-kinks (from the right) that meet on rings of springs, each at the
speed v / c over the titles, with (r/a, θ̄). Colours are the order field m, u / ū for flippers and
cos(θ − θ̄) for spinners, with u = r sin θ, ū = r sin θ̄ and θ the staggered angle: +1 (purple)
where the chain leans right, −1 (orange) where it leans left. Time runs upwards, in units of
2 ℓ / c with ℓ the penetration depth and c the speed of sound; a part of the ring is shown. Numbers
in the domains of spinners are the turns that their rotors have made since they leant right.
"""
_SHOWN = 40.0
"""Width of a picture in reaches [1]."""
_AFTERWARDS = 35.0
"""Times that sound takes for a reach, for which the ring is shown after the walls have met."""
_LARGEST = 1.6
"""Order field at the ends of the scale [1], a bit above the largest while walls overlap."""
_COLUMNS = 3
"""Pictures in a row [1]."""
_TURNS = {-2: '−1', -1: '−½', 0: '0', 1: '+½', 2: '+1'}
"""Turns as they are written, by their halves."""


def draw_pictures(collisions: Mapping[str, Collision]) -> Plate:
    """Order field of each collision against place and time."""
    columns = min(_COLUMNS, len(collisions))
    lines = -(-len(collisions) // columns)
    figure = Figure(figsize=(4.6 * columns, 4.4 * lines), layout='constrained')
    plate = Plate(figure, _CAPTION)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, (name, collision) in zip(panels, collisions.items(), strict=False):
        _draw(plate, axes, name, collision)
    for axes in panels[len(collisions) :]:
        axes.set_axis_off()
    for axes in panels[::columns]:
        axes.set_ylabel('t c / 2 ℓ [1]')
    bar = figure.colorbar(panels[0].images[0], ax=panels, shrink=0.6, extend='both', pad=0.01)
    bar.set_label('order field m [1]')
    return plate


def _draw(plate: Plate, axes: Axes, name: str, collision: Collision) -> None:
    times, angles = _recorded(collision)
    rotors = np.arange(angles.shape[1])
    places = rotors - (len(rotors) - 1) / 2
    shown = np.abs(places) < _SHOWN / 2 * collision.reach
    fields = order(collision.ring, angles)[:, shown]
    places = places[shown]
    axes.imshow(
        fields,
        origin='lower',
        aspect='auto',
        interpolation='nearest',
        cmap=LEAN_COLOURS,
        vmin=-_LARGEST,
        vmax=_LARGEST,
        extent=(places[0] - 0.5, places[-1] + 0.5, times[0], times[-1]),
    )
    ring = collision.ring
    title = f'{name}: v / c = {collision.speed:g}\n{ring.motion.value}, {parameters(ring)}'
    axes.set_title(title, fontsize=10)
    axes.set_xlabel('place [rotor spacings]')
    if ring.motion is Motion.SPINNER:
        _label_turns(axes, collision, times, angles)
    middle = int(np.argmin(np.abs(places)))
    names = ('t c / 2 l [1]', 'order field in the middle [1]')
    plate.note(name, 'middle', names, times, fields[:, middle])


def _recorded(collision: Collision) -> tuple[Array, Array]:
    """Times in reaches over c, (T,), and angles [rad], (T, N), until some time afterwards."""
    duration = (APART / 2 / collision.speed + _AFTERWARDS) * collision.unit
    times, angles = [], []
    for instants, frame, _ in frames(collision):
        times.append(instants)
        angles.append(frame)
        if instants[-1] > duration:
            break
    return np.concatenate(times) / collision.unit, np.concatenate(angles)


def _label_turns(axes: Axes, collision: Collision, times: Array, angles: Array) -> None:
    """Write the turns of rotors in the middle at the start and at the end, and outside of it."""
    rest = collision.ring.uniform_state(1)
    middle = len(rest) // 2
    outside = min(middle + round(0.42 * _SHOWN * collision.reach), len(rest) - 1)
    for rotor, share in ((middle, 0.03), (middle, 0.94), (outside, 0.03)):
        frame = round(share * (len(times) - 1))
        halves = round((angles[frame, rotor] - rest[rotor]) / math.pi)
        place = (rotor - (len(rest) - 1) / 2, times[frame])
        axes.annotate(_TURNS.get(halves, f'{halves}/2'), place, ha='center', va='center')
