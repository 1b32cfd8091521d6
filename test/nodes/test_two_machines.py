# SPDX-License-Identifier: Apache-2.0
"""A subscriber on another machine receives a simulator; network namespaces emulate machines."""

import os
import shutil
import subprocess
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from graphs import values
from programs import until
from rclpy.serialization import deserialize_message
from recordings import messages_of

BEYOND = (
    *('env', '-u', 'FASTRTPS_DEFAULT_PROFILES_FILE'),
    *('ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET', 'FASTDDS_BUILTIN_TRANSPORTS=UDPv4'),
)
NAMES = [f'soliton_{os.getpid()}_{end}' for end in 'ab']
ENDS = [f'sl{os.getpid()}{end}' for end in 'ab']
REPORT, ENOUGH = b'stamps behind the clock [s]', 2


def ip(arguments: str) -> None:
    subprocess.run(['ip', *arguments.split()], check=True, capture_output=True)


def is_up(name: str, end: str) -> bool:
    told = subprocess.run(
        ['ip', '-n', name, '-brief', 'link', 'show', end], check=True, capture_output=True
    )
    return told.stdout.split()[1] == b'UP'


@pytest.fixture
def machines():
    """Commands that run a program on one of two machines that are joined by a wire."""
    if shutil.which('ip') is None:
        pytest.skip('needs the command ip: apt install iproute2')
    try:
        for name in NAMES:
            ip(f'netns add {name}')
        ip(f'link add {ENDS[0]} type veth peer name {ENDS[1]}')
        for number, (name, end) in enumerate(zip(NAMES, ENDS, strict=True), 1):
            ip(f'link set {end} netns {name}')
            ip(f'-n {name} addr add 10.89.0.{number}/24 dev {end}')
            ip(f'-n {name} link set {end} up')
            ip(f'-n {name} link set lo up')
        # A node that starts before its end of the wire is up binds without it permanently.
        until(lambda: all(map(is_up, NAMES, ENDS)), 'the wire')
        yield [['ip', 'netns', 'exec', name, *BEYOND] for name in NAMES]
    except subprocess.CalledProcessError:
        pytest.skip('needs network namespaces: run as root, or in a privileged container')
    finally:
        for name in NAMES:
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)


def test_simulator_here_analyser_there(machines, start, tmp_path):
    here, there = machines
    bag = tmp_path / 'run_0'
    hearing = start(
        'suite',
        *('soliton_analyser', 'bag_recorder', '--ros-args', '-p', f'output:={tmp_path / "run"}'),
        command=there,
    )
    begun = time.monotonic()
    small = ('--ros-args', '-p', 'chain.number_of_rotors:=8', '-p', 'publish_rate:=100.0')
    simulator = start('simulator', *small, command=here)
    until(
        lambda: sum(file.read_bytes().count(REPORT) for file in bag.glob('*.mcap')) >= ENOUGH,
        'reports of the clock',
        lambda: (hearing.said, simulator.said),
    )
    assert simulator.stop() == 0
    assert hearing.stop() == 0
    assert any('/chain describes' in line for line in hearing.said)
    assert ', 0 lost' in hearing.said[-1]
    held = messages_of(bag)
    assert held['/joint_states']
    assert held['/soliton_state']
    reports = [deserialize_message(each, DiagnosticArray) for each in held['/diagnostics']]
    behind = [
        float(values(status)['stamps behind the clock [s]'])
        for report in reports
        for status in report.status
        if 'stamps behind the clock [s]' in values(status)
    ]
    # Both have one clock, so that no stamp can lag by more than the run.
    assert 0 <= min(behind) <= max(behind) < time.monotonic() - begun
