# SPDX-License-Identifier: Apache-2.0
"""What is left of lengths and energy after very many steps of rigid bars."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.progress import ProgressLine
from soliton_linkage.studies.captions import class_and_shape
from soliton_linkage.studies.figures.registry import FIGURES
from soliton_linkage.studies.palette import GREY, MARKERS, chain_colours
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from

_CAPTION = """
Chains of rigid bars that swing in tilted gravity, after up to {steps:,} steps of the solver, a
colour and a marker for each class of chain. (a) Largest error of the length of a bar over its
length. (b) Absolute error of the energy over the largest kinetic or potential energy there was.
Each point is the largest of the frames since the point before; the dashed grey line is the
rounding of a number, {rounding:.1e}. Less than a hundredth of it is drawn as that.
"""
_ROUNDING = float(np.finfo(np.float64).eps)
_POINTS = 60
"""On a scale of logarithms [1]."""
_QUICK_STEPS = 3000
_PERIOD = 0.1
"""Of frames [time units]; a step is as long as the tolerance allows."""


@FIGURES.add('rigid_steps')
def rigid_steps_figure(section: Section, quick: bool) -> Plate:
    """Errors of lengths and energy against the number of steps."""
    section.allow('chains', 'steps', 'speed', 'acceleration', 'tilt')
    steps = section.whole_number('steps', 100, 100_000_000)
    steps = min(steps, _QUICK_STEPS) if quick else steps
    speed = section.number('speed', 0.0, 1e6)
    gravity = Gravity(
        section.number('acceleration', 0.0, 1e3), section.number('tilt', -math.pi, math.pi)
    )
    chains = [chain_from(each) for each in section.section('chains').sections().values()]
    figure = Figure(figsize=(11, 4.8), layout='constrained')
    plate = Plate(figure, _CAPTION.format(steps=steps, rounding=_ROUNDING))
    panels = figure.subplots(1, 2, sharex=True)
    progress = ProgressLine('rigid_steps', steps * len(chains))
    looks = zip(chains, chain_colours(chains), MARKERS, strict=False)
    for number, (chain, colour, marker) in enumerate(looks):
        taken, lengths, energies = _errors(chain, speed, gravity, steps, progress, number * steps)
        name = class_and_shape(chain)
        for axes, values, what in zip(
            panels, (lengths, energies), ('length', 'energy'), strict=True
        ):
            shown = np.maximum(values, 0.01 * _ROUNDING)
            axes.loglog(taken, shown, f'{marker}-', color=colour, markersize=4, label=name)
            plate.note(
                what, name, ('steps [1]', f'relative error of the {what} [1]'), taken, values
            )
            plate.compare(
                f'largest relative error of the {what} in {steps:,} steps, {name}',
                'not given',
                'none',
                float(values.max()),
                0.0,
            )
    progress.end(f'rigid_steps: {len(chains)} chains of {steps:,} steps')
    for axes, what in zip(panels, ('a  length of a bar', 'b  energy'), strict=True):
        axes.axhline(_ROUNDING, color=GREY, linestyle='--', linewidth=0.8, label='rounding')
        axes.set(xlabel='steps [1]', ylabel='relative error [1]')
        axes.set_title(what, loc='left')
    panels[0].legend()
    return plate


def _errors(
    chain: Chain, speed: float, gravity: Gravity, steps: int, progress: ProgressLine, before: int
) -> tuple[Array, Array, Array]:
    """Numbers of steps, and largest errors of lengths and of the energy since the one before."""
    angles = chain.uniform_state(-1)
    rates = speed / chain.time_unit * mode_towards_last(chain, angles)
    period = _PERIOD * chain.time_unit
    simulation = RigidSimulation(chain, angles, rates, period, gravity=gravity)
    ends = np.unique(np.geomspace(10, steps, _POINTS).round().astype(np.int64))
    taken, errors = 0, []
    for end in ends.tolist():
        largest = np.zeros(2)
        while taken < end:
            simulation.step()
            taken += 1
            while simulation.ready:
                simulation.advance()
            stretched = np.abs(chain.spring_extensions(simulation.angles) / chain.rest_lengths)
            drift = abs(simulation.energy_drift)
            largest = np.maximum(largest, [float(stretched.max()), drift])
            progress.show(before + taken, f'{taken:,} steps, {chain.motion.value}')
        errors.append(largest)
    lengths, energies = np.array(errors).T
    return ends.astype(np.float64), lengths, energies
