# SPDX-License-Identifier: Apache-2.0
"""Evaluation of the analyser on simulated records with known walls and added noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from soliton_linkage import estimation
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage_studies.accuracy.cells import (
    CELL_COLUMNS,
    AccuracyCell,
    cell_values,
    hard_cells,
    random_cells,
)
from soliton_linkage_studies.accuracy.scenes import WallScene, scene_of
from soliton_linkage_studies.accuracy.statistics import COLUMNS, Scores, line_of, number_text
from soliton_linkage_studies.accuracy.walls import wall_path
from soliton_linkage_studies.program import select_names
from soliton_linkage_studies.settings import Section
from soliton_linkage_studies.sweep.table import fingerprint

_LOST_WIDTHS = 2.0
"""A true wall is lost if each reported wall is farther away than this [wall widths], farther than
`_LOST`, and farther than `_LOST_DEVIATIONS`."""
_LOST = 1.0
"""Second limit of the distance of a lost wall [rotor spacings]; see `_LOST_WIDTHS`."""
_LOST_DEVIATIONS = 6.0
"""Third limit of the distance of a lost wall [stated standard deviations]; see `_LOST_WIDTHS`."""
_LARGEST_DEVIATION = 0.25
"""A reported wall is false if the stated standard deviation of its position is above this [chain
lengths]."""
_FALSE_MISFIT = 0.5
"""If a kick has destroyed the wall of a scene, the true walls are unknown. A reported wall is then
false if the rms misfit between the angles and a static wall at its position is above this
[rad]."""
_CORE = 2.5
"""The misfit of a wall is computed from rotors within this distance of the wall [rotor
spacings]."""
_SCENES = 8
"""Largest number of simulated scenes per cell [1]; a record is a random part of one of them."""
_LONGER = 2
"""Number of frames of a scene, divided by the number of frames of a record [1]."""
_NEAR = 3.0
"""With probability 1/2, the wrong reading is at most this far from the wall [rotor spacings].
Otherwise it is at any random rotor."""


def records(cell: AccuracyCell, frames: int, random: Generator) -> Iterator[Scores]:
    """Simulate and analyse records with `frames` frames in total; yield scores of each record."""
    run = min(cell.run, frames)
    left, template = frames, Analyser(cell.analysed_chain)
    scenes: list[WallScene] = []
    count = math.ceil(frames / run)
    for number in range(10 * count):
        if number < min(_SCENES, count):
            scenes.append(scene_of(cell, min(_LONGER * run, frames), random))
        scene = scenes[number % len(scenes)]
        length = min(run, left, len(scene.angles))
        begin = int(random.integers(len(scene.angles) - length + 1))
        yield record(cell, template, scene, range(begin, begin + length), random)
        left -= length
        if left <= 0:
            return


def record(
    cell: AccuracyCell, template: Analyser, scene: WallScene, frames: range, random: Generator
) -> Scores:
    """Analyse frames of a scene with a copy of the unused analyser `template`; return scores."""
    analyser, scores = deepcopy(template), Scores()
    if scene.charges:
        sound = speed_of_sound(cell.chain) / cell.chain.spacing
        scores.speed = float(np.median(np.abs(scene.site_rates), axis=0).max()) / sound
    reference = deepcopy(template) if cell.wrong_reading else None
    readable = _rotors_with_encoder(cell, random)
    period = cell.period * cell.chain.time_unit
    late = np.zeros(len(frames))
    if cell.jitter:
        late = cell.jitter * random.standard_normal(len(frames))
    for number, frame in enumerate(frames):
        angles = scene.angles[frame] + cell.noise * random.standard_normal(len(readable))
        angles[::10] += cell.offsets
        outliers = random.random(len(readable)) < cell.outliers
        angles[outliers] = random.uniform(-math.pi, math.pi, int(outliers.sum()))
        angles[~readable] = np.nan
        if cell.degrees:
            angles = np.degrees(angles)
        stamp = round(1e9 * (number + float(late[number])) * period)
        clean = reference.analyse(stamp, angles) if reference else None
        last = frame == frames[-1]
        if last and cell.wrong_reading:
            rotor = _wrong_rotor(scene.positions[frame, 0], len(angles), random)
            angles[rotor] += cell.wrong_reading
        if cell.impulses_known and frame in scene.impulse_frames:
            analyser.apply_impulse(stamp, scene.impulses[scene.impulse_frames.index(frame)])
        analysis = analyser.analyse(stamp, angles)
        if analysis is None:  # Jitter has made the stamp earlier than the previous one.
            continue
        if last or not cell.wrong_reading:
            _score(cell, scene, frame, analysis, scores)
        if last and clean is not None:
            _score_shift(cell, analysis, clean, scores)
    return scores


def _rotors_with_encoder(cell: AccuracyCell, random: Generator) -> NDArray[np.bool_]:
    rotors = cell.chain.number_of_rotors
    readable = np.ones(rotors, dtype=bool)
    if cell.unseen == 'edges':
        readable[[0, -1]] = False
    elif cell.unseen:
        readable[:] = False
        count = 1 if cell.unseen == 'all but one' else 3
        readable[random.choice(rotors, count, replace=False)] = True
    return readable


def _wrong_rotor(position: float, rotors: int, random: Generator) -> int:
    if random.integers(2):
        return int(random.integers(rotors))
    return min(max(round(position + random.uniform(-_NEAR, _NEAR)), 0), rotors - 1)


def _score(
    cell: AccuracyCell, scene: WallScene, frame: int, analysis: Analysis, scores: Scores
) -> None:
    scores.frames += 1
    stated = [each for each in analysis.solitons if math.isfinite(each.position_deviation)]
    if cell.invalid_input or not scene.charges:
        scores.false += sum(_is_false(cell, scene.angles[frame], wall) for wall in stated)
        return
    if analysis.energies is not None and analysis.energies.kinetic_deviation > 0:
        error = analysis.energies.kinetic - scene.kinetic[frame]
        scores.kinetic.append(float(error / analysis.energies.kinetic_deviation))
    for number, charge in enumerate(scene.charges):
        instant = float(scene.instants[frame, number])
        near = [wall for wall in stated if wall.charge == charge and _matches(cell, wall, instant)]
        near.sort(key=lambda wall: abs(wall.rotor - instant))
        for wall in near[:1]:
            stated.remove(wall)
        if not scene.scored[frame, number]:
            continue
        scores.walls_looked_for += 1
        scores.lost += not near
        for wall in near[:1]:
            scores.walls.append(_wall_values(cell, scene, frame, number, wall))
    if scene.scored[frame].all():
        scores.false += len(stated)
        if scene.legs[frame] >= 0 and analysis.cycle.leg >= 0:
            scores.wrong_leg += analysis.cycle.leg != scene.legs[frame]


def _matches(cell: AccuracyCell, wall: AnalysedSoliton, position: float) -> bool:
    chain = cell.chain
    deviation = wall.position_deviation / chain.spacing
    if deviation > _LARGEST_DEVIATION * chain.number_of_rotors:
        return False
    limit = max(_LOST_WIDTHS * chain.wall_width / chain.spacing, _LOST)
    return abs(wall.rotor - position) < max(limit, _LOST_DEVIATIONS * deviation)


def _wall_values(
    cell: AccuracyCell, scene: WallScene, frame: int, number: int, wall: AnalysedSoliton
) -> tuple[float, ...]:
    spacing = cell.chain.spacing
    deviation = wall.position_deviation / spacing
    error = wall.rotor - float(scene.positions[frame, number])
    of_instant = wall.rotor - float(scene.instants[frame, number])
    rate = float(scene.site_rates[frame, number])
    rate_error = wall.velocity / spacing - rate
    of_rate = rate_error / (wall.velocity_deviation / spacing)
    relative = rate_error / rate if rate else math.nan
    return error / deviation, of_instant / deviation, of_rate, error, deviation, relative


def _is_false(cell: AccuracyCell, angles: Array, wall: AnalysedSoliton) -> bool:
    chain = cell.chain
    limit = _LARGEST_DEVIATION * chain.number_of_rotors * chain.spacing
    if cell.invalid_input or wall.position_deviation > limit:
        return True
    inner = chain.number_of_rotors - 1
    legs = (0, 1) if chain.motion is Motion.SPINNER and wall.charge > 0 else (0,)
    position = min(max(wall.rotor, 1.0), inner - 1.0)
    error = min(
        wall_path(chain, wall.charge, leg).misfit(image, position, _CORE)
        for leg in legs
        for image in (angles, math.pi - angles)
    )
    return error > _FALSE_MISFIT


def _score_shift(cell: AccuracyCell, analysis: Analysis, clean: Analysis, scores: Scores) -> None:
    if len(clean.solitons) != 1:
        return
    before = clean.solitons[0]
    if not analysis.solitons or not math.isfinite(before.position_deviation):
        return
    after = min(analysis.solitons, key=lambda wall: abs(wall.rotor - before.rotor))
    moved = abs(after.position - before.position)
    scores.shifts.append(float(moved / after.position_deviation))


@dataclass(frozen=True)
class CellStudy:
    """Study of the analyser on random and difficult cells, or only on the cells in `only`."""

    seed: int
    count: int
    frames: int
    only: tuple[str, ...] = ()
    name: str = 'cells'

    @cached_property
    def all(self) -> list[AccuracyCell]:
        """Cells in the order of the rows. Raises ValueError if `only` contains an unknown name."""
        known = [*random_cells(self.seed, self.count), *hard_cells()]
        names = select_names([cell.name for cell in known], self.only, '--cells')
        return [cell for cell in known if cell.name in names]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        return ('row', 'cell', *CELL_COLUMNS, *COLUMNS, 'failure')

    @property
    def rows(self) -> int:
        """Number of cells."""
        return len(self.all)

    def cells(self, row: int) -> list[str]:
        """Measure a test cell; return its row as text.

        The last column is an error message, or empty if the measurement succeeded.
        """
        cell = self.all[row]
        line: dict[str, float] = {}
        failure = ''
        # The seed depends only on the cell's name, so that `only` does not change the results.
        name = int.from_bytes(cell.name.encode(), 'big')
        random = np.random.default_rng([self.seed, name])
        try:
            line = line_of(list(records(cell, self.frames, random)))
        except (ArithmeticError, ValueError) as error:
            failure = ' '.join(str(error).split())
        measured = [number_text(line.get(name, math.nan)) for name in COLUMNS]
        return [str(row), cell.name, *cell_values(cell), *measured, failure]

    def described(self) -> dict[str, Any]:
        """Return all data that determine the rows.

        They include a hash of the package `estimation`, which contains the analyser. An
        interrupted study can therefore continue only with the same analyser.
        """
        return {
            'seed': self.seed,
            'frames': self.frames,
            'cells': [cell.name for cell in self.all],
            'estimator': fingerprint(estimation),
        }


def read_cell_study(
    section: Section, quick: bool, seed: int, frames: int | None, only: Sequence[str]
) -> CellStudy:
    """Read the settings. Raises ValueError for invalid settings."""
    section.check_keys('count', 'frames')
    count = section.whole_number('count', 0, 10_000)
    wanted = frames or section.whole_number('frames', 1, 10_000_000)
    if not quick:
        return CellStudy(seed, count, wanted, tuple(only))
    fewer_frames = frames or min(wanted, 200)
    return CellStudy(seed, min(count, 15), fewer_frames, tuple(only), 'cells_quick')
