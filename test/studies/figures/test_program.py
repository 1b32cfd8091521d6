# SPDX-License-Identifier: Apache-2.0
"""Every figure is drawn with its data, and its measurements agree with the theory."""

import importlib
import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from picture_laws import unexplained

from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.figures import program as figures
from soliton_linkage_studies.settings import Section, load_settings

CONFIG = Path(__file__).parents[3] / 'config/studies/figures.yaml'


def small_settings() -> Section:
    """Return the installed settings with less disorder, because lost walls take long to detect."""
    settings = load_settings(CONFIG)
    disorder: Any = settings.values['disorder_against_passage']
    disorder['fractions'] = [0.01, 0.03, 0.05]
    for each in disorder['chains'].values():
        each['chain']['number_of_rotors'] = 8
    return settings


SETTINGS = small_settings()

# Largest relative errors of quick figures. Their sources are rounding, finite differences on 1000
# steps (1 %), the speed of sound of 100 rotors (1e-3), the transient of a kick, measurement noise,
# or a theory for slow walls or small d. The order in 1/k_e is measured with soft springs.
LIMITS = {
    'figure_1': 1e-3,
    'figure_2': 0.05,
    'figure_3': 0.02,
    'figure_4': 0.06,
    'figure_5': 0.03,
    'figure_6': 0.08,
    'figure_s2': 0.005,
    'energy_against_speed': 0.05,
    'disorder_against_passage': 1e-9,
    'elastic_against_rigid': 0.15,
    'anti_kink_cost': 0.3,
    'soft_actuator': 0.1,
}


@pytest.mark.parametrize('name', list(FIGURES))
def test_a_figure_is_labelled_and_its_measurements_agree_with_theory(name):
    report = FIGURES[name](SETTINGS.section(name), True)
    report.figure.savefig(io.BytesIO(), dpi=30)
    assert len(report.rows) > 2
    assert unexplained(report.figure, report.caption) == []
    known = [line for line in report.comparisons if np.isfinite(line.expected)]
    assert bool(known) == (name in LIMITS)
    for line in known:
        assert line.measured == pytest.approx(line.expected, rel=LIMITS[name], abs=1e-9), line


def test_the_settings_file_has_exactly_the_registered_figures():
    assert set(SETTINGS.values) == set(FIGURES)


def test_the_command_draws_the_selected_figures_and_the_table(tmp_path, capsys):
    output = tmp_path / 'new/folder'
    arguments = [str(CONFIG), '--output', str(output), '--quick', '--workers', '1', '--only']
    assert figures.main([*arguments, 'soft_actuator', 'anti_kink_cost']) == 0
    table = (output / 'table.md').read_text(encoding='utf-8').splitlines()
    names = [line.split('|')[1].strip() for line in table[2:]]
    assert list(dict.fromkeys(names)) == ['anti_kink_cost', 'soft_actuator']
    for suffix in ('png', 'pdf', 'csv', 'txt'):
        assert (output / f'anti_kink_cost.{suffix}').exists()
    assert 'are in' in capsys.readouterr().out
    assert figures.main([*arguments, 'anti_kink']) == 1
    assert '--only anti_kink: unknown name' in capsys.readouterr().err
    assert (output / 'table.md').read_text(encoding='utf-8').splitlines() == table


def test_errors_name_invalid_settings(tmp_path):
    bad = tmp_path / 'bad.yaml'
    bad.write_text(CONFIG.read_text(encoding='utf-8').replace('kick: 0.1', 'kick: fast', 1))
    with pytest.raises(ValueError, match=r"figure_2\.kick = 'fast' must be a number"):
        FIGURES['figure_2'](load_settings(bad).section('figure_2'), True)


OWN_FIGURE = """
from matplotlib.figure import Figure

from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.figure_report import FigureReport, Formula


@FIGURES.add('own_parabola')
def parabola(section, quick):
    section.check_keys('points')
    report = FigureReport(Figure(), 'A parabola.')
    points = range(section.whole_number('points', 2, 100))
    heights = [each**2 for each in points]
    report.figure.subplots().plot(points, heights)
    report.add_points('', 'parabola', ('x', 'y'), points, heights)
    square = Formula('x²', points[-1] ** 2, {'x': points[-1]})
    report.add_comparison('height', '', square, heights[-1])
    return report
"""


def test_an_external_figure_is_drawn_with_the_others(tmp_path, monkeypatch):
    (tmp_path / 'own_figure.py').write_text(OWN_FIGURE, encoding='utf-8')
    config = tmp_path / 'figures.yaml'
    config.write_text('own_parabola: {points: 5}\n', encoding='utf-8')
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module('own_figure')
    try:
        assert figures.main([str(config), '--output', str(tmp_path), '--workers', '1']) == 0
    finally:
        del FIGURES['own_parabola'], sys.modules['own_figure']
    assert (tmp_path / 'own_parabola.png').exists()
    data = (tmp_path / 'own_parabola.csv').read_text(encoding='utf-8').splitlines()
    assert data[-1] == ',parabola,4.0,16.0,x,y'
    row = '| own_parabola | height |  | x² = 16 for x = 4 | 16 | 0 % |'
    assert row in (tmp_path / 'table.md').read_text(encoding='utf-8')


def test_an_unknown_figure_is_rejected(tmp_path, capsys):
    config = tmp_path / 'figures.yaml'
    config.write_text('figure_7: {}\n', encoding='utf-8')
    assert figures.main([str(config), '--output', str(tmp_path)]) == 1
    assert 'figure_7 = {} is not known; known keys are' in capsys.readouterr().err
