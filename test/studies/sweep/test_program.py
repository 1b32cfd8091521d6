# SPDX-License-Identifier: Apache-2.0
"""The sweep table does not depend on processes, interruptions or clusters."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.image import imread

from soliton_linkage_studies.sweep.program import main

LONGEST_WAIT = 300.0
PROGRAM = 'from soliton_linkage_studies.sweep.program import main; raise SystemExit(main())'
SMALL = """
measure: motion
chain: {number_of_rotors: 12}
deviations: {rotor_length: 0.03, spacing: 0.03}
seeds: 3
sweep:
  rotor_length_ratio: {from: 0.2, to: 5.0, points: 8, scale: log}
  rest_angle: {from: 0.1, to: 1.5, points: 7}
"""
LONG = SMALL.replace('points: 8', 'points: 30').replace('points: 7', 'points: 15')


@pytest.fixture
def config(tmp_path):
    return written(tmp_path / 'small.yaml', SMALL)


@pytest.fixture(scope='module')
def swept(tmp_path_factory):
    """Run the small study with one process; return its folder."""
    folder = tmp_path_factory.mktemp('swept')
    config = written(folder / 'small.yaml', SMALL)
    assert main([str(config), '--output', str(folder / 'out'), '--workers', '1']) == 0
    return folder / 'out'


def written(path: Path, content: str) -> Path:
    path.write_text(content, encoding='utf-8')
    return path


def started(*arguments: object) -> subprocess.Popen[str]:
    """Start the command in a separate process group."""
    return subprocess.Popen(
        [sys.executable, '-c', PROGRAM, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + LONGEST_WAIT
    while not condition():
        assert time.monotonic() < deadline, f'waited {LONGEST_WAIT:g} s for {what}'
        time.sleep(0.02)


def lines_in(path: Path) -> int:
    return path.read_bytes().count(b'\n') if path.exists() else 0


def is_empty(group: int) -> bool:
    """Return whether all processes of a group have ended; zombies count as ended."""
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            state, _, of_group = path.read_text().rsplit(')', 1)[1].split()[:3]
        except OSError:
            continue
        if int(of_group) == group and state != 'Z':
            return False
    return True


def test_the_table_does_not_depend_on_the_number_of_processes(config, swept, tmp_path, capsys):
    assert main([str(config), '--output', str(tmp_path), '--workers', '2']) == 0
    table = (tmp_path / 'small.csv').read_bytes()
    assert table == (swept / 'small.csv').read_bytes()
    assert table.count(b'\n') == 1 + 8 * 7 * 3
    assert imread(tmp_path / 'small.png').shape[2] == 4
    assert (tmp_path / 'small.pdf').read_bytes().startswith(b'%PDF')
    written_out = capsys.readouterr()
    assert '168 rows in' in written_out.out
    assert '168 rows in' in written_out.err


def test_the_same_command_on_a_complete_table_redraws_it(config, swept, tmp_path, capsys):
    output = shutil.copytree(swept, tmp_path / 'out')
    (output / 'small.png').unlink()
    assert main([str(config), '--output', str(output), '--workers', '1']) == 0
    assert 'rows in' not in capsys.readouterr().err
    assert (output / 'small.csv').read_bytes() == (swept / 'small.csv').read_bytes()
    assert (output / 'small.png').exists()


def test_an_interrupted_sweep_continues_to_the_same_table(tmp_path, whole_table, capsys):
    config = written(tmp_path / 'long.yaml', LONG)
    folder = tmp_path / 'out'
    part = folder / 'long.csv.part'
    measured = 0
    for sent in (signal.SIGINT, signal.SIGKILL):
        process = started(config, '--output', folder, '--workers', 1)
        wait_until(lambda before=measured: lines_in(part) > before + 20, 'some rows')
        if sent == signal.SIGINT:
            os.killpg(process.pid, sent)
        else:
            process.send_signal(sent)
        _, errors = process.communicate(timeout=LONGEST_WAIT)
        wait_until(lambda group=process.pid: is_empty(group), 'the end of the workers')
        assert not (folder / 'long.csv').exists()
        measured = lines_in(part)
        if sent == signal.SIGINT:
            assert process.returncode == 130
            assert errors.endswith('sweep: stopped; the same command continues the measurement\n')
            assert 'Traceback' not in errors
    assert process.returncode == -signal.SIGKILL
    with part.open('ab') as file:
        file.write(b'17,0.2,0.')
    assert main([str(config), '--output', str(folder), '--workers', '1']) == 0
    assert f'{1350 - measured} rows in' in capsys.readouterr().err
    assert (folder / 'long.csv').read_bytes() == whole_table
    assert not part.exists()


@pytest.fixture(scope='module')
def whole_table(tmp_path_factory):
    folder = tmp_path_factory.mktemp('whole')
    config = written(folder / 'long.yaml', LONG)
    assert main([str(config), '--output', str(folder / 'out'), '--workers', '1']) == 0
    return (folder / 'out/long.csv').read_bytes()


def test_a_cluster_gives_the_same_table(config, swept, tmp_path):
    distributed = pytest.importorskip('distributed', reason='needs Dask: pip install distributed')
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=':0'
    )
    with cluster:
        address = cluster.scheduler_address
        assert main([str(config), '--output', str(tmp_path), '--scheduler', address]) == 0
    assert (tmp_path / 'small.csv').read_bytes() == (swept / 'small.csv').read_bytes()


def test_a_quick_sweep_has_a_separate_table_and_failed_rows_are_counted(
    tmp_path, monkeypatch, capsys
):
    content = 'measure: motion\nseeds: 3\nsweep: {deviations.mass: [0.0, 1.0]}'
    config = written(tmp_path / 'mine.yaml', content)
    monkeypatch.chdir(tmp_path)
    assert main([str(config), '--quick', '--workers', '1']) == 0
    assert lines_in(tmp_path / 'out/sweeps/mine-quick/mine-quick.csv') == 1 + 2 * 2
    assert '; 2 rows have a failure' in capsys.readouterr().out


def test_an_error_is_one_line(swept, tmp_path, capsys):
    wrong = written(tmp_path / 'wrong.yaml', SMALL.replace('motion', 'colour'))
    assert main([str(wrong)]) == 1
    assert capsys.readouterr().err.startswith(f"sweep: {wrong}: measure = 'colour' must be one of")
    other = written(tmp_path / 'small.yaml', SMALL.replace('seeds: 3', 'seeds: 4'))
    assert main([str(other), '--output', str(swept), '--workers', '1']) == 1
    error = capsys.readouterr().err
    assert 'contains rows of another configuration, which differs in seeds' in error
    assert error.count('\n') == 1
