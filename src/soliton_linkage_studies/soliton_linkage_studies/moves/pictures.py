# SPDX-License-Identifier: Apache-2.0
"""Pictures of walls on their way, of their errors and of the phonons that they wake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage_studies.drawing import ABOVE
from soliton_linkage_studies.moves.runs import MoveKey, MoveRun, MoveTask
from soliton_linkage_studies.palette import COLOURS, GREY
from soliton_linkage_studies.plates import Plate

_CAPTION = """
Walls on their way to goals in simulated chains, a column for each chain and a colour for each
condition; each move is a line. (a) Place of the wall. (b) Absolute distance from the goal, down to
{least:g}; the dashed grey line is {wanted:g} rotor spacings, at which it is to be held. (c) Energy
of phonons, which is what is not in the motion of the wall, over the largest energy that the wall
has on its way. Lines of conditions that do not differ lie on each other, the last on top.
"""
_WANTED = 0.1
"""Distance from its goal at which a wall is to be held [rotor spacings]."""
_LEAST_ERROR = 1e-6
"""Drawn in place of less, which its scale of logarithms would not hold [rotor spacings]."""
_LEAST_SHARE = 1e-16
"""The same for a share of an energy: what rounding leaves of it [1]."""


def draw_moves(
    tasks: Mapping[MoveKey, Sequence[MoveTask]], runs: Mapping[MoveKey, Sequence[MoveRun]]
) -> Plate:
    """Places, distances from the goal and phonons against time, a column for each chain."""
    chains = list(dict.fromkeys(name for name, _ in tasks))
    conditions = list(dict.fromkeys(title for _, title in tasks))
    figure = Figure(figsize=(max(4.3 * len(chains), 6), 10), layout='constrained')
    plate = Plate(figure, _CAPTION.format(least=_LEAST_ERROR, wanted=_WANTED))
    panels = plate.figure.subplots(3, len(chains), sharex='col', sharey='row', squeeze=False)
    for column, name in zip(panels.T, chains, strict=True):
        for number, title in enumerate(conditions):
            colour = COLOURS[number % len(COLOURS)]
            for task, run in zip(tasks[name, title], runs[name, title], strict=True):
                _draw_run(plate, column, f'{name}, {title}', colour, task, run)
        column[0].set(title=name)
        column[1].axhline(_WANTED, color=GREY, linestyle='--', linewidth=0.8)
        column[2].set(xlabel='time since the goal was given [s]')
    panels[0, 0].set(ylabel='a  place [rotor spacings]')
    panels[1, 0].set(ylabel='b  |place − goal| [rotor spacings]', yscale='log')
    panels[2, 0].set(ylabel='c  phonons / peak energy of the wall [1]', yscale='log')
    panels[1, 0].plot([], [], '--', color=GREY, linewidth=0.8, label=f'to be held: {_WANTED:g}')
    for number, title in enumerate(conditions):
        panels[0, 0].plot([], [], color=COLOURS[number % len(COLOURS)], label=title)
    plate.figure.legend(loc=ABOVE, ncols=len(conditions) + 1)
    return plate


def _draw_run(
    plate: Plate, column: Sequence[Axes], series: str, colour: str, task: MoveTask, run: MoveRun
) -> None:
    off = np.maximum(np.abs(run.places - task.goal), _LEAST_ERROR)
    share = np.maximum(run.phonon_energies / run.peak_energy, _LEAST_SHARE)
    for axes, name, values in (
        (column[0], 'place [rotor spacings]', run.places),
        (column[1], 'distance from the goal [rotor spacings]', off),
        (column[2], 'phonons over the peak energy of the wall [1]', share),
    ):
        axes.plot(run.times, values, color=colour, linewidth=0.9, alpha=0.8)
        plate.note(series, f'to {task.goal:.3f}', ('time [s]', name), run.times, values)
