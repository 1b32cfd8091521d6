# SPDX-License-Identifier: Apache-2.0
"""Windows and tables agree with the rows."""

import math
from dataclasses import replace

from soliton_linkage_studies.collisions.runs import CollisionRun
from soliton_linkage_studies.collisions.study import Row, escaped_after, finding_tables, windows

RUN = CollisionRun(True, 1, 0.3, 0.2, 0.1, math.nan, 0.0, 0, False, 0.01, 1e-12)


def row(speed: float, collisions: int | None, part: str = 'sweeps', series: str = 'a') -> Row:
    run = replace(RUN, escaped=False, kink_speed=0.0, anti_kink_speed=0.0)
    if collisions is not None:
        run = replace(RUN, collisions=collisions, kink_speed=speed / 2, between=10 * speed)
    return Row(part, series, '', speed, run, '')


def test_windows_are_neighbours_of_the_same_outcome():
    outcomes = [None, 2, 2, 2, None, 3, 3, 2, 2, None, 2, None, 1, 1]
    rows = [row(0.1 + number / 100, outcome) for number, outcome in enumerate(outcomes)]
    found = [(each.collisions, each.first, each.last) for each in windows(rows)]
    assert [(count, round(a, 2), round(b, 2)) for count, a, b in found] == [
        (2, 0.11, 0.13),
        (3, 0.15, 0.16),
        (2, 0.17, 0.18),
    ]
    first = windows(rows)[0]
    assert first.fastest.kink_speed == max(0.11, 0.12, 0.13) / 2
    assert first.phase == math.sqrt(3) * first.fastest.between / (2 * math.pi)


def test_a_broken_anti_kink_has_not_escaped():
    assert escaped_after(row(0.2, 2)) == 2
    assert escaped_after(row(0.2, None)) is None
    broken = row(0.2, 1)
    assert broken.run is not None
    assert escaped_after(replace(broken, run=replace(broken.run, broken=True))) is None


def test_tables_count_changes_and_find_the_limit():
    rows = [row(speed, outcome) for speed, outcome in ((0.1, None), (0.2, 1), (0.3, 1))]
    rows += [row(speed, 1, 'variations', 'base') for speed in (0.1, 0.2)]
    rows += [row(0.1, None, 'variations', 'other'), row(0.2, 1, 'variations', 'other')]
    rows += [
        replace(row(0.2598 - lean**2, 1, 'critical_speeds', 'r'), name=str(lean))
        for lean in (0.05, 0.1)
    ]
    table = finding_tables(rows)
    assert '| a | 3 of 3 | 1 | 0 | 0.010 |' in table
    assert '| base | 2 of 2 | 0.0e+00 |' in table
    assert '| other | 1 of 2 | 0.0e+00 |' in table
    assert '| r | to 0, with d² | 0.2598 (phi⁴: 0.2598) |' in table
