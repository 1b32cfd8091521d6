# SPDX-License-Identifier: Apache-2.0
"""The demo as a person runs it: every scenario in processes, and Ctrl-C at any moment."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from matplotlib.image import imread

from soliton_linkage.actuation import Edge, edge_mode
from soliton_linkage.simulation import simulate
from soliton_linkage.track import find_crossings, follow
from soliton_linkage_nodes.bag_report import RecordedRun, read_run
from soliton_linkage_nodes.bags import open_bag

ROOT = Path(__file__).resolve().parents[2]
CONFIGURATION = ROOT / 'config'
NUDGES = {'flipper': 10.0, 'wobbler': 4.0, 'spinner': 12.5}
TIME_TO_STOP = 2.0
LONGEST_RUN = 120.0
MARK = 'SOLITON_EXPERIMENT'

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start an experiment in a process group of its own; none outlives the test."""
    running: list[subprocess.Popen[str]] = []

    def start_experiment(configuration: Path, output: Path) -> subprocess.Popen[str]:
        prefix = Path(get_package_prefix('soliton_linkage_nodes'), 'lib', 'soliton_linkage_nodes')
        running.append(
            subprocess.Popen(
                [str(prefix / 'experiment'), str(configuration), '--output', str(output)],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env={**os.environ, MARK: str(output)},
                start_new_session=True,
            )
        )
        return running[-1]

    yield start_experiment
    for process in running:
        process.kill()
        process.communicate()


@pytest.mark.parametrize('scenario', NUDGES)
def test_a_soliton_crosses_is_recorded_and_replayed_alike(
    start: Start, tmp_path: Path, scenario: str
) -> None:
    process = start(CONFIGURATION / f'{scenario}.yaml', tmp_path)
    said = process.communicate(timeout=LONGEST_RUN)[0]
    assert process.returncode == 0, said
    summary = json.loads((tmp_path / 'summary.json').read_text(encoding='utf-8'))
    run = read_run(tmp_path / f'{scenario}_0')
    assert summary['crossings'] == len(run.crossings) >= 2
    assert [crossing.direction for crossing in run.crossings[:2]] == [1, -1]
    assert summary['motion'] == run.named.chain.motion.value
    assert summary['lost_messages'] == 0
    assert summary['recorded_messages'] == run.messages
    assert summary['frames_missing_in_replay'] == 0
    assert summary['replayed_messages'] == frames_in(tmp_path / f'{scenario}_0')
    assert summary['largest_replay_difference_rotors'] == 0
    assert summary['missed_deadlines'] >= 0
    assert summary['publish_rate_hz'] == pytest.approx(250, rel=0.05)
    assert abs(summary['energy_drift']) < 1e-8
    assert summary['speed_rotors_per_s'] == pytest.approx(predicted_speed(run, scenario), rel=0.01)
    for picture in ('kymograph.png', 'track.png'):
        assert np.std(imread(tmp_path / picture)[..., :3]) > 0.05
    assert f'crossed the chain of {run.named.rotors} rotors' in said
    assert str(tmp_path / 'kymograph.png') in said
    assert_nothing_runs(tmp_path)


@pytest.mark.parametrize('to_group', [True, False])
@pytest.mark.parametrize('moment', ['Starting', 'rotor [', 'replaying ['])
def test_ctrl_c_stops_everything_and_leaves_a_readable_bag(
    start: Start, tmp_path: Path, moment: str, to_group: bool
) -> None:
    process = start(CONFIGURATION / 'flipper.yaml', tmp_path)
    wait_for_line(process, moment)
    asked = time.monotonic()
    (os.killpg if to_group else os.kill)(process.pid, signal.SIGINT)
    said = process.communicate(timeout=10 * TIME_TO_STOP)[0]
    assert time.monotonic() - asked < TIME_TO_STOP
    assert process.returncode == 130
    assert 'Stopped.' in said
    assert_nothing_runs(tmp_path)
    if moment != 'Starting':
        assert frames_in(tmp_path / 'flipper_0') > 100


def test_a_nudge_too_weak_to_cross_is_said_so(start: Start, tmp_path: Path) -> None:
    weak = (CONFIGURATION / 'flipper.yaml').read_text(encoding='utf-8')
    weak = weak.replace('nudge: 10.0', 'nudge: 0.1').replace('time_limit: 30.0', 'time_limit: 2.0')
    configuration = tmp_path / 'weak.yaml'
    configuration.write_text(weak, encoding='utf-8')
    process = start(configuration, tmp_path / 'out')
    said = process.communicate(timeout=LONGEST_RUN)[0]
    assert process.returncode == 1
    assert 'within 2 s' in said
    assert 'raise time_limit' in said
    assert 'Traceback' not in said
    assert_nothing_runs(tmp_path / 'out')


def test_a_missing_configuration_is_named(start: Start, tmp_path: Path) -> None:
    process = start(tmp_path / 'nowhere.yaml', tmp_path)
    said = process.communicate(timeout=LONGEST_RUN)[0]
    assert process.returncode == 2
    assert 'nowhere.yaml' in said
    assert 'config/flipper.yaml' in said


def wait_for_line(process: subprocess.Popen[str], begin: str) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith(begin):
            return
    pytest.fail(f'the experiment ended without a line that begins with {begin!r}')


def predicted_speed(run: RecordedRun, scenario: str) -> float:
    """Mean speed of the first two crossings of a chain simulated without any node."""
    chain = run.named.chain
    rest = chain.uniform_state(-1)
    rates = NUDGES[scenario] * edge_mode(chain, rest, Edge.NEAREST)
    duration = run.crossings[1].end + 0.5
    crossings = find_crossings(chain, follow(chain, simulate(chain, rest, rates, duration, 0.004)))
    return float(np.mean([crossing.speed for crossing in crossings[:2]]))


def frames_in(bag: Path) -> int:
    with open_bag(bag) as reader:
        return reader.topics['/joint_states'].msgcount


def assert_nothing_runs(output: Path) -> None:
    """No process is left that an experiment with this output has started."""
    mark = f'{MARK}={output}'.encode()
    left = []
    for process in Path('/proc').glob('[0-9]*'):
        try:
            if mark in (process / 'environ').read_bytes().split(b'\0'):
                left.append((process / 'cmdline').read_bytes())
        except OSError:
            continue
    assert left == []
