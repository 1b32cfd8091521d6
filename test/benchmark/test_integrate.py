# SPDX-License-Identifier: Apache-2.0
"""The comparison of integrators runs, and every figure that it prints is measured."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest


@pytest.fixture(scope='module')
def output(run_part: Callable[..., Path]) -> Path:
    for needed in ('heyoka', 'mujoco', 'numba'):
        pytest.importorskip(needed, reason=f'needs {needed}: run make benchmark once')
    return run_part('integrate', '--rotors', '20', '30')


@pytest.fixture(scope='module')
def part(output: Path) -> dict[str, Any]:
    return dict(json.loads(output.read_text())['integrate'])


def test_errors_fall_and_times_are_measured_for_every_method(part: dict[str, Any]) -> None:
    curves = part['details']['curves']
    assert set(curves) == {'flipper of 20', 'flipper of 30'}
    for curve in curves['flipper of 20'].values():
        errors = [setting['error'] for setting in curve]
        assert errors[-1] <= errors[0] < 1
        assert all(seconds > 0 for setting in curve for seconds in setting['seconds'])


def test_times_compared_are_those_of_settings_around_the_error(part: dict[str, Any]) -> None:
    compared = 0
    for each in part['comparisons']:
        work, _, at = each['work'].partition(', ')
        if at == 'set-up':
            continue
        target = float(at.split()[1])
        for name, times in ((each['peer'], each['theirs']), ('ours', each['ours'])):
            curve = part['details']['curves'][work][name]
            finer = [s for s in curve if s['error'] <= target]
            coarser = [s for s in curve if s['error'] >= target]
            assert bool(times) == bool(finer)
            if not coarser or not finer:
                continue
            compared += 1
            around = np.array([coarser[-1]['seconds'], finer[0]['seconds']])
            assert len(times) == around.shape[1] == 2
            assert (times >= around.min(axis=0) * (1 - 1e-9)).all()
            assert (times <= around.max(axis=0) * (1 + 1e-9)).all()
    assert compared > 6


def test_the_table_has_the_ratios_of_the_times(part: dict[str, Any]) -> None:
    for each in part['comparisons']:
        row = next(
            line
            for line in part['table'].splitlines()
            if line.startswith(f'| {each["peer"]} | {each["work"]} |')
        )
        if each['theirs'] and each['ours']:
            ratios = np.divide(each['theirs'], each['ours'])
            assert f'| {np.median(ratios):.3g} (' in row
        else:
            assert 'not reached' in row


def test_the_account_lists_its_loops_and_compilation_is_slower_than_loading(
    part: dict[str, Any],
) -> None:
    for loops in part['details']['account'].values():
        assert loops.keys() == {'integrating', 'springs', 'turn'}
        assert all(min(times) > 0 for times in loops.values())
    figures = {figure['what']: figure['values'] for figure in part['figures']}
    compiling, loading = (v for what, v in figures.items() if what.startswith('numba'))
    assert compiling[0] > loading[0] > 0
    assert len(figures['time per rotor, 30 / 20 rotors']) == 2


def test_the_picture_is_drawn(output: Path) -> None:
    assert output.with_name('benchmark_integrate.png').stat().st_size > 10_000
