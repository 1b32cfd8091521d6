# SPDX-License-Identifier: Apache-2.0
"""Lorentz contraction of walls, measured from noisy angles only (paper, Figs. 5 and 6)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage_studies.drawing import class_and_shape
from soliton_linkage_studies.experiments import crossing_duration, first_passage, record_kick
from soliton_linkage_studies.figure_report import Comparison, FigureReport, Formula, write_table
from soliton_linkage_studies.palette import BLACK, MEASURED, PAPER
from soliton_linkage_studies.settings import Section, setting

_CAPTION = """ Lorentz contraction of walls (paper, Figs. 5 and 6), measured by the analyser from
{source} with encoder noise of {noise:g} rad. Each panel is a chain, named by its class and (r/a,
θ̄). Blue dots show the width w relative to the width at rest, against the speed v relative to the
speed of sound c, while the wall is in the middle of its chain. The width is the mean of the widths
that the analyser reports; the speed is the slope of a line fitted to the positions. Error bars are
two standard deviations on both sides; invisible bars are smaller than the dot. The red line is √(1
− v²/c²) from the paper. Diamonds are walls of the same chains, simulated without noise by an
independent integrator; their widths are from fits of tanh.
"""
SIMULATED, RECORDED = 'contraction_simulated', 'contraction_recorded'
"""File names of the results, without suffix. The first is for walls in simulated frames, the
second for walls in bags that the ROS nodes have recorded."""
_SOURCES = {SIMULATED: 'simulated frames', RECORDED: 'bags that the nodes recorded'}
_FEWEST_FRAMES = 10
"""Smallest number of frames with the wall in the middle of the chain that give a result [1]."""


@dataclass(frozen=True)
class ContractedWall:
    """Measured speed and width of one wall."""

    speed: float
    """Speed [speed of sound]."""
    speed_deviation: float
    """Standard deviation of the speed [speed of sound]."""
    width: float
    """Measured width, divided by the theoretical width at rest `Chain.wall_width` [1]."""
    width_deviation: float
    """Standard deviation of `width` [1]."""


@dataclass(frozen=True)
class Walls:
    """Chain and kicks. In one simulation per kick, the kick starts a wall in the chain at rest."""

    name: str
    chain: Chain
    kicks: tuple[float, ...]
    """Kicks v0 = r |phi_dot| [a sqrt(k_e / M)] with the norm |phi_dot| of the initial rates."""
    reference: Mapping[float, tuple[float, float]]
    """Results of an independent integrator without noise for some of the kicks: wall speed [a
    sqrt(k_e / M)], and width of a fitted tanh divided by the theoretical width at rest [1]."""


@dataclass(frozen=True)
class ContractionStudy:
    """Study of wall contraction: chains, kicks and encoder noise."""

    walls: tuple[Walls, ...]
    noise: float = setting('standard deviation of the noise of each angle', 'rad', 0.0, 1.0)
    frames: int = setting('number of frames from edge to edge', '1', 50, 1_000_000)
    seed: int = setting('random seed', '', 0, 2**32)

    def tasks(self) -> list[Callable[[], Any]]:
        """Return the tasks: first the passages of all walls, then the widths at rest."""
        both = [
            (n, kick) for n, walls in enumerate(self.walls) for kick in range(len(walls.kicks))
        ]
        passages = [partial(self.passage, *each) for each in both]
        return [*passages, *(partial(rest_width, walls.chain) for walls in self.walls)]

    def write(self, results: Sequence[Any], folder: Path, name: str = SIMULATED) -> None:
        """Write the results of the tasks as a table and a picture with the file name `name`."""
        figure = Figure(figsize=(6 * len(self.walls), 5), layout='constrained')
        caption = _CAPTION.format(source=_SOURCES[name], noise=self.noise)
        report = FigureReport(figure, caption)
        panels = report.figure.subplots(1, len(self.walls), squeeze=False)[0]
        passages, at_rest = list(results[: -len(self.walls)]), results[-len(self.walls) :]
        lines: dict[str, list[Comparison]] = {}
        for axes, walls, rest in zip(panels, self.walls, at_rest, strict=True):
            own = [passages.pop(0) for _ in walls.kicks]
            _draw(report, axes, walls, own, rest)
            lines[walls.name] = _comparisons(walls, own, rest)
        report.save(folder, name)
        write_table(lines, folder / f'{name}.md', list(lines))

    def duration(self, walls: int, kick: int) -> float:
        """Return the simulated time of `passage(walls, kick)` [sqrt(M / k_e)]."""
        chain, kicks = self.walls[walls].chain, self.walls[walls].kicks
        return crossing_duration(chain, kicks[kick])

    def passage(self, walls: int, kick: int) -> ContractedWall:
        """Simulate kick number `kick` of `self.walls[walls]`; measure the wall that it starts."""
        chain, kicks = self.walls[walls].chain, self.walls[walls].kicks
        generator = np.random.default_rng([self.seed, walls, kick])
        recording = record_kick(chain, kicks[kick], self.duration(walls, kick), self.frames)
        noise = self.noise * generator.standard_normal(recording.angles.shape)
        return measured_passage(chain, recording.times, recording.angles + noise)


def measured_passage(chain: Chain, times: Array, angles: Array) -> ContractedWall:
    """Analyse frames; measure speed and width of the wall while it is in the middle of the chain.

    `times` [s] has shape (T,), the noisy `angles` [rad] have shape (T, N). The middle is the range
    from 35 to 65 % of the length of the chain. Raises ValueError for fewer than ten frames with
    the wall in this range.
    """
    analyser = Analyser(chain)
    stamps = np.rint(1e9 * times).astype(np.int64).tolist()
    analyses = [analyser.analyse(*frame) for frame in zip(stamps, angles, strict=True)]
    return passage_of(chain, times, [each.solitons if each else () for each in analyses])


def passage_of(
    chain: Chain, times: Array, frames: Sequence[tuple[AnalysedSoliton, ...]]
) -> ContractedWall:
    """Measure speed and width of a wall on its first passage through the middle of the chain.

    `frames` contains the walls found at each of the `times` [s], shape (T,). The middle is the
    range from 35 to 65 % of the length of the chain. Only frames with exactly one wall are used.
    The speed is the slope of a line fitted to the wall positions. Its standard deviation is
    estimated as if only the first and the last position were known, with independent errors: it is
    sqrt(2) times the median stated standard deviation of a position, divided by the duration of
    the passage. The width is the mean over the frames. The standard deviation of the width is the
    smallest one that the analyser states in a frame; the mean is hardly more accurate, because the
    widths in successive frames are correlated. Raises ValueError for fewer than ten frames.
    """
    both = zip(times, frames, strict=True)
    alone = [(time, walls[0]) for time, walls in both if len(walls) == 1]
    passage = first_passage(chain, np.array([wall.rotor for _, wall in alone]))
    inside = [each for each in alone[passage] if math.isfinite(each[1].width_deviation)]
    if len(inside) < _FEWEST_FRAMES:
        raise ValueError(
            f'the wall was in the middle of the chain in {len(inside)} frames, but '
            f'{_FEWEST_FRAMES} are required; record more frames or reduce the kick'
        )
    sound, at_rest = speed_of_sound(chain), chain.wall_width
    times_inside = np.array([time for time, _ in inside])
    walls = [wall for _, wall in inside]
    slope = np.polyfit(times_inside, [wall.position for wall in walls], 1)[0]
    of_position = float(np.median([wall.position_deviation for wall in walls]))
    duration = float(times_inside[-1] - times_inside[0])
    return ContractedWall(
        speed=abs(float(slope)) / sound,
        speed_deviation=math.sqrt(2) * of_position / duration / sound,
        width=float(np.mean([wall.width for wall in walls])) / at_rest,
        width_deviation=min(wall.width_deviation for wall in walls) / at_rest,
    )


def rest_width(chain: Chain) -> float:
    """Return the fitted width of a static wall, divided by `Chain.wall_width` [1].

    The result is a mean over wall positions that cover two rotor spacings in the middle of the
    chain.
    """
    middle = chain.number_of_rotors // 2 - 1
    walls = (static_wall(chain, middle + position) for position in np.arange(0, 2, 0.1))
    found = [find_solitons(chain, wall) for wall in walls]
    widths = np.array([walls[0].width for walls in found if len(walls) == 1])
    return float((widths[np.isfinite(widths)] / chain.wall_width).mean())


def read_contraction_study(section: Section, quick: bool) -> ContractionStudy:
    """Read the settings. Raises ValueError for invalid settings."""
    chains = section.sections('chains')
    walls = tuple(_walls(name, each, quick) for name, each in chains.items())
    study = ContractionStudy(walls, **section.values_of(ContractionStudy, 'chains'))
    return replace(study, frames=min(study.frames, 400)) if quick else study


def _walls(name: str, section: Section, quick: bool) -> Walls:
    section.check_keys('chain', 'kicks', 'reference')
    kicks = section.numbers('kicks', 1e-6, 100.0)
    known = section.section('reference')
    known.check_keys('kicks', 'speeds', 'widths')
    known_kicks = known.numbers('kicks', 1e-6, 100.0)
    found = {key: known.numbers(key, 0.0, 100.0) for key in ('speeds', 'widths')}
    for key, values in found.items():
        if len(values) != (count := len(known_kicks)):
            raise known.error(key, f'must have one value per kick ({count}); add or remove values')
    pairs = zip(found['speeds'], found['widths'], strict=True)
    reference = dict(zip(known_kicks, pairs, strict=True))
    chain = section.chain()
    return Walls(name, chain, kicks[::4] if quick else kicks, reference)


def _draw(
    report: FigureReport, axes: Axes, walls: Walls, passages: Sequence[ContractedWall], rest: float
) -> None:
    rows = [
        (each.speed, each.width, each.speed_deviation, each.width_deviation) for each in passages
    ]
    speeds, widths, of_speeds, of_widths = np.array(rows).T
    fine = np.linspace(0, 1, 400)
    axes.plot(fine, np.sqrt(1 - fine**2), color=PAPER, label='√(1 − v²/c²) (paper)')
    sound = speed_of_sound(walls.chain) / walls.chain.spacing * walls.chain.time_unit
    known = np.array(list(walls.reference.values())) / [sound, rest]
    label = 'independent integrator, no noise, tanh fit'
    (hollow,) = axes.plot(*known.T, 'D', color=BLACK, markersize=11, label=label)
    hollow.set_markerfacecolor('none')
    look: Any = {'fmt': 'o', 'color': MEASURED, 'markersize': 4, 'capsize': 3}
    label = 'measured from noisy angles, ± 2 std'
    axes.errorbar(speeds, widths, 2 * of_widths, 2 * of_speeds, label=label, **look)
    axes.set(xlabel='v / c [1]', ylabel='w / w at rest [1]', xlim=(0, 1), ylim=(0, 1.05))
    axes.set(title=f'{class_and_shape(walls.chain)}, {walls.chain.number_of_rotors} rotors')
    axes.legend(loc='lower left')
    for values, quantity in (
        (widths, 'w / w at rest [1]'),
        (of_widths, 'standard deviation of w / w at rest [1]'),
    ):
        report.add_points(walls.name, 'measured', ('v / c [1]', quantity), speeds, values)


def _comparisons(
    walls: Walls, passages: Sequence[ContractedWall], rest: float
) -> list[Comparison]:
    chain = walls.chain
    sound = speed_of_sound(chain) / chain.spacing * chain.time_unit
    lines = []
    for kick, passage in zip(walls.kicks, passages, strict=True):
        speed, width = walls.reference.get(kick, (math.nan, math.nan))
        slowed = min(passage.speed, 1.0)
        law = Formula('√(1 − (v/c)²)', math.sqrt(1 - slowed**2), {'v/c': slowed})
        where = f'{class_and_shape(chain)}, v₀ = {kick:g}'
        of_width = f'w / w at rest at {passage.speed:.3f} c'
        for quantity, deviation, paper, measured, expected in (
            ('v [a√(k_e/M)]', passage.speed_deviation * sound, '', passage.speed * sound, speed),
            (of_width, passage.width_deviation, law, passage.width, width / rest),
        ):
            source = 'independent integrator' if kick in walls.reference else ''
            name = f'{quantity} ± {deviation:.5f}, {where}'
            lines.append(Comparison(name, paper, source, measured, expected))
    return lines
