# SPDX-License-Identifier: Apache-2.0
"""Every figure is drawn with its data, and what it measures is what the theory says."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from soliton_linkage.studies.figures import program as figures
from soliton_linkage.studies.figures.survey import wilson_interval
from soliton_linkage.studies.settings import load_settings

CONFIG = Path(__file__).parents[4] / 'config/studies/figures.yaml'

# What a quick figure may be off by, from what limits it: rounding, the differences of a curve
# in 1000 steps (1 %), the sound of 100 rotors (1e-3), the transient of a kick or a theory that
# holds for slow walls or small d, or noise of a record. The order in 1/k_e is that of springs
# which are not stiff yet.
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


def gone(group: int) -> bool:
    """Whether a process group has ended within ten seconds; its last process tidies up."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize('name', list(figures.FIGURES))
def test_a_figure_is_written_and_its_measurements_hold(name: str, tmp_path: Path) -> None:
    lines = figures.draw(name, CONFIG, tmp_path, quick=True)
    assert {path.name for path in tmp_path.iterdir()} == {
        f'{name}.{suffix}' for suffix in ('png', 'pdf', 'csv')
    }
    data = (tmp_path / f'{name}.csv').read_text(encoding='utf-8').splitlines()
    assert len(data) > 3
    known = [line for line in lines if np.isfinite(line.expected)]
    assert bool(known) == (name in LIMITS)
    for line in known:
        assert line.measured == pytest.approx(line.expected, rel=LIMITS[name], abs=1e-9), line


def test_the_file_of_settings_names_every_figure_and_no_other() -> None:
    assert set(load_settings(CONFIG).values) == set(figures.FIGURES)


def test_the_command_draws_what_is_asked_for_and_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / 'new/folder'
    arguments = [str(CONFIG), '--output', str(output), '--quick', '--workers', '2', '--only']
    assert figures.main([*arguments, 'figure_1', 'figure_4']) == 0
    table = (output / 'table.md').read_text(encoding='utf-8').splitlines()
    names = [line.split('|')[1].strip() for line in table[2:]]
    assert names == sorted(names)
    assert set(names) == {'figure_1', 'figure_4'}
    assert (output / 'figure_4.pdf').exists()
    assert 'are in' in capsys.readouterr().out
    assert figures.main([*arguments, 'figure_1']) == 0
    assert (output / 'table.md').read_text(encoding='utf-8').splitlines() == table


@pytest.mark.parametrize('workers', ['0', '-1', '1.5', '1001', 'two'])
def test_a_number_of_processes_that_cannot_be_is_refused(
    workers: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        figures.main([str(CONFIG), '--workers', workers])
    assert f'{workers!r} must be a whole number from 1 to 1000' in capsys.readouterr().err


@pytest.mark.parametrize(('passed', 'count'), [(0, 10), (3, 10), (10, 10), (1, 1), (500, 1000)])
def test_the_ends_of_an_interval_are_as_unlikely_as_they_should_be(
    passed: int, count: int
) -> None:
    share = passed / count
    low, high = wilson_interval(passed, count)
    assert 0 <= low <= share <= high <= 1
    for end in (low, high):
        variance = end * (1 - end) / count
        assert (share - end) ** 2 == pytest.approx(1.959964**2 * variance, rel=1e-5, abs=1e-15)


def test_settings_that_cannot_be_drawn_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / 'bad.yaml'
    bad.write_text(CONFIG.read_text(encoding='utf-8').replace('kick: 0.1', 'kick: fast', 1))
    code = figures.main([str(bad), '--output', str(tmp_path), '--only', 'figure_2'])
    assert code == 1
    assert "figure_2.kick = 'fast' must be a number" in capsys.readouterr().err


def test_ctrl_c_ends_it_at_once_and_leaves_no_process(tmp_path: Path) -> None:
    command = [sys.executable, '-m', 'soliton_linkage.studies.figures.program', str(CONFIG)]
    process = subprocess.Popen(
        [*command, '--output', str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not any(tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=10)
    assert process.returncode == 130
    assert 'stopped; the figures that were finished stay' in said
    assert 'Traceback' not in said
    assert gone(process.pid)
