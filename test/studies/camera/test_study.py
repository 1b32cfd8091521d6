# SPDX-License-Identifier: Apache-2.0
"""Clips count hidden, swapped and lost angles; the table has the sums of its clips."""

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest

from soliton_linkage_studies.camera.program import FilmStudy, read_film_study, table_of
from soliton_linkage_studies.camera.renderer import FilmSettings
from soliton_linkage_studies.camera.runs import FIGURES, FilmedRun
from soliton_linkage_studies.program import installed_settings
from soliton_linkage_studies.settings import load_settings
from soliton_linkage_studies.sweep.table import Table, read_rows

NOISE, STATED, BIAS = 1e-3, 5e-4, 2e-4
ROTORS, FRAMES = 20, 510


@dataclass(frozen=True)
class Pretended:
    """Film with prescribed errors, which replaces a rendered film."""

    kick: float = 1.0
    settings: FilmSettings = field(default_factory=FilmSettings)

    def __call__(self) -> FilmedRun:
        random = np.random.default_rng(self.settings.seed)
        errors = BIAS + NOISE * random.standard_normal((FRAMES, ROTORS))
        errors[100, :7] = np.nan
        errors[200, 2] += 0.5
        errors[300:, 4] += 2 * np.pi
        return FilmedRun(errors, np.full_like(errors, STATED), 4e-4, 0.01)


def test_hidden_swapped_and_lost_angles_are_counted():
    figures = dict(zip(FIGURES, Pretended()().figures, strict=True))
    assert (figures['hidden'], figures['swapped'], figures['turns_lost']) == (7, 1, 1)
    assert figures['angles'] == (figures['pictures'] - 10) * ROTORS
    assert figures['noise'] == pytest.approx(NOISE, rel=0.03)
    assert figures['normalised'] == pytest.approx(NOISE / STATED, rel=0.03)
    assert figures['bias'] == pytest.approx(BIAS, abs=5 * NOISE / np.sqrt(figures['angles']))


def test_a_table_resumes_after_an_interruption_and_has_the_sums_of_its_clips(tmp_path):
    study = FilmStudy(cast(Any, {'one': Pretended(), 'other': Pretended()}), clips=3)
    for rows in ([0, 3], [1, 2, 4, 5]):
        with Table(study, tmp_path) as table:
            assert set(rows) <= set(table.missing)
            table.append([study.cells(row) for row in rows])
    with Table(study, tmp_path) as table:
        assert not table.missing
        table.finish()
    _, _, one, other = table_of(read_rows(tmp_path / 'films.csv')).splitlines()
    for line, name in ((one, 'one'), (other, 'other')):
        cells = [cell.strip() for cell in line.split('|')[1:-1]]
        assert cells[:2] == [name, str(3 * FRAMES)]
        assert cells[3:5] == ['3', '3']
        assert float(cells[8]) == pytest.approx(NOISE / STATED, rel=0.03)


def test_the_installed_settings_make_clips_of_each_film_and_chain():
    path = installed_settings('camera')
    assert path is not None
    study = read_film_study(load_settings(path), quick=False)
    assert study.rows == 9 * 20
    assert sum(task.frames for task in study.films.values()) * study.clips == 9 * 10_000
    assert read_film_study(load_settings(path), quick=True).rows == 9
