# SPDX-License-Identifier: Apache-2.0
"""Nodes have help that holds every parameter, and refuse arguments that they do not know."""

import re

import pytest

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.runtime.command_line import check_arguments, executable_name, help_text
from soliton_linkage_nodes.simulator.node import Simulator

OF_ROS = {
    *('use_sim_time', 'start_type_description_service', 'rosout', 'parameter_events'),
    *('describe_parameters', 'get_parameters', 'get_parameter_types', 'list_parameters'),
    *('set_parameters', 'set_parameters_atomically', 'get_type_description'),
    *('change_state', 'get_state', 'get_available_states', 'get_available_transitions'),
    *('get_transition_graph', 'transition_event'),
}


def test_help_lists_every_parameter_and_topic(graph, node_type, needed):
    started = graph.start(node_type, needed.get(node_type, {}))
    assert started.get_name() == executable_name(node_type)
    told = help_text(node_type)
    shown = re.findall(r'^  (\S+):=(.*)  \((\w+)\)$', told, flags=re.MULTILINE)
    assert {name for name, _, _ in shown} == started.get_parameters_by_prefix('').keys() - OF_ROS
    for name, _, kind in shown:
        assert kind == started.get_parameter(name).type_.name.lower(), name
    words = set(re.findall(r'\w+', told))
    spoken = {publisher.topic_name for publisher in started.publishers}
    spoken |= {subscription.topic_name for subscription in started.subscriptions}
    spoken |= {service.srv_name for service in started.services}
    replayed = (
        {'chain', 'joint_states', 'soliton_state', 'nudge'} if node_type is BagPlayer else set()
    )
    assert {name.rpartition('/')[2] for name in spoken} - OF_ROS - replayed <= words


def test_help_describes_each_parameter():
    told = help_text(Simulator)
    assert (
        '  publish_rate:=500.0  (double)\n      rate of joint_states in simulated time [Hz]; '
        in told
    )
    assert '1 to 10000\n' in told
    assert '  fixed_rotors:=[]  (string_array)\n' in told
    assert 'one of elastic, rigid\n' in told
    assert max(map(len, told.splitlines())) < 100


def test_help_ends_well(capsys):
    for arguments in [['--help'], ['-h'], ['--ros-args', '-p', 'x:=1', '-h']]:
        with pytest.raises(SystemExit) as ended:
            check_arguments(BagRecorder, arguments)
        assert ended.value.code == 0
        assert capsys.readouterr().out.startswith('bag_recorder: Node that')


def test_unknown_arguments_are_rejected_with_a_proposal(capsys):
    for node, arguments, meant in [
        (Simulator, ['config/flipper.yaml'], '--ros-args --params-file config/flipper.yaml'),
        (Simulator, ['--params-file', 'x.yaml'], '--ros-args --params-file x.yaml'),
        (Simulator, ['-p', 'publish_rate:=5'], '--ros-args -p publish_rate:=5'),
        (Simulator, ['publish_rate:=5'], '--ros-args -p publish_rate:=5'),
        (Simulator, ['--publish-rate', '5'], '--ros-args -p publish_rate:=5'),
        (Simulator, ['--publish_rate=5'], '--ros-args -p publish_rate:=5'),
        (Simulator, ['--bogus'], None),
        (Simulator, ['--ros-args', '-p', 'x:=1', '--', 'bags'], None),
        (BagPlayer, ['bags/flipper_0'], '--ros-args -p bag:=bags/flipper_0'),
        (BagRecorder, ['run', '--ros-args'], '--ros-args -p output:=run'),
    ]:
        with pytest.raises(SystemExit) as ended:
            check_arguments(node, arguments)
        assert ended.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f'{executable_name(node)}: unknown argument ')
        command = (
            f'{executable_name(node)} {meant}' if meant else f'{executable_name(node)} --help'
        )
        assert line.endswith(command)


def test_arguments_of_ros_are_left_to_ros():
    for arguments in [[], ['--ros-args', '-p', 'publish_rate:=5']]:
        check_arguments(Simulator, arguments)


def test_a_program_prints_its_help_and_starts_nothing(start, tmp_path):
    program = start('bag_recorder', '--help')
    assert program.wait() == 0
    assert any('snapshot_duration:=0.0' in line for line in program.said)
    assert not list(tmp_path.glob('recording_*'))
