# SPDX-License-Identifier: Apache-2.0
"""Random cells cover their ranges, and the result of a cell does not depend on other cells."""

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Motion
from soliton_linkage_studies.accuracy.cells import hard_cells, random_cells
from soliton_linkage_studies.accuracy.runs import CellStudy
from soliton_linkage_studies.accuracy.walls import reach


def test_cells_have_all_classes_and_cover_their_ranges():
    cells = random_cells(20200101, 99)
    motions = [cell.chain.motion for cell in cells]
    assert all(motions.count(motion) == 33 for motion in Motion)
    assert {cell.walls for cell in cells} == {1, 2, 4}
    for values, low, high in (
        ([cell.noise for cell in cells], 0.001, 0.1),
        ([cell.speed for cell in cells], 0.02, 0.9),
        ([cell.chain.number_of_rotors for cell in cells], 10, 200),
    ):
        assert low <= min(values) < 2 * low
        assert high / 2 < max(values) <= high
    for cell in cells:
        chain = cell.chain
        assert abs(chain.lean_ratio / chain.critical_lean_ratio - 1) >= 0.02
        assert chain.number_of_rotors >= 2 * reach(chain) * cell.walls
    assert random_cells(20200101, 2) == cells[:2]
    assert random_cells(20200102, 2) != cells[:2]


def test_a_cell_does_not_depend_on_the_other_selected_cells():
    alone, all_of_them = CellStudy(1, 3, 10, ('2',)), CellStudy(1, 3, 10)
    assert alone.rows == 1
    first, second = alone.cells(0), all_of_them.cells(2)
    assert first[1:] == second[1:]
    assert len(first) == len(alone.columns)
    number = first[alone.columns.index('frames')]
    assert float(number) == 10


def test_the_analyser_is_configured_with_the_force_terms_of_a_cell():
    cells = {cell.name: cell for cell in hard_cells()}
    cell = cells['non_reciprocal_spinner']
    assert cell.analysed_chain == cell.chain
    assert cell.chain.damping > 0
    assert cells['friction_known_spinner'].analysed_chain.damping > 0
    assert cells['friction_spinner'].analysed_chain.damping == 0


def test_unknown_cells_are_rejected():
    with pytest.raises(ValueError, match='--cells nothing: unknown name'):
        _ = CellStudy(1, 3, 10, ('nothing',)).rows
    assert CellStudy(1, 3, 10, ('outliers',)).rows == 6


@pytest.mark.parametrize('name', ['wrong_reading_spinner', 'one_seen_flipper'])
def test_hard_cells_are_measured(name):
    study = CellStudy(1, 0, 30, (name,))
    line = dict(zip(study.columns, study.cells(0), strict=True))
    assert line['failure'] == ''
    assert np.isfinite(float(line['false']))
    if name.startswith('wrong'):
        assert float(line['frames']) == 2
        assert float(line['shift_max']) >= 0
