# SPDX-License-Identifier: Apache-2.0
"""Rows are read from pages as sqlite3 itself reads them."""

from __future__ import annotations

import sqlite3
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soliton_linkage_nodes.bags.storages.sqlite_pages import SqlitePages

VALUES = st.one_of(
    st.none(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(alphabet=st.characters(exclude_categories=['Cs'], exclude_characters='\x00')),
    st.binary(max_size=60),
    st.integers(0, 30_000).map(bytes),
)
ROWS = st.lists(st.tuples(st.integers(-(2**62), 2**62), VALUES, VALUES), max_size=30)


@settings(max_examples=30)
@given(ROWS, st.sampled_from([512, 1024, 4096, 65536]))
def test_every_row_is_read_as_sqlite3_reads_it(
    rows: list[tuple[int, object, object]], page: int
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'x.db3')
        database = sqlite3.connect(path)
        database.execute(f'PRAGMA page_size = {page}')
        database.execute('CREATE TABLE x(id INTEGER PRIMARY KEY, a, b)')
        database.executemany('INSERT OR REPLACE INTO x VALUES (?, ?, ?)', rows)
        database.commit()
        expected = database.execute('SELECT id, a, b FROM x ORDER BY id').fetchall()
        database.close()
        pages = SqlitePages(path.read_bytes())
        read = {number: values for number, values in pages.rows() if len(values) == 3}
    assert pages.damaged == 0
    assert [(number, *read[number][1:]) for number in sorted(read)] == expected


@pytest.mark.parametrize('data', [b'', b'SQLite format 3\x00', bytes(10_000)])
def test_what_is_no_table_has_no_rows(data: bytes) -> None:
    assert list(SqlitePages(data).rows()) == []
