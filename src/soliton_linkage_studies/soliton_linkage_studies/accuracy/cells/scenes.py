# SPDX-License-Identifier: Apache-2.0
"""Scenes of cells: one wall, several, none, or what a strong kick leaves."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array
from soliton_linkage_studies.accuracy.cells.cells import AccuracyCell
from soliton_linkage_studies.accuracy.cells.scene import WallScene
from soliton_linkage_studies.accuracy.cells.several_walls import several_walls
from soliton_linkage_studies.accuracy.cells.single_wall import single_wall
from soliton_linkage_studies.accuracy.cells.springs import Springs

_SETTLED = (20, 400)
"""Frames after a kick that a scene begins."""


def scene_of(
    cell: AccuracyCell, frames: int, random: np.random.Generator, pushes: int = 0
) -> WallScene:
    """A scene of at least so many frames, but where several walls meet."""
    if cell.nothing:
        return _nothing(cell, frames, random)
    if cell.kick:
        return _broken(cell, frames, random)
    if cell.walls > 1:
        return several_walls(cell, frames, random)
    return single_wall(cell, frames, random, pushes)


def _broken(cell: AccuracyCell, frames: int, random: np.random.Generator) -> WallScene:
    """What a kick of the edge leaves: frames in which no wall need be."""
    chain = cell.chain
    angles = chain.uniform_state(-1)
    rates = cell.kick / chain.time_unit * mode_towards_last(chain, angles)
    springs = Springs(chain, angles, rates, cell.period * chain.time_unit)
    for _ in range(int(random.integers(*_SETTLED))):
        springs.advance()
    motion = springs.record(frames)
    return _empty(motion.angles, np.asarray(chain.kinetic_energy(motion.rates)))


def _nothing(cell: AccuracyCell, frames: int, random: np.random.Generator) -> WallScene:
    angles = random.uniform(-math.pi, math.pi, (frames, cell.chain.number_of_rotors))
    return _empty(angles, np.full(frames, math.nan))


def _empty(angles: Array, kinetic: Array) -> WallScene:
    none = np.empty((len(angles), 0))
    legs = np.full(len(angles), -1)
    return WallScene(angles, kinetic, none, none, none, (), legs, none.astype(bool))
