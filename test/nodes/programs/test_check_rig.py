# SPDX-License-Identifier: Apache-2.0
"""The program check_rig watches a running simulator while a hand turns its edge rotors."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import pytest
from graphs import Graph
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from soliton_linkage.identification.rig_bonds import DOUBTFUL, RIGHT
from soliton_linkage.identification.rig_check import RigFindings
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.programs.check_rig import CheckRig
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_studies.pictures import rig_page

ROTORS = 6
DAMPED = {
    'chain.number_of_rotors': ROTORS,
    'chain.damping': 3e-4,
    'publish_rate': 100.0,
    'real_time_factor': 0.5,
    'initial_state': 'left_leaning',
    'sensors.noise': 0.003,
}


def checked(
    graph: Graph,
    seconds: float = 1.0,
    joints: Sequence[str] = (),
    turn: Callable[[], None] | None = None,
) -> RigFindings:
    """Check the running publishers; `turn` is called repeatedly and turns the requested rotors."""
    given = [Parameter('joint_names', value=list(joints))] if joints else []
    program = CheckRig(threading.Event(), context=graph.context, parameter_overrides=given)

    def ended() -> bool:
        if turn is not None:
            turn()
        return answer.done()

    try:
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(program.check, seconds, 120.0, turn is not None)
            graph.until(ended, 'the findings')
        found = answer.result()
        assert found is not None
        return found
    finally:
        program.destroy_node()


def test_a_right_rig_is_right_and_its_page_lists_every_finding(graph, capfd):
    graph.start(Simulator, DAMPED)
    hand, text, asked = graph.speak(interfaces.ROTOR_IMPULSES), '', 0

    def turn():
        nonlocal text, asked
        text += capfd.readouterr().out
        if text.count('Turn rotor_') > asked:
            name = text.rpartition('Turn ')[2].partition(' ')[0]
            asked += 1
            hand.publish(RotorImpulses(name=[name], impulse=[3e-3]))

    found = checked(graph, 2.0, turn=turn)
    verdicts = {each.subject: each.verdict for each in found.findings}
    assert verdicts.pop('clock') == DOUBTFUL
    verdicts.pop('passage')
    verdicts.pop('rate')
    assert set(verdicts.values()) == {RIGHT}, found.findings
    assert found.sound
    page = rig_page(found, [f'rotor_{n}' for n in range(ROTORS)], 'a chain')
    assert all(each.text in page for each in found.findings)
    assert '<svg' in page
    assert 'src=' not in page


def test_a_wrong_encoder_is_reported_with_exit_code_1(graph, start):
    offsets = [0.0, 0.0, 0.3, 0.0, 0.0, 0.0]
    graph.start(Simulator, {**DAMPED, 'sensors.offsets': offsets})
    program = start('check_rig', '--no-turn', '--seconds', '2', '--output', 'rig.html')
    graph.until(lambda: program.process.poll() is not None, 'an end', lambda: program.said)
    assert program.wait() == 1
    text = '\n'.join(program.said)
    assert 'the reading of rotor_2 is too large by 0.3 rad' in text
    assert 'rotor_0 was not turned by hand' in text


def test_two_publishers_of_the_same_joints_are_named(graph):
    graph.start(Simulator, DAMPED)
    renamed = ['--ros-args', '-r', '__node:=rig']
    graph.start(Simulator, {**DAMPED, 'initial_state': 'right_leaning'}, cli_args=renamed)
    found = checked(graph)
    texts = [each.text for each in found.findings if each.subject == 'nodes']
    assert texts
    assert '/rig' in texts[0]
    assert '/simulator' in texts[0]
    assert not found.sound


def test_two_publishers_of_different_joints_are_right(graph):
    halves = [['rotor_0', 'rotor_1'], ['rotor_2', 'rotor_3', 'rotor_4', 'rotor_5']]
    boards = [graph.user.create_publisher(JointState, 'joint_states', 10) for _ in halves]
    stop = threading.Event()

    def publish() -> None:
        while not stop.wait(0.02):
            stamp = graph.user.get_clock().now().to_msg()
            for board, names in zip(boards, halves, strict=True):
                message = JointState(name=names, position=[0.1] * len(names))
                message.header.stamp = stamp
                board.publish(message)

    sender = threading.Thread(target=publish)
    sender.start()
    try:
        found = checked(graph, joints=[name for half in halves for name in half])
    finally:
        stop.set()
        sender.join()
    assert 'nodes' not in {each.subject for each in found.findings}


def test_joint_states_that_are_missing_or_stop_are_an_error(graph):
    program = CheckRig(threading.Event(), context=graph.context)
    try:
        with pytest.raises(ValueError, match=r'no joint_states within 0\.5 s; start '):
            program.check(0.5, 0.5, False)
        program.receive(JointState(name=['rotor_0'], position=[0.1]))
        with pytest.raises(ValueError, match='joint_states stopped'):
            program.check(0.5, 120.0, False)
    finally:
        program.destroy_node()
