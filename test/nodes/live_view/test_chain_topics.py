# SPDX-License-Identifier: Apache-2.0
"""Chain and soliton of the page belong to the same frame."""

import math
import time
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from graphs import Graph
from joint_frames import frame_of, halves
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg


class Page:
    """Topics of a page, and publishers of frames and states."""

    def __init__(self, graph: Graph, named: NamedChain) -> None:
        self.finder = ChainFinder(Node('inbox', context=graph.context), '/')
        self.topics = self.finder.chains['/']
        self.model = self.topics.model
        self._named = named
        self._joints = graph.speak(interfaces.JOINT_STATES)
        self._states = graph.speak(interfaces.SOLITON_STATE)

    def publish_frame(self, stamp: int, angle: float) -> None:
        angles = np.full(self._named.rotors, float(angle))
        self._joints.publish(frame_of(self._named, angles, stamp, 0 * angles))

    def publish_state(self, stamp: int, rotor: float) -> None:
        header = Header(stamp=time_to_msg(stamp))
        self._states.publish(SolitonState(header=header, solitons=[Soliton(rotor=float(rotor))]))

    def update(self) -> None:
        self.finder.update()


@pytest.fixture
def page(graph, named):
    return Page(graph, named)


def test_a_late_state_is_shown_with_its_own_frame(graph, page):
    model, topics = page.model, page.topics

    def shown(number):
        page.update()
        return model.angles.size > 0 and model.angles[0] == model.numbers.get('rotor') == number

    page.publish_frame(0, 0)
    graph.until(lambda: page.update() or model.frames == 1, 'the joints')
    assert topics.is_analysed(topics.newest_frame), 'no analyser publishes'
    for number in (1, 2):
        page.publish_frame(number * SECOND, number)
        page.publish_state(number * SECOND, number)
        graph.until(lambda n=number: shown(n), f'frame {number} with its state')
    assert model.delay == 0.0
    assert topics.newest_frame == 2 * SECOND
    assert topics.is_analysed(2 * SECOND)
    page.publish_frame(3 * SECOND, 3)
    graph.until(lambda: page.update() or topics.newest_frame == 3 * SECOND, 'the third frame')
    graph.until(
        lambda: (
            page.publish_state(2 * SECOND, 2)
            or page.update()
            or not topics.is_analysed(3 * SECOND)
        ),
        'states',
    )
    page.publish_state(3 * SECOND, 3)
    graph.until(lambda: page.update() or topics.is_analysed(3 * SECOND), 'its state')


def test_the_first_frame_is_not_shown_with_an_earlier_state(graph, page):
    graph.until(
        lambda: (
            page.publish_state(SECOND, 3.0)
            or page.update()
            or not page.topics.is_analysed(2 * SECOND)
        ),
        'a state',
    )
    page.publish_frame(2 * SECOND, 0.0)
    graph.until(lambda: page.update() or page.topics.newest_frame == 2 * SECOND, 'the first frame')
    assert 'rotor' not in page.model.numbers


def test_a_state_that_arrives_after_its_frame_was_shown_alone_is_shown(graph, page):
    page.publish_frame(SECOND, 0.0)
    graph.until(lambda: page.update() or page.model.frames == 1, 'the frame')
    page.publish_state(SECOND, 3.0)
    graph.until(lambda: page.update() or page.model.numbers.get('rotor') == 3.0, 'its state')


def test_each_frame_has_its_own_state_if_the_analyser_lags(graph, page):
    lag, model = 20, page.model
    numbers, shown = count(1), list[bool]()

    def shows_pairs():
        number = next(numbers)
        page.publish_frame(number * SECOND, number)
        if number > lag:
            page.publish_state((number - lag) * SECOND, number - lag)
        before = model.frames
        page.update()
        if model.frames > before:
            shown.append(model.angles[0] == model.numbers.get('rotor'))
        return len(shown) > 10 and all(shown[-10:])

    graph.until(shows_pairs, 'ten frames with their states', lambda: shown)


def test_the_history_contains_the_frames_for_which_no_state_arrived(graph, page):
    model, stamps = page.model, count(SECOND, SECOND // 10)

    def publish(analysed):
        stamp = next(stamps)
        page.publish_frame(stamp, 0.0)
        if analysed:
            page.publish_state(stamp, 3.0)
        page.update()

    graph.until(lambda: publish(True) or model.numbers.get('rotor') == 3.0, 'the soliton')
    begin = model.stamp
    for _ in range(20):
        publish(False)
        time.sleep(0.01)
    graph.until(lambda: publish(True) or model.stamp > begin + 2.0, 'the next soliton')
    columns = [column.numbers[0] for column in model.history]
    assert sum(begin < stamp < begin + 2.0 for stamp in columns) > 3
    assert columns == sorted(columns)


def test_a_frame_without_its_state_shows_no_soliton(graph, page):
    model, stamps = page.model, count(SECOND, SECOND // 100)

    def publish(angle):
        stamp = next(stamps)
        page.publish_frame(stamp, angle)
        if not angle:
            page.publish_state(stamp, 3.0)
        page.update()

    graph.until(lambda: publish(0.0) or model.numbers.get('rotor') == 3.0, 'the soliton')
    graph.until(lambda: publish(1.0) or model.angles[0] == 1.0, 'a frame without a state')
    assert 'rotor' not in model.numbers


@pytest.mark.parametrize('publishers', [1, 2])
def test_frames_in_two_messages_are_shown_whole_without_an_analyser(
    graph, page, named, publishers
):
    model = page.model
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, time_to_msg(0)))
    graph.until(lambda: page.update() or model.named == named, 'the chain')
    boards = [graph.speak(interfaces.JOINT_STATES) for _ in range(publishers)]
    shown: list[bool] = []

    def shows_whole_frames() -> bool:
        angles = np.full(named.rotors, 0.001 * len(shown))
        frame = frame_of(named, angles, next(stamps), angles)
        for board, half in zip(2 * boards, halves(frame), strict=False):
            board.publish(half)
        before = model.frames
        page.update()
        if model.frames > before:
            shown.append(bool(np.isfinite(model.angles).all() and np.ptp(model.angles) == 0.0))
        return len(shown) > 5 and all(shown[-3:])

    stamps = count(SECOND, SECOND // 100)
    graph.until(shows_whole_frames, 'three whole frames', lambda: (shown, model.angles))


def test_late_frames_are_a_share_of_the_last_seconds(graph, page):
    found, reports = page.finder, graph.speak(interfaces.DIAGNOSTICS)

    def report(missed: int, frames: int) -> None:
        figures = {'missed deadlines': str(missed), 'frames': str(frames)}
        values = [KeyValue(key=key, value=value) for key, value in figures.items()]
        status = DiagnosticStatus(name='simulator: simulation', hardware_id='/simulator')
        status.values = values
        reports.publish(DiagnosticArray(status=[status]))

    assert found.late_share('/') is None
    report(100, 1000)
    report(110, 1200)
    graph.until(lambda: found.update() or found.late_share('/') is not None, 'two reports')
    assert math.isclose(found.late_share('/') or 0.0, 0.05)


def test_two_sources_of_one_topic_are_reported_while_both_publish(
    graph: Graph, named: NamedChain
) -> None:
    topics = ChainFinder(Node('inbox', context=graph.context), '/').chains['/']
    first, second = (graph.speak(interfaces.JOINT_STATES) for _ in range(2))
    stamps = count(1)

    def publish(*sources: Publisher) -> None:
        for source in sources:
            before, angles = topics.model.frames, np.zeros(named.rotors)
            source.publish(frame_of(named, angles, next(stamps) * SECOND, angles))
            graph.until(lambda n=before: topics.update() or topics.model.frames > n, 'the frame')

    publish(first, first, first, second, second)
    assert topics.conflict == '', 'one decrease is a restart'
    publish(first, second, first, second, first, second)
    assert 'several nodes publish joint_states' in topics.conflict
    graph.until(lambda: publish(second) or not topics.conflict, 'the end of the conflict')


def test_the_chain_is_that_of_the_remaining_publisher(graph: Graph, named: NamedChain) -> None:
    other = replace(named, chain=replace(named.chain, stiffness=2 * named.chain.stiffness))
    inbox = Node('inbox', context=graph.context)
    found = ChainFinder(inbox, '/')
    topics = found.chains['/']
    publishers = [graph.speak(interfaces.CHAIN) for _ in range(2)]
    for publisher, sent in zip(publishers, (named, other), strict=True):
        publisher.publish(chain_to_msg(sent, time_to_msg(0)))
        graph.until(lambda s=sent: found.update() or topics.model.named == s, 'the chain')
    graph.until(lambda: inbox.count_publishers('/chain') == 2, 'both publishers')
    topics.adapt()
    graph.user.destroy_publisher(publishers[1])
    graph.until(lambda: found.update() or topics.model.named == named, 'the remaining chain')
