# SPDX-License-Identifier: Apache-2.0
"""The demo as a person runs it: every scenario in processes, and Ctrl-C at any moment."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_prefix
from matplotlib.image import imread

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.solitons.track import find_crossings, follow
from soliton_linkage_nodes.bags.reading import find_topic, open_bag, read_topic
from soliton_linkage_nodes.bags.recovery import check_bag
from soliton_linkage_nodes.messages.conversions import joint_states_from_msg
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis
from soliton_linkage_nodes.messages.state_conversions import state_to_msg
from soliton_linkage_nodes.programs.bag_analysis import read_chain
from soliton_linkage_nodes.programs.experiment import experiment
from soliton_linkage_nodes.programs.experiment.program import main
from soliton_linkage_nodes.programs.experiment.report import RecordedRun, read_run
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses
from soliton_linkage_nodes.runtime.stamps import stamp_of

ROOT = Path(__file__).resolve().parents[2]
CONFIGURATION = ROOT / 'config'
SCENARIO, NUDGE = 'spinner', 12.5
ROTORS = 16
RATE = 100.0
LONGEST_RUN = 240.0
MARK = 'SOLITON_EXPERIMENT'

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start():
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


def test_a_soliton_crosses_is_recorded_and_replayed_alike(start, tmp_path):
    configuration = configured(tmp_path, SCENARIO)
    tmp_path /= 'out'
    leave_an_earlier_run(tmp_path, SCENARIO)
    process = start(configuration, tmp_path)
    said = process.communicate(timeout=LONGEST_RUN)[0]
    assert process.returncode == 0, said
    assert {path.name for path in tmp_path.iterdir()} == {
        *('kymograph.png', 'kymograph.txt', 'track.png', 'track.txt'),
        *('log', 'summary.json', 'view.html', '.written', f'{SCENARIO}_0'),
    }
    summary = json.loads((tmp_path / 'summary.json').read_text(encoding='utf-8'))
    run = read_run(tmp_path / f'{SCENARIO}_0')
    assert summary['crossings'] == len(run.crossings) >= 2
    assert [crossing.direction for crossing in run.crossings[:2]] == [1, -1]
    assert summary['motion'] == run.named.chain.motion.value
    assert summary['lost_messages'] == 0
    assert summary['recorded_messages'] == run.messages
    assert summary['frames_missing_in_replay'] == 0
    assert summary['replayed_messages'] == frames_in(tmp_path / f'{SCENARIO}_0')
    assert summary['largest_replay_difference_rotors'] == 0
    assert summary['publish_rate_hz'] > 0
    assert abs(summary['energy_drift']) < 1e-8
    speeds = [crossing.site_rate for crossing in run.crossings]
    assert summary['speed_rotors_per_s'] == pytest.approx(np.mean(speeds))
    assert np.mean(speeds[:2]) == pytest.approx(predicted_speed(run), rel=0.01)
    assert_live_analysis_is_that_of_the_recording(tmp_path / f'{SCENARIO}_0')
    for picture in ('kymograph.png', 'track.png'):
        assert np.std(imread(tmp_path / picture)[..., :3]) > 0.05
    assert f'crossed the chain of {run.named.rotors} rotors' in said
    assert str(tmp_path / 'kymograph.png') in said
    assert_nothing_runs(tmp_path)


def test_ctrl_c_stops_everything_and_leaves_a_readable_bag(start, tmp_path):
    output = tmp_path / 'out'
    process = start(configured(tmp_path, 'flipper', nudge=25.0), output)
    wait_for_line(process, 'Replaying ')
    assert_it_stops(process, output, signal.SIGINT, to_group=True)
    assert frames_in(output / 'flipper_0') > 100


def test_a_signal_while_nodes_come_up_stops_them_and_leaves_a_readable_bag(start, tmp_path):
    process = start(CONFIGURATION / 'flipper.yaml', tmp_path)
    bag = tmp_path / 'flipper_0'
    deadline = time.monotonic() + LONGEST_RUN
    while not (bag / 'flipper_0_0.mcap').exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert_it_stops(process, tmp_path, signal.SIGTERM, to_group=False)
    assert check_bag(bag).damage == []


def test_a_parameter_that_stops_a_node_stops_the_experiment(tmp_path, monkeypatch):
    class OnlyRecorder(ChildProcesses):
        def start(self, node, *given):
            if node == 'bag_recorder':
                super().start(node, *given)

    configuration = tmp_path / 'wrong.yaml'
    configuration.write_text('bag_recorder:\n  ros__parameters:\n    regx: x\n')
    monkeypatch.setattr(experiment, 'ChildProcesses', OnlyRecorder)
    monkeypatch.setenv(MARK, str(tmp_path))
    monkeypatch.setattr(
        'sys.argv', ['experiment', str(configuration), '--output', str(tmp_path / 'out')]
    )
    with pytest.raises(SystemExit) as end:
        main()
    assert "parameter 'regx' of bag_recorder is unknown; did you mean 'regex'?" in str(end.value)
    assert_nothing_runs(tmp_path)


def test_a_wrong_configuration_and_output_are_logged_in_one_line(tmp_path, monkeypatch):
    (tmp_path / 'file').write_text('no folder')
    for configuration, output, complaint in (
        (configured(tmp_path, 'flipper', nugde=10.0), tmp_path / 'out', "mean 'nudge'?"),
        (CONFIGURATION / 'flipper.yaml', tmp_path / 'file' / 'out', str(tmp_path / 'file')),
    ):
        monkeypatch.setattr(
            'sys.argv', ['experiment', str(configuration), '--output', str(output)]
        )
        with pytest.raises(SystemExit) as end:
            main()
        (line,) = str(end.value).strip().splitlines()
        assert line.startswith('The experiment failed: ')
        assert complaint in line


def test_a_missing_configuration_is_named(monkeypatch, capsys):
    monkeypatch.setattr('sys.argv', ['experiment', 'nowhere.yaml'])
    with pytest.raises(SystemExit, match='2'):
        main()
    (line,) = capsys.readouterr().err.splitlines()
    assert 'nowhere.yaml' in line
    assert 'config/flipper.yaml' in line


def leave_an_earlier_run(output: Path, scenario: str) -> None:
    bag = output / f'{scenario}_0'
    bag.mkdir(parents=True)
    for path in (bag / f'{scenario}_0_0.mcap', bag / 'metadata.yaml', output / 'summary.json'):
        path.write_text('of an earlier run')


def configured(folder: Path, scenario: str, **parameters: float) -> Path:
    """A scenario of few rotors at a low rate of frames, with parameters of the experiment."""
    path = CONFIGURATION / f'{scenario}.yaml'
    configuration = yaml.safe_load(path.read_text(encoding='utf-8'))
    configuration['/**/simulator']['ros__parameters']['publish_rate'] = RATE
    configuration['/**/experiment']['ros__parameters'].update(parameters)
    configuration['/**']['ros__parameters']['chain.number_of_rotors'] = ROTORS
    path = folder / path.name
    path.write_text(yaml.safe_dump(configuration), encoding='utf-8')
    return path


def assert_it_stops(
    process: subprocess.Popen[str], output: Path, number: signal.Signals, to_group: bool
) -> None:
    (os.killpg if to_group else os.kill)(process.pid, number)
    said = process.communicate(timeout=LONGEST_RUN)[0]
    assert process.returncode == 130
    assert 'Stopped.' in said
    assert 'Traceback' not in said
    assert_nothing_runs(output)


def assert_live_analysis_is_that_of_the_recording(bag: Path) -> None:
    """To the last bit, without any node, from the frames that the live one was in time for.

    It also analysed the first frames, whose states it published before the recorder discovered it.
    """
    with open_bag(bag) as reader:
        live = {str(state.header.stamp): state for _, state in read_topic(reader, 'soliton_state')}
        frames = [message for _, message in read_topic(reader, 'joint_states')]
        analysis = JointStateAnalysis()
        analysis.set_chain(read_chain(reader))
        kicks = list(reader.messages([find_topic(reader, 'delivered_impulses')]))
    assert len(kicks) == 1
    assert len(live) > 100
    recorded = False
    for frame in frames:
        stamp = str(frame.header.stamp)
        recorded = recorded or stamp in live
        if recorded and stamp not in live:
            continue
        joints = joint_states_from_msg(frame)
        if kicks and stamp_of(kicks[0][2]) <= joints.stamp:
            analysis.add_impulses(kicks.pop()[2])
        found = analysis.analyse(joints)
        assert found is not None
        if recorded:
            assert repr(live.pop(stamp)) == repr(state_to_msg(found, joints))
    assert not live


def wait_for_line(process: subprocess.Popen[str], begin: str) -> None:
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        if line.startswith(begin):
            return
        lines.append(line)
    pytest.fail(f'no line began with {begin!r} before the end: {"".join(lines[-20:])}')


def predicted_speed(run: RecordedRun) -> float:
    """Mean speed of the first two crossings of a chain simulated without any node."""
    chain = run.named.chain
    rest = chain.uniform_state(-1)
    rates = NUDGE * edge_mode(chain, rest, Edge.NEAREST)
    duration = run.crossings[1].end + 0.5
    crossings = find_crossings(chain, follow(chain, simulate(chain, rest, rates, duration, 0.004)))
    return float(np.mean([crossing.site_rate for crossing in crossings[:2]]))


def frames_in(bag: Path) -> int:
    with open_bag(bag) as reader:
        return reader.counts[find_topic(reader, '/joint_states')]


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
