# SPDX-License-Identifier: Apache-2.0
"""The comparison of integrators runs, and every figure that it prints is measured."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PROGRAM = Path(__file__).parents[2] / 'benchmark' / 'integrate.py'


@pytest.fixture(scope='module')
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for needed in ('heyoka', 'mujoco', 'numba'):
        pytest.importorskip(needed)
    path = tmp_path_factory.mktemp('benchmark') / 'benchmark.json'
    options = ['--quick', '--rotors', '20', '--no-spinner', '--rounds', '2', '--output', str(path)]
    command = [sys.executable, str(PROGRAM), *options]
    subprocess.run(command, check=True, capture_output=True, env=os.environ, timeout=300)
    return path


def test_errors_fall_and_times_are_measured_for_every_method(output: Path) -> None:
    curves = json.loads(output.read_text())['integrate']['flipper 20']['curves']
    assert set(curves) == {
        'ours', 'heyoka', 'MuJoCo RK4', 'MuJoCo implicitfast', 'scipy DOP853',
    }  # fmt: skip
    for curve in curves.values():
        errors, times = np.array(curve)[:, 1], np.array(curve)[:, 2]
        assert errors[-1] <= errors[0] < 1
        assert (times > 0).all()


def test_ratios_are_those_of_the_times(output: Path) -> None:
    seconds = json.loads(output.read_text())['integrate']['flipper 20']['seconds']
    rows = output.with_name('benchmark_integrate.md').read_text().splitlines()
    for name, by_target in seconds.items():
        for target, times in by_target.items():
            mine = seconds['ours'][target]
            assert len(mine) == 2
            shown = [
                row for row in rows if row.startswith(f'| {name} | flipper 20, error {target}')
            ]
            if name == 'ours':
                assert not shown
            elif not times:
                assert 'not reached' in shown[0]
            else:
                ratio = np.median([t / m for t, m in zip(times, mine, strict=True)])
                assert f'| {ratio:.3g} (' in shown[0]


def test_the_picture_is_drawn(output: Path) -> None:
    assert output.with_name('benchmark_integrate.png').stat().st_size > 10_000
