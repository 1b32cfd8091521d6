# SPDX-License-Identifier: Apache-2.0
"""A cell is worse where chance cannot make it so."""

from __future__ import annotations

import pytest

from soliton_linkage_studies.accuracy.cells.comparison import check_comparable, worse_cells
from soliton_linkage_studies.accuracy.cells.statistics import COLUMNS
from soliton_linkage_studies.accuracy.cells.study import GIVEN, CellStudy, given_of

NOT_STATED = {'place_rms': '', 'lost': 1000, 'place_beyond_4': ''}


def row(**others: object) -> dict[str, str]:
    plain = dict.fromkeys((*GIVEN, *COLUMNS, 'failure'), '')
    known = {'cell': '3', 'class': 'flipper', 'frames': 1000, 'lost': 0, 'false': 0}
    known |= {
        'wrong_leg': 0,
        'walls_looked_for': 1000,
        'place_rms': 1.0,
        'place_rms_error': 0.05,
        'error_rms': 0.01,
    }
    return plain | {name: str(value) for name, value in (known | others).items()}


@pytest.mark.parametrize(
    ('now', 'was', 'what'),
    [
        ({'place_rms': 1.6}, {}, 'place rms 1.6 after 1'),
        ({'place_rms': 0.4}, {}, 'place rms 0.4 after 1'),
        ({'error_rms': 0.02}, {}, 'error 0.02 after 0.01 spacings'),
        ({'lost': 30}, {}, 'lost in 3 % after 0 %'),
        ({'place_beyond_4': 5}, {'place_beyond_4': 0}, 'lost in 5 % after 0 %'),
        ({'failure': 'jams'}, {}, 'jams'),
        ({'place_rms': ''}, {}, 'states no place'),
    ],
)
def test_what_got_worse_is_said(now: dict[str, object], was: dict[str, object], what: str) -> None:
    said = worse_cells([row(**now)], [row(**was)])
    assert said == ['1 of 1 cells are worse', f'3 (flipper): {what}']


@pytest.mark.parametrize(
    ('now', 'was'),
    [
        ({}, {}),
        ({'place_rms': 1.15}, {}),
        ({'place_rms': 1.0}, {'place_rms': 3.0}),
        ({'lost': 1}, {}),
        ({'error_rms': 0.02}, {'lost': 200}),
        ({}, {'place_rms': ''}),
        (NOT_STATED, {'place_rms': 90, 'lost': 100, 'place_beyond_4': 100}),
        ({'error_rms': 3.0}, {'place_rms': 90}),
    ],
)
def test_what_chance_or_progress_makes_is_not(
    now: dict[str, object], was: dict[str, object]
) -> None:
    assert worse_cells([row(**now)], [row(**was)]) == ['0 of 1 cells are worse']


def test_other_cells_are_refused() -> None:
    study = CellStudy(1, 3, 10)
    cell = study.all[1]
    with pytest.raises(ValueError, match='is no table of cells; give a cells'):
        check_comparable(study, [{'cell': '1'}])
    same = row() | {'cell': cell.name} | dict(zip(GIVEN, given_of(cell), strict=True))
    check_comparable(study, [row(**same)])
    with pytest.raises(ValueError, match='no cell of seed 1 is in the earlier table; give the'):
        check_comparable(study, [row(**same | {'noise': 0.3})])
    assert worse_cells([row()], [row(noise=0.3)]) == ['0 of 0 cells are worse']
