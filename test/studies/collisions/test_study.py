# SPDX-License-Identifier: Apache-2.0
"""Settings, collisions and rows of the table are converted without loss."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import pytest
import yaml
from meeting_walls import NARROW, ring_of
from study_files import written

from soliton_linkage_studies.collisions.runs import Collision, CollisionRun
from soliton_linkage_studies.collisions.study import (
    CollisionStudy,
    Entry,
    WindowEdge,
    read_collision_study,
    read_row,
)
from soliton_linkage_studies.settings import load_settings

CONFIG = Path(__file__).parents[3] / 'config/studies/collisions.yaml'
RUN = CollisionRun(True, 1, 0.3, 0.2, 0.1, float('nan'), 0.0, -1, False, 0.01, 1e-12)


@dataclass(frozen=True)
class Known(Collision):
    """Fake collision: walls separate after one collision above 0.26 c, else they are captured."""

    def __call__(self) -> CollisionRun:
        return replace(RUN, escaped=self.speed >= 0.26, speed_before=self.speed)


def edge(inside: float, outside: float) -> WindowEdge:
    return WindowEdge(Known(ring_of(NARROW), 0.0), 1, inside, outside, 12)


def test_an_edge_is_found_from_either_side():
    found, run = edge(0.7, 0.02)()
    assert found == pytest.approx(0.26, abs=2e-4)
    assert run.escaped
    assert run.speed_before - 0.26 == pytest.approx(0, abs=3e-4)


def test_an_edge_outside_its_speeds_is_reported():
    for inside, outside, said in [
        (0.1, 0.02, 'at 0.1 c walls do not escape'),
        (0.7, 0.5, 'at 0.5 c walls do escape'),
    ]:
        with pytest.raises(ValueError, match=said):
            edge(inside, outside)()


def test_a_row_round_trips_through_text():
    ring = ring_of(NARROW)
    entries = (
        Entry('sweeps', 'a', Known(ring, 0.3)),
        Entry('critical_speeds', 'b', edge(0.1, 0.02), '0.3'),
    )
    study = CollisionStudy(entries, {}, {})
    made, failed = (
        read_row(dict(zip(study.columns, study.cells(row), strict=True)))
        for row in range(study.rows)
    )
    assert (made.part, made.series, made.speed) == ('sweeps', 'a', 0.3)
    assert made.run is not None
    assert str(asdict(made.run)) == str(asdict(RUN))
    assert failed.run is None
    assert 'do not escape' in failed.failure


def test_the_settings_of_the_suite_are_read_and_quick_ones_are_fewer():
    study, quick = (read_collision_study(load_settings(CONFIG), each) for each in (False, True))
    assert 10 * quick.rows < study.rows
    assert {entry.series for entry in quick.entries} == {entry.series for entry in study.entries}
    assert quick.pictures == study.pictures
    changed = {entry.series: entry.task for entry in study.entries if entry.part == 'variations'}
    assert len(changed) == 4
    assert study.described() != quick.described()


def test_errors_name_the_wrong_setting(tmp_path):
    for keys, value in [
        (('collision', 'length'), 3),
        (('collision', 'step'), 'small'),
        (('sweeps', 'flipper (0.5, 0.1)', 'speeds', 'points'), 1),
        (('sweeps', 'flipper (0.5, 0.1)', 'turning'), 'sideways'),
        (('variations', 'changes', 'as in (a)', 'integrator'), 'guess'),
        (('critical_speeds', 'surprise'), 1),
        (('pictures', 'capture', 'speed'), 'fast'),
        (('sweeps',), {}),
        (('variations', 'changes'), {}),
    ]:
        settings = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
        section = settings
        for key in keys[:-1]:
            section = section[key]
        section[keys[-1]] = value
        with pytest.raises(ValueError, match=keys[-1]):
            read_collision_study(load_settings(written(settings, tmp_path)), False)
