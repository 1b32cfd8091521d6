# SPDX-License-Identifier: Apache-2.0
"""Errors of the recursive estimator `OrbitFilter` after n frames of a wall at constant velocity.

Each of the n frames gives a wall position with the variance s^2 = (sigma / Lambda)^2. Here sigma
is the standard deviation of the angle noise, and Lambda is the arc length of the orbit per rotor
spacing. The frame period is dt. If a line is fitted to the n positions, its value in the last
frame has the variance 2 (2 n - 1) / (n (n + 1)) s^2, and its slope, the velocity, has the variance
12 / (n (n^2 - 1) dt^2) s^2. The square roots of these variances are the Cramer-Rao bounds of
position and velocity: no unbiased estimator has smaller rms errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.random import Generator

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage_studies.accuracy.estimators import bound, orbit_of
from soliton_linkage_studies.drawing import class_and_shape
from soliton_linkage_studies.figure_report import FigureReport, save_page
from soliton_linkage_studies.palette import MEASURED, RED, THEORY
from soliton_linkage_studies.settings import Section, setting

_CAPTION = """ Errors of the recursive estimator against the time since the first frame, for a wall
at a constant velocity of {speed:g} rotor spacings/s, angle noise of {noise:g} rad and {rate:g}
frames/s. Each column is a chain, named by its class and (r/a, θ̄). (a) Error of the position. (b)
Relative error of the velocity. Blue lines are root mean squares over {runs} runs. Dashed red lines
are the standard deviations stated by the estimator. Dotted black lines are the Cramér-Rao bound.
"""
_CLEAR = 8.0
"""The wall keeps this distance from both edges [rotor spacings], or less in a short chain."""
_QUANTITIES = ('position [rotor spacings]', 'velocity, relative')


@dataclass(frozen=True)
class RecordStudy:
    """Study of walls at constant velocity, with noisy encoders and several runs per chain."""

    chains: tuple[Chain, ...]
    noise: float = setting('standard deviation of the noise of each angle', 'rad', 1e-9, 1.0)
    speed: float = setting('wall speed', 'rotor spacings / s', 1e-6, 1e6)
    frame_rate: float = setting('frame rate', 'Hz', 1e-3, 1e6)
    frames: int = setting('number of frames per run', '1', 10, 10_000_000)
    runs: int = setting('number of runs per chain', '1', 2, 100_000)
    seed: int = setting('random seed', '', 0, 2**32)

    @property
    def shown(self) -> Array:
        """Frame counts n at which errors are evaluated, evenly spaced on a logarithmic scale."""
        return np.unique(np.geomspace(3, self.frames, 60).round().astype(np.int64))

    def tasks(self) -> list[Callable[[], Any]]:
        """Return the tasks: all runs of all chains."""
        numbers = product(range(len(self.chains)), range(self.runs))
        return [partial(self.run, *each) for each in numbers]

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write the table and the picture; `results` are the results of the tasks in order."""
        figure = Figure(figsize=(1 + 4.5 * len(self.chains), 8), layout='constrained')
        given = {'speed': self.speed, 'noise': self.noise, 'rate': self.frame_rate}
        report = FigureReport(figure, _CAPTION.format(**given, runs=self.runs))
        panels = figure.subplots(2, len(self.chains), sharex=True, sharey='row', squeeze=False)
        for number, chain in enumerate(self.chains):
            runs = np.array(results[number * self.runs : (number + 1) * self.runs])
            self._draw(report, list(panels[:, number]), chain, runs)
            self._compare(report, chain, runs)
        panels[0, 0].legend(loc='lower left')
        save_page(report, folder, 'record', 'record.md')

    def run(self, chain: int, run: int) -> Array:
        """Simulate a run; return errors and stated standard deviations, shape (4, frame counts).

        The rows are the position error [rotor spacings], the relative velocity error [1], and the
        stated standard deviations of both.
        """
        # This import is slow, and the other parts of the command do not need it.
        from soliton_linkage.estimation.orbit_filter import OrbitFilter

        orbit = orbit_of(self.chains[chain])
        generator = np.random.default_rng([self.seed, chain, run])
        begin = self._begin(orbit, generator)
        rate = self.speed * orbit.site_arc
        recursive = OrbitFilter(orbit)
        shown, found = set(self.shown.tolist()), []
        for frame in range(self.frames):
            elapsed = frame / self.frame_rate
            arc = begin + rate * elapsed
            noise = self.noise * generator.standard_normal(orbit.chain.number_of_rotors)
            estimate = recursive.update(elapsed, orbit.configuration(arc) + noise)
            if frame + 1 in shown:
                error = math.remainder(estimate.arc - arc, orbit.length) / orbit.site_arc
                stated = estimate.arc_deviation / orbit.site_arc, estimate.rate_deviation / rate
                found.append((error, estimate.rate / rate - 1, *stated))
        return np.array(found).T

    def _begin(self, orbit: UniformOrbit, generator: Generator) -> float:
        last = orbit.chain.number_of_rotors - 1.0
        room = max(last - self.speed * self.frames / self.frame_rate, 0.0)
        clear = min(_CLEAR, room / 2)
        ahead = float(generator.uniform(clear, room - clear))
        leg = int(generator.integers(orbit.number_of_legs))
        return orbit.arc_at(ahead if leg % 2 == 0 else last - ahead, leg)

    def bounds(self, chain: Chain) -> tuple[Array, Array]:
        """Return the Cramer-Rao bounds of position [rotor spacings] and relative velocity [1]."""
        n = self.shown.astype(np.float64)
        single = bound(chain, self.noise)
        of_position = single * np.sqrt(2 * (2 * n - 1) / (n * (n + 1)))
        of_velocity = single * np.sqrt(12 / (n * (n**2 - 1))) * self.frame_rate
        return of_position, of_velocity / self.speed

    def _draw(
        self, report: FigureReport, column: Sequence[Axes], chain: Chain, runs: Array
    ) -> None:
        times, title = self.shown / self.frame_rate, class_and_shape(chain)
        for number, (axes, least) in enumerate(zip(column, self.bounds(chain), strict=True)):
            names = ('time [s]', _QUANTITIES[number])
            for name, curve, colour, style, width in (
                ('error, rms of the runs', _root_mean_square(runs[:, number]), MEASURED, '-', 2.0),
                ('stated deviation', _root_mean_square(runs[:, number + 2]), RED, '--', 2.0),
                ('bound of Cramér and Rao', least, THEORY, ':', 1.5),
            ):
                look = {'color': colour, 'linewidth': width, 'label': name}
                report.plot(axes, (title, name), names, times, curve, style, **look)
            axes.set(xscale='log', yscale='log')
        column[0].set(title=title)
        column[1].set(xlabel='time since the first frame [s]')
        if chain == self.chains[0]:
            column[0].set(ylabel='a  error of the position [rotor spacings]')
            column[1].set(ylabel='b  relative error of the velocity [1]')

    def _compare(self, report: FigureReport, chain: Chain, runs: Array) -> None:
        for number, least in enumerate(self.bounds(chain)):
            for shown in (len(self.shown) // 2, len(self.shown) - 1):
                stated = _root_mean_square(runs[:, number + 2, shown])
                quantity = (
                    f'{_QUANTITIES[number]}, rms error after {self.shown[shown]} frames, stated '
                    f'as {stated:.3g}, {class_and_shape(chain)}'
                )
                both = float(_root_mean_square(runs[:, number, shown])), float(least[shown])
                report.add_comparison(quantity, '', 'bound of Cramér and Rao', *both)


def read_record_study(section: Section, quick: bool) -> RecordStudy:
    """Read the settings. Raises ValueError for invalid settings."""
    chains = tuple(section.chains().values())
    study = RecordStudy(chains, **section.values_of(RecordStudy, 'chains'))
    return replace(study, runs=min(study.runs, 4)) if quick else study


def _root_mean_square(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
