# SPDX-License-Identifier: Apache-2.0
"""The command draws the page and the table, and all findings hold."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from study_files import results, written

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage_studies.driving import program as driving
from soliton_linkage_studies.driving.program import Finding, finding_table
from soliton_linkage_studies.driving.runs import StiffnessTask, TiltTask, read_driving_study
from soliton_linkage_studies.settings import load_settings

CONFIG = Path(__file__).parents[3] / 'config/studies/driving.yaml'
PANELS = 'abcdef'


def small_settings() -> dict[str, dict[str, object]]:
    """Return the installed settings with fewer and shorter chains for moves and tilts."""
    settings = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    moves = settings['moves'] | {'held': 0.2, 'frame_rate': 100.0}
    moves['chains'] = {'flipper': moves['chains']['flipper']}
    settings['tilt']['kept'] = 2.0
    for chain in [settings['tilt']['chain'], *moves['chains'].values()]:
        chain['number_of_rotors'] = 8
    return {**settings, 'moves': moves}


def test_every_panel_has_data_and_all_findings_hold(tmp_path, capsys):
    points = results(driving.main, 'driving', small_settings(), tmp_path, '--quick')
    series: dict[str, set[str]] = {panel: set() for panel in PANELS}
    for point in points:
        assert math.isfinite(float(point['y'])), point
        series[point['panel']].add(point['series'])
    assert {panel: len(found) for panel, found in series.items()} == dict(
        zip(PANELS, (3, 2, 1, 3, 4, 4), strict=True)
    )
    table = (tmp_path / 'new/out/table.md').read_text(encoding='utf-8')
    found = [line for line in table.splitlines() if line[:5] in {f'| {name} |' for name in PANELS}]
    assert {line[2] for line in found} == set(PANELS)
    assert all(line.endswith('| yes |') for line in found), table
    assert table.count('| 1 of 1 |') == 2
    assert table in capsys.readouterr().out


def test_the_table_marks_findings_that_do_not_hold():
    found = [Finding('a', 'x', 0, 1, measured) for measured in (0.5, 2, 0, -1, math.nan)]
    said = [line.split('|')[-2].strip() for line in finding_table(found).splitlines()[2:]]
    assert said == ['yes', 'no', 'yes', 'no', 'no']


def test_the_settings_of_the_suite_are_read_and_quick_ones_are_fewer():
    study, quick = (read_driving_study(load_settings(CONFIG), each) for each in (False, True))
    assert len(quick.stiffnesses) < len(study.stiffnesses)
    assert quick.balances['rigid'].duration < study.balances['rigid'].duration
    assert all(len(quick.moves[key]) < len(tasks) for key, tasks in study.moves.items())
    actuator = PneumaticActuator()
    asked = actuator.torque_per_pressure * study.step.values.max()
    assert study.works['saturated'].args[1].saturation_torque < asked
    assert study.works['below saturation'].args[1].saturation_torque > asked


def test_the_energy_balance_contains_all_kinds_of_inputs():
    task = read_driving_study(load_settings(CONFIG), quick=True).balances['rigid']
    run = task()
    assert len(run.times) == len(run.imbalances) == len(run.pushed) == 100
    assert len(run.kicks) >= 3
    assert len(run.turns) >= 3
    assert run.pushed.any()
    assert not run.pushed.all()
    assert task.chain.damping > 0
    assert not np.array_equal(task.chain.masses, np.full(12, task.chain.mass))


def test_a_wall_that_does_not_cross_in_time_raises_an_error():
    task = StiffnessTask.read(load_settings(CONFIG).section('stiffness'), quick=True)[0]
    with pytest.raises(ValueError, match='too short for the wall to cross'):
        dataclasses.replace(task, duration=0.02)()


def test_a_wall_without_gravity_does_not_fall():
    task = TiltTask.read(load_settings(CONFIG).section('tilt'), 'rigid')
    still = dataclasses.replace(task, gravity=0.0, kept=0.1)()
    np.testing.assert_allclose(still.positions, still.positions[0], atol=1e-6)
    assert list(dict.fromkeys(still.tilts.tolist())) == [-0.25, 0.25]


def test_errors_name_the_wrong_setting(tmp_path, capsys):
    for section, key, value in [
        ('step', 'pressure', -1.0),
        ('energy_balance', 'seed', 0.5),
        ('stiffness', 'factors', [1.0, 2.0]),
        ('tilt', 'surprise', 1),
        ('work', 'saturation_torque', 'none'),
        ('moves', 'chains', 3),
    ]:
        settings = small_settings()
        settings[section][key] = value
        assert driving.main([str(written(settings, tmp_path)), '--output', str(tmp_path)]) == 1
        assert f'{section}.{key}' in capsys.readouterr().err
