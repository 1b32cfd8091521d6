# SPDX-License-Identifier: Apache-2.0
"""The programs `recover_bag` and `check_bag`."""

import json
import re
import sys
from types import ModuleType

import pytest
from rclpy.serialization import serialize_message
from recordings import START, run_of, write_bag
from std_msgs.msg import Float64

from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.programs import check_bag, recover_bag
from soliton_linkage_nodes.runtime.interfaces import NUDGE
from soliton_linkage_nodes.runtime.stamps import SECOND


@pytest.fixture
def ran(monkeypatch, capsys):
    """Run a program in this process; return its exit code and its lines of output."""
    monkeypatch.setattr(recover_bag, 'interrupt_on_signals', lambda: None)

    def run(program: ModuleType, *arguments: object) -> tuple[int, list[str]]:
        monkeypatch.setattr(sys, 'argv', ['program', *map(str, arguments)])
        code: object = 0
        try:
            program.main()
        except SystemExit as ended:
            code = ended.code
        failure = [code] if isinstance(code, str) else []
        return 1 if code else 0, [*capsys.readouterr().out.splitlines(), *failure]

    return run


def test_a_whole_bag_is_reported_in_the_layout_of_rosbag2(ran, named, tmp_path):
    code, said = ran(check_bag, write_bag(tmp_path / 'run', run_of(named, 50)))
    assert code == 0
    labels = [line[:19].strip() for line in said if line[0] != ' ']
    assert labels == [
        'Files:',
        'Bag size:',
        'Storage id:',
        'ROS Distro:',
        'Duration:',
        'Start:',
        'End:',
        'Messages:',
        'Topic information:',
        'Service:',
        'Service information',
        'Lost:',
        'Result:',
    ]
    texts = [line[19:] for line in said]
    assert (texts[0], texts[4], texts[7]) == ('run_0_0.mcap', '0.050000000s', '52')
    assert texts[5].endswith(f' ({START / SECOND:.9f})')
    states = 'Topic: /joint_states | Type: sensor_msgs/msg/JointState | Count: 50'
    assert f'{states} | Serialization Format: cdr' in texts
    assert said[-2:] == ['Lost:              unknown when recorded', 'Result:            complete']


def test_the_recorded_time_is_reported_without_pauses(ran, named, tmp_path):
    pause = (START + SECOND, START + 3 * SECOND)
    bag = write_bag(tmp_path / 'run', run_of(named, 10, SECOND), gaps=[pause])
    code, said = ran(check_bag, bag)
    assert code == 0
    assert 'Duration:          10.000000000s' in said
    assert 'Recorded:          8.000000000s, without 2.000000000s of pauses' in said


def test_a_report_as_json_has_the_same_numbers(ran, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 50))
    code, said = ran(check_bag, bag, '--json')
    assert code == 0
    report = json.loads('\n'.join(said))
    assert (report['messages'], report['sound'], report['damage']) == (52, True, [])
    assert sum(topic['count'] for topic in report['topics']) == 52
    assert report['size'] == (bag / 'run_0_0.mcap').stat().st_size
    assert report['start'] == START


@pytest.mark.parametrize(
    ('name', 'line'),
    [
        ('run.bag', 'is a bag of ROS 1; convert it with: rosbags-convert --src'),
        ('nowhere', "nowhere' does not exist; give the path of a bag directory"),
        ('empty', 'has no .mcap or .db3 file, the directory is empty; give a bag directory'),
    ],
)
def test_what_is_no_bag_of_ros_2_is_reported_with_the_remedy(ran, tmp_path, name, line):
    (tmp_path / 'run.bag').write_bytes(b'#ROSBAG V2.0\n')
    (tmp_path / 'empty').mkdir()
    for program in (check_bag, recover_bag):
        code, said = ran(program, tmp_path / name)
        assert code == 1
        assert line in said[-1]


def test_recovery_of_no_message_exits_with_1_and_leaves_no_bag(ran, tmp_path):
    writer = BagWriter(tmp_path / 'run')
    topic = writer.add_topic('/n', 'std_msgs/msg/Float64', NUDGE.qos)
    writer.write(topic, START, serialize_message(Float64(data=1.5)))
    writer.close()
    (data,) = writer.path.glob('*.mcap')
    content = data.read_bytes()
    stamp = content.index(serialize_message(Float64(data=1.5)))
    data.write_bytes(content[:stamp] + b'x' + content[stamp + 1 :])
    code, said = ran(recover_bag, writer.path)
    assert code == 1
    assert 'nothing can be recovered' in said[-1]
    assert not list(tmp_path.glob('run_0_recovered*'))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_cut_bag_is_recovered_beside_it(ran, named, tmp_path, storage):
    bag = write_bag(tmp_path / 'run', run_of(named, 500), storage)
    (data,) = (path for path in bag.iterdir() if path.suffix != '.yaml')
    data.write_bytes(data.read_bytes()[:100_000])
    code, said = ran(check_bag, bag)
    assert code == 1
    assert said[-1][19:].startswith(f'damaged; recover_bag {bag} writes')
    code, recovered = ran(recover_bag, bag)
    assert code == 0
    with open_bag(tmp_path / 'run_0_recovered_0') as reader:
        count = reader.message_count
        assert 'damage' in reader.custom_data
    assert 100 < count < 500
    assert recovered[-1].startswith(f'recovered {count} messages')
    lost = re.search(r', (\d+) lost into', recovered[-1])
    code, said = ran(check_bag, tmp_path / 'run_0_recovered_0')
    assert code == 1
    assert said[-1] == 'Result:            complete'
    told = f'{lost[1] if lost else "an unknown number"} by damage before recovery ('
    (line,) = (line for line in said if line.startswith('Lost:'))
    assert line[19:].startswith(told)
    assert line.endswith('; unknown when recorded')
