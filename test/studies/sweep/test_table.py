# SPDX-License-Identifier: Apache-2.0
"""A sweep table contains each row once and in order, despite interruptions."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_studies.sweep.config import Axis, SweepStudy
from soliton_linkage_studies.sweep.table import Table, read_rows

ANGLES = (0.3, 0.5, 0.7, 0.97)
STUDY = SweepStudy(
    'mine', 'motion', {'number_of_rotors': 5}, (Axis('rest_angle', ANGLES),), (0, 1)
)
CELLS = [STUDY.cells(row) for row in range(STUDY.rows)]
CELLS[3][-1] = 'a reason, with "quotes" and a comma'


def written(folder: Path, order: list[int]) -> bytes:
    with Table(STUDY, folder) as table:
        for row in order:
            table.append([CELLS[row]])
        table.finish()
    return (folder / 'mine.csv').read_bytes()


@given(order=st.permutations(range(STUDY.rows)))
def test_rows_are_sorted_independent_of_their_arrival(order, tmp_path_factory):
    folder = tmp_path_factory.mktemp('table')
    whole = written(tmp_path_factory.mktemp('table'), list(range(STUDY.rows)))
    assert written(folder, order) == whole
    rows = read_rows(folder / 'mine.csv')
    assert [list(row.values()) for row in rows] == CELLS
    assert tuple(rows[0]) == STUDY.columns


def test_a_table_continues_after_truncation_at_any_byte(tmp_path):
    whole = written(tmp_path / 'whole', list(range(STUDY.rows)))
    folder = tmp_path / 'cut'
    with Table(STUDY, folder) as table:
        table.append(CELLS[:5])
    part = folder / 'mine.csv.part'
    content = part.read_bytes()
    for length in range(len(content) + 1):
        part.write_bytes(content[:length])
        with Table(STUDY, folder) as table:
            complete = content[:length].count(b'\n')
            assert table.missing == list(range(complete, STUDY.rows))
            table.append([CELLS[row] for row in table.missing])
        with Table(STUDY, folder) as table:
            assert table.missing == []
            table.finish()
        assert (folder / 'mine.csv').read_bytes() == whole
        (folder / 'mine.csv').unlink()


def test_a_finished_table_is_complete_and_leaves_no_part_file(tmp_path):
    whole = written(tmp_path, list(range(STUDY.rows)))
    with Table(STUDY, tmp_path) as table:
        assert table.missing == []
        table.finish()
    assert (tmp_path / 'mine.csv').read_bytes() == whole
    assert {path.name for path in tmp_path.iterdir()} == {'mine.csv', 'configuration.yaml'}


def test_rows_of_another_configuration_are_rejected(tmp_path):
    for changed, key in [
        (SweepStudy('mine', 'survival', STUDY.parameters, STUDY.axes, STUDY.seeds), 'measure'),
        (
            SweepStudy('mine', 'motion', {'number_of_rotors': 6}, STUDY.axes, STUDY.seeds),
            'parameters',
        ),
        (SweepStudy('mine', 'motion', STUDY.parameters, STUDY.axes, (0, 2)), 'seeds'),
        (
            SweepStudy(
                'mine', 'motion', STUDY.parameters, (Axis('rest_angle', ANGLES[:3]),), (0, 1)
            ),
            'sweep',
        ),
    ]:
        with Table(STUDY, tmp_path) as table:
            table.append(CELLS[:2])
        complaint = f'contains rows of another configuration, which differs in {key}; give another'
        with pytest.raises(ValueError, match=complaint):
            Table(changed, tmp_path)
        with Table(STUDY, tmp_path) as table:
            assert table.missing == list(range(2, STUDY.rows))


def test_two_sweeps_cannot_write_to_the_same_table(tmp_path):
    busy = pytest.raises(ValueError, match=r'another program is writing to .*; wait until')
    with Table(STUDY, tmp_path), busy:
        Table(STUDY, tmp_path)
    with Table(STUDY, tmp_path):
        pass
