# SPDX-License-Identifier: Apache-2.0
"""Errors of bar lengths and energy after many steps of the rigid-bar simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage_studies.drawing import class_and_shape
from soliton_linkage_studies.figure_report import new_report, save_page
from soliton_linkage_studies.palette import GREY, MARKERS, chain_colours
from soliton_linkage_studies.settings import Section, setting

_CAPTION = """ Chains of rigid bars that swing in tilted gravity, for up to {steps:,} solver steps.
Each class of chain has a colour and a marker. (a) Largest relative error of a bar length. (b)
Absolute error of the energy, divided by the largest kinetic or potential energy so far. Each point
is the maximum since the previous point. The dashed grey line is the rounding error {rounding:.1e}
of a number. Values below a hundredth of this error are drawn at a hundredth of it.
"""
_ROUNDING = float(np.finfo(np.float64).eps)
_PERIOD = 0.1
"""Frame period [sqrt(M / k_e)]; it does not change the solver steps."""
_QUANTITIES = ('length', 'energy')


@dataclass(frozen=True)
class RigidSteps:
    """Study of the errors after many steps of chains that swing under gravity."""

    chains: tuple[Chain, ...]
    gravity: Gravity
    steps: int = setting('number of solver steps', '1', 100, 100_000_000)
    speed: float = setting('norm of the initial rotor rates', 'rad / time unit', 0.0, 1e6)

    def tasks(self) -> list[Callable[[], Any]]:
        """Return one task per chain."""
        return [partial(self.errors, chain) for chain in self.chains]

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write the table and the picture; `results` are the results of the tasks in order."""
        caption = _CAPTION.format(steps=self.steps, rounding=_ROUNDING)
        report = new_report(caption, 11, 4.8)
        panels = report.figure.subplots(1, 2, sharex=True)
        styles = zip(self.chains, results, chain_colours(self.chains), MARKERS, strict=False)
        for chain, (taken, *errors), colour, marker in styles:
            name = class_and_shape(chain)
            for axes, values, what in zip(panels, errors, _QUANTITIES, strict=True):
                shown = np.maximum(values, 0.01 * _ROUNDING)
                axes.loglog(taken, shown, f'{marker}-', color=colour, markersize=4, label=name)
                axes_names = ('steps [1]', f'relative error of the {what} [1]')
                report.add_points(what, name, axes_names, taken, values)
                quantity = f'largest relative error of the {what} in {self.steps:,} steps, {name}'
                rounding = f'rounding, {_ROUNDING:.1e}'
                report.add_comparison(quantity, '', rounding, float(values.max()))
        for axes, what in zip(panels, ('a  length of a bar', 'b  energy'), strict=True):
            axes.axhline(_ROUNDING, color=GREY, linestyle='--', linewidth=0.8, label='rounding')
            axes.set(xlabel='steps [1]', ylabel='relative error [1]')
            axes.set_title(what, loc='left')
        panels[0].legend()
        save_page(report, folder, 'rigid_steps', 'rigid_steps.md')

    def errors(self, chain: Chain) -> tuple[Array, Array, Array]:
        """Return K step counts, and the largest errors of bar length and energy, (K,) each.

        The errors of bar length [1] are relative errors. The errors of energy [1] are absolute
        values of `Simulation.energy_drift`. Both belong to all steps since the previous count; for
        the first count, to all steps since the start.
        """
        angles = chain.uniform_state(-1)
        rates = self.speed / chain.time_unit * mode_towards_last(chain, angles)
        period = _PERIOD * chain.time_unit
        simulation = RigidSimulation(chain, angles, rates, period, gravity=self.gravity)
        ends = np.unique(np.geomspace(10, self.steps, 60).round().astype(np.int64))
        taken, errors = 0, []
        for end in ends.tolist():
            largest = np.zeros(2)
            while taken < end:
                simulation.step()
                taken += 1
                while simulation.ready:
                    simulation.advance()
                stretched = np.abs(chain.spring_extensions(simulation.angles))
                of_length = float((stretched / chain.rest_lengths).max())
                largest = np.maximum(largest, [of_length, abs(simulation.energy_drift)])
            errors.append(largest)
        return (ends.astype(np.float64), *np.array(errors).T)


def read_rigid_steps(section: Section, quick: bool) -> RigidSteps:
    """Read the settings. Raises ValueError for invalid settings."""
    acceleration = section.number('acceleration', 0.0, 1e3)
    gravity = Gravity(acceleration, section.number('tilt', -math.pi, math.pi))
    values = section.values_of(RigidSteps, 'chains', 'acceleration', 'tilt')
    study = RigidSteps(tuple(section.chains().values()), gravity, **values)
    if not quick:
        return study
    return replace(study, chains=study.chains[:1], steps=min(study.steps, 1000))
