# SPDX-License-Identifier: Apache-2.0
"""The visualisation between a test that plays the chain and one that looks."""

from itertools import count
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from graphs import Graph, values
from joint_frames import frame_of, halves
from std_msgs.msg import Header
from urdf_parser_py.urdf import URDF
from visualization_msgs.msg import Marker

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import LastKick, Soliton, SolitonState
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.visualisation.node import Visualisation


class Stage:
    """The topics of a chain, played by the test."""

    def __init__(self, graph: Graph, named: NamedChain, parameters: dict[str, Any]) -> None:
        self.graph, self.named = graph, named
        self.node = graph.start(Visualisation, parameters)
        self.chain = graph.speak(interfaces.CHAIN)
        self.joints = graph.speak(interfaces.JOINT_STATES)
        self.states = graph.speak(interfaces.SOLITON_STATE)
        self.kicks = graph.speak(interfaces.LAST_KICK)
        self.number = 0

    def learn(self, named: NamedChain) -> None:
        self.named = named
        self.chain.publish(chain_to_msg(named, Time()))
        self.graph.until(lambda: self.node.observed.named == named, 'the chain')

    def move(self, angles: Array) -> Time:
        """Publish a frame, 0.1 s after the last one, and wait until it is taken."""
        self.number += 1
        frame = frame_of(self.named, angles, self.number * 10**8)
        taken = self.node.observed.frames
        self.joints.publish(frame)
        self.graph.until(lambda: self.node.observed.frames > taken, 'a frame')
        return frame.header.stamp

    def tell(self, stamp: Time, *places: float) -> None:
        """Publish a state with walls at these places [m], wait until it is taken."""
        solitons = [
            Soliton(position=at, position_deviation=0.01, rotor=at / 0.1, charge=1)
            for at in places
        ]
        taken = self.node.observed.states
        self.states.publish(SolitonState(header=Header(stamp=stamp), solitons=solitons))
        self.graph.until(lambda: self.node.observed.states > taken, 'a state')


@pytest.fixture
def stage(graph, named):
    made = Stage(graph, named, {})
    made.learn(named)
    return made


def by_name(message: Any) -> dict[tuple[str, int], Marker]:
    return {(marker.ns, marker.id): marker for marker in message.markers}


def test_the_description_is_that_of_the_chain_and_late_joiners_get_it(stage):
    heard = stage.graph.hear(interfaces.ROBOT_DESCRIPTION)
    stage.graph.until(lambda: heard, 'a description')
    robot = URDF.from_xml_string(heard[0].data)
    assert tuple(joint.name for joint in robot.joints) == stage.named.joint_names
    assert len(heard) == 1


def test_markers_have_the_stamp_of_the_frame_and_walls_go(stage):
    angles = stage.named.chain.uniform_state(1)
    heard = stage.graph.hear(interfaces.MARKERS)
    stage.tell(stage.move(angles), 0.25, 0.5)
    stamp = stage.move(angles)
    stage.graph.until(
        lambda: any(('solitons', 1) in by_name(message) for message in heard), 'two walls'
    )
    markers = by_name(heard[-1])
    assert {marker.header.frame_id for marker in heard[-1].markers} == {'linkage'}
    assert markers['springs', 0].header.stamp == stamp
    assert markers['springs', 0].type == Marker.LINE_LIST
    assert len(markers['springs', 0].points) == len(markers['springs', 0].colors) == 14
    wall = markers['solitons', 0]
    assert (wall.pose.position.x, wall.scale.x) == (0.25, pytest.approx(0.04))
    stage.tell(stage.move(angles), 0.3)
    stage.move(angles)
    stage.graph.until(lambda: by_name(heard[-1])['solitons', 0].pose.position.x == 0.3, 'one wall')
    gone = [by_name(message).get(('solitons', 1)) for message in heard]
    assert [marker.action for marker in gone if marker][-1] == Marker.DELETE


def test_the_text_has_phase_energies_and_node_reports(stage):
    diagnostics = stage.graph.speak(interfaces.DIAGNOSTICS, subscribers=1)
    status = DiagnosticStatus(level=b'\x01', name='pump: air', message='leaks')
    diagnostics.publish(DiagnosticArray(status=[status]))
    heard = stage.graph.hear(interfaces.MARKERS)
    stamp = stage.move(stage.named.chain.uniform_state(1))
    state = SolitonState(header=Header(stamp=stamp))
    state.cycle.phase, state.cycle.leg, state.cycle.completed = 1.25, 2, 3
    state.energies.kinetic, state.energies.elastic = 0.002, 5e-5
    stage.states.publish(state)

    def figures() -> list[str]:
        stage.move(stage.named.chain.uniform_state(1))
        return by_name(heard[-1])['figures', 0].text.splitlines() if heard else []

    stage.graph.until(lambda: len(figures()) >= 3, 'figures')
    told = figures()
    assert told[0] == 'phase 1.25 rad, leg 2, 3 cycles'
    assert told[1] == 'kinetic 2.000 mJ, elastic 0.050 mJ'
    assert 'WARN pump: leaks' in told[2:]


def test_the_last_kick_is_shown_for_a_while(stage):
    angles = stage.named.chain.uniform_state(1)
    heard = stage.graph.hear(interfaces.MARKERS)
    kick = LastKick(header=Header(stamp=stage.move(angles)), name=['rotor_2'], impulse=[1e-4])
    stage.kicks.publish(kick)

    def is_shown() -> bool:
        stage.move(angles)
        return bool(heard and by_name(heard[-1])['last_kick', 0].action == Marker.ADD)

    stage.graph.until(is_shown, 'a kick')
    shaft = by_name(heard[-1])['last_kick', 0].points[0]
    horizontal, vertical = stage.named.chain.positions(angles)
    assert (shaft.x, shaft.z) == pytest.approx((0.2 + horizontal[2], vertical[2]))
    begin = stage.number
    stage.graph.until(lambda: not is_shown(), 'the end of the kick')
    assert 20 < stage.number - begin < 60


def test_another_chain_clears_the_drawing(stage):
    heard = stage.graph.hear(interfaces.MARKERS)
    stage.move(stage.named.chain.uniform_state(1))
    stage.graph.until(lambda: heard, 'markers')
    fewer = type(stage.named.chain)(number_of_rotors=4)
    stage.learn(NamedChain(fewer, ('a', 'b', 'c', 'd')))
    stage.move(fewer.uniform_state(1))
    stage.graph.until(lambda: len(by_name(heard[-1])['rotors', 0].points) == 8, 'another chain')
    actions = [message.markers[0].action for message in heard]
    assert actions.count(Marker.DELETEALL) == 1


def test_the_pose_is_that_of_the_first_wall(stage):
    heard = stage.graph.hear(interfaces.SOLITON_POSE)
    stage.graph.until(
        lambda: stage.node.count_subscribers(interfaces.SOLITON_POSE.name), 'a subscription'
    )
    stamp = stage.move(stage.named.chain.uniform_state(1))
    stage.tell(stamp, 0.25, 0.5)
    stage.graph.until(lambda: heard, 'a pose')
    pose = heard[0].pose
    assert (heard[0].header.stamp, heard[0].header.frame_id) == (stamp, 'linkage')
    assert (pose.pose.position.x, pose.pose.orientation.w) == (0.25, 1.0)
    assert pose.covariance[0] == pytest.approx(1e-4)
    assert not pose.covariance[1:].any()


def test_the_kymograph_starts_before_the_first_subscriber(stage):
    for _ in range(4):
        stage.move(stage.named.chain.uniform_state(1))
    heard = stage.graph.hear(interfaces.KYMOGRAPH)
    stage.graph.until(lambda: heard, 'a kymograph')
    picture = heard[0]
    assert (picture.encoding, picture.width, picture.height) == ('rgb8', 600, 400)
    assert picture.step == 3 * picture.width
    assert len(picture.data) == picture.step * picture.height
    pixels = np.frombuffer(picture.data, np.uint8).reshape(400, 600, 3)
    assert (pixels[0, -9:] != 217).any(axis=1).all()


def test_nothing_is_drawn_without_subscribers(graph, named):
    stage = Stage(graph, named, {})
    reports = graph.reports('visualisation')
    graph.until(lambda: reports, 'a report')
    assert reports[-1].message == 'waiting for the topic chain'
    stage.learn(named)
    stage.move(named.chain.uniform_state(1))
    graph.until(lambda: values(reports[-1])['frames'] == '1', 'a report of a frame')
    told = values(reports[-1])
    assert {told[f'{name} [Hz]'] for name in ('markers', 'soliton_pose', 'kymograph')} == {'0'}


def test_joints_of_another_chain_are_rejected(stage):
    other = NamedChain(stage.named.chain, tuple('abcdefgh'))
    angles = stage.named.chain.uniform_state(1)
    stage.joints.publish(frame_of(other, angles))
    stage.graph.until(lambda: stage.node.diagnostics.rejected, 'a refusal')
    assert stage.move(angles)


def test_frames_in_two_messages_are_drawn_whole(stage):
    observed, angles = stage.node.observed, stage.named.chain.uniform_state(1)
    stamps = count(1)

    def is_whole() -> bool:
        for half in halves(frame_of(stage.named, angles, next(stamps), angles)):
            stage.joints.publish(half)
        return np.array_equal(observed.angles, angles)

    stage.graph.until(is_whole, 'all angles', lambda: observed.angles)
