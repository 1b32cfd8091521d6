# SPDX-License-Identifier: Apache-2.0
"""What an analyser makes of noisy records of a scene: normalised errors and failures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from soliton_linkage import estimation
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import AnalysedSoliton
from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage_studies.accuracy.cells import (
    GIVEN,
    AccuracyCell,
    given_of,
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
"""Widths of a wall by which an estimate that is of this wall is off at most, or"""
_LOST = 1.0
"""rotor spacings, or"""
_LOST_DEVIATIONS = 6.0
"""of its own standard deviations, where these are below"""
_SURE = 0.25
"""of the chain: a wall stated with more is nowhere, and false."""
_ELSEWHERE = 0.5
"""Misfit of the rotors about a stated wall from which on there is none [rad], rms."""
_CORE = 2.5
"""Reach of these rotors [rotor spacings]."""
_SCENES = 8
"""Of a cell, from which records are drawn."""
_LONGER = 2
"""Frames of a scene, over those of a record."""
_NEAR = 3.0
"""Rotors beside a wall of which one reading is wrong in half of the records [rotor spacings]."""


def records(cell: AccuracyCell, frames: int, random: np.random.Generator) -> Iterator[Scores]:
    """Scores of records with so many frames together."""
    run = min(cell.run, frames)
    left, fresh = frames, Analyser(cell.told_chain or cell.chain)
    scenes: list[WallScene] = []
    count = math.ceil(frames / run)
    pushes = math.ceil(cell.pushes / min(_SCENES, count))
    for number in range(10 * count):
        if number < min(_SCENES, count):
            scenes.append(scene_of(cell, min(_LONGER * run, frames), random, pushes))
        scene = scenes[number % len(scenes)]
        length = min(run, left, len(scene.angles))
        begin = int(random.integers(len(scene.angles) - length + 1))
        yield record(cell, fresh, scene, range(begin, begin + length), random)
        left -= length
        if left <= 0:
            return


def record(
    cell: AccuracyCell,
    fresh: Analyser,
    scene: WallScene,
    frames: range,
    random: np.random.Generator,
) -> Scores:
    """Have a copy of a fresh analyser follow the frames of a record, and judge what it says."""
    analyser, scores = deepcopy(fresh), Scores()
    if scene.charges:
        sound = speed_of_sound(cell.chain) / cell.chain.spacing
        scores.speed = float(np.median(np.abs(scene.site_rates), axis=0).max()) / sound
    twin = deepcopy(fresh) if cell.wrong else None
    seen = _seen(cell, random)
    period = cell.period * cell.chain.time_unit
    for number, frame in enumerate(frames):
        angles = scene.angles[frame] + cell.noise * random.standard_normal(len(seen))
        outliers = random.random(len(seen)) < cell.outliers
        angles[outliers] = random.uniform(-math.pi, math.pi, int(outliers.sum()))
        angles[~seen] = np.nan
        if cell.degrees:
            angles = np.degrees(angles)
        stamp = round(1e9 * number * period)
        clean = twin.analyse(stamp, angles) if twin else None
        last = frame == frames[-1]
        if last and cell.wrong:
            angles[_spoilt(scene.places[frame, 0], len(angles), random)] += cell.wrong
        if cell.told and frame in scene.pushes:
            analyser.apply_impulse(stamp, scene.impulses[scene.pushes.index(frame)])
        said = analyser.analyse(stamp, angles)
        assert said is not None
        if last or not cell.wrong:
            _judge(cell, scene, frame, said, scores)
        if last and clean is not None:
            _compare(cell, said, clean, scores)
    return scores


def _seen(
    cell: AccuracyCell, random: np.random.Generator
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    rotors = cell.chain.number_of_rotors
    seen = np.ones(rotors, dtype=bool)
    if cell.unseen == 'edges':
        seen[[0, -1]] = False
    elif cell.unseen:
        seen[:] = False
        count = 1 if cell.unseen == 'all but one' else 3
        seen[random.choice(rotors, count, replace=False)] = True
    return seen


def _spoilt(place: float, rotors: int, random: np.random.Generator) -> int:
    """The rotor whose reading is wrong: any, or one next to the wall."""
    if random.integers(2):
        return int(random.integers(rotors))
    return min(max(round(place + random.uniform(-_NEAR, _NEAR)), 0), rotors - 1)


def _judge(
    cell: AccuracyCell, scene: WallScene, frame: int, said: Analysis, scores: Scores
) -> None:
    scores.frames += 1
    stated = [each for each in said.solitons if math.isfinite(each.position_deviation)]
    if cell.misread or not scene.charges:
        scores.false += sum(_is_false(cell, scene.angles[frame], wall) for wall in stated)
        return
    if said.energies is not None and said.energies.kinetic_deviation > 0:
        off = said.energies.kinetic - scene.kinetic[frame]
        scores.kinetic.append(float(off / said.energies.kinetic_deviation))
    for number, charge in enumerate(scene.charges):
        instant = float(scene.instants[frame, number])
        near = [wall for wall in stated if wall.charge == charge and _of(cell, wall, instant)]
        near.sort(key=lambda wall: abs(wall.rotor - instant))
        for wall in near[:1]:
            stated.remove(wall)
        if not scene.judged[frame, number]:
            continue
        scores.looked_for += 1
        scores.lost += not near
        for wall in near[:1]:
            scores.walls.append(_numbers(cell, scene, frame, number, wall))
    if scene.judged[frame].all():
        scores.false += len(stated)
        if scene.legs[frame] >= 0 and said.cycle.leg >= 0:
            scores.wrong_leg += said.cycle.leg != scene.legs[frame]


def _of(cell: AccuracyCell, wall: AnalysedSoliton, place: float) -> bool:
    """Whether a stated wall is the one at a place."""
    chain = cell.chain
    deviation = wall.position_deviation / chain.spacing
    if deviation > _SURE * chain.number_of_rotors:
        return False
    limit = max(_LOST_WIDTHS * chain.wall_width / chain.spacing, _LOST)
    return abs(wall.rotor - place) < max(limit, _LOST_DEVIATIONS * deviation)


def _numbers(
    cell: AccuracyCell, scene: WallScene, frame: int, number: int, wall: AnalysedSoliton
) -> tuple[float, ...]:
    spacing = cell.chain.spacing
    deviation = wall.position_deviation / spacing
    error = wall.rotor - float(scene.places[frame, number])
    of_instant = wall.rotor - float(scene.instants[frame, number])
    rate = float(scene.site_rates[frame, number])
    rate_error = wall.velocity / spacing - rate
    return (
        error / deviation,
        of_instant / deviation,
        rate_error / (wall.velocity_deviation / spacing),
        error,
        deviation,
        rate_error / rate if rate else math.nan,
    )


def _is_false(cell: AccuracyCell, angles: Array, wall: AnalysedSoliton) -> bool:
    """Whether there is no wall where one is stated: none looks like these rotors."""
    chain = cell.chain
    if cell.misread or wall.position_deviation > _SURE * chain.number_of_rotors * chain.spacing:
        return True
    inner = chain.number_of_rotors - 1
    legs = (0, 1) if chain.motion is Motion.SPINNER and wall.charge > 0 else (0,)
    place = min(max(wall.rotor, 1.0), inner - 1.0)
    off = min(
        wall_path(chain, wall.charge, leg).misfit(image, place, _CORE)
        for leg in legs
        for image in (angles, math.pi - angles)
    )
    return off > _ELSEWHERE


def _compare(cell: AccuracyCell, said: Analysis, clean: Analysis, scores: Scores) -> None:
    """How far a wrong reading moved the only wall, where it was there before."""
    if len(clean.solitons) != 1:
        return
    before = clean.solitons[0]
    if not said.solitons or not math.isfinite(before.position_deviation):
        return
    after = min(said.solitons, key=lambda wall: abs(wall.rotor - before.rotor))
    moved = abs(after.position - before.position)
    scores.shifts.append(float(moved / after.position_deviation))


_QUICK_FRAMES = 200
"""Of each cell in a quick study [1]."""
_QUICK_CELLS = 15
"""Of them drawn at random, five of a class [1]."""


@dataclass(frozen=True)
class CellStudy:
    """Cells drawn by a seed, and hard ones, of which some may be chosen by name."""

    seed: int
    count: int
    frames: int
    only: tuple[str, ...] = ()
    name: str = 'cells'

    @cached_property
    def all(self) -> list[AccuracyCell]:
        """The cells in the order of the rows."""
        known = [*random_cells(self.seed, self.count), *hard_cells()]
        names = select_names([cell.name for cell in known], self.only, '--cells')
        return [cell for cell in known if cell.name in names]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        return ('row', 'cell', *GIVEN, *COLUMNS, 'failure')

    @property
    def rows(self) -> int:
        """Number of cells."""
        return len(self.all)

    def cells(self, row: int) -> list[str]:
        """Measure a cell, as text; where it cannot be it says why."""
        cell = self.all[row]
        line: dict[str, float] = {}
        failure = ''
        # A seed of its own, whichever cells are chosen beside it.
        name = int.from_bytes(cell.name.encode(), 'big')
        random = np.random.default_rng([self.seed, name])
        try:
            line = line_of(list(records(cell, self.frames, random)))
        except (ArithmeticError, ValueError) as error:
            failure = ' '.join(str(error).split())
        measured = [number_text(line.get(name, math.nan)) for name in COLUMNS]
        return [str(row), cell.name, *given_of(cell), *measured, failure]

    def described(self) -> dict[str, Any]:
        """All that the rows depend on, the estimator among it."""
        return {
            'seed': self.seed,
            'frames': self.frames,
            'cells': [cell.name for cell in self.all],
            'estimator': fingerprint(estimation),
        }


def read_cell_study(
    section: Section, quick: bool, seed: int, frames: int | None, only: Sequence[str]
) -> CellStudy:
    """Read the settings; raises ValueError for what cannot be studied."""
    section.check_keys('count', 'frames')
    count = section.whole_number('count', 0, 10_000)
    wanted = frames or section.whole_number('frames', 1, 10_000_000)
    if not quick:
        return CellStudy(seed, count, wanted, tuple(only))
    few = frames or min(wanted, _QUICK_FRAMES)
    return CellStudy(seed, min(count, _QUICK_CELLS), few, tuple(only), 'cells_quick')
