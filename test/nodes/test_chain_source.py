# SPDX-License-Identifier: Apache-2.0
"""A node learns the chain from the latched topic, early or late, or from its parameters."""

from __future__ import annotations

from typing import Any

import pytest
from graphs import Graph, values
from rclpy.node import Node

from soliton_linkage.chain import Chain
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.chain_source import ChainSource
from soliton_linkage_nodes.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
    time_to_msg,
)
from soliton_linkage_nodes.diagnostics import Diagnostics, Report

pytestmark = pytest.mark.usefixtures('often')


class Learner(Node):
    """Wants to know the chain."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('learner', **kwargs)
        self.learnt: list[NamedChain] = []
        diagnostics = Diagnostics(self, 'learning', lambda: Report('here'))
        self.source = ChainSource(self, diagnostics, self.learnt.append)


def test_the_chain_is_learnt_by_those_who_come_before_and_after_it(
    graph: Graph, named: NamedChain
) -> None:
    early = graph.start(Learner)
    assert early.source.named is None
    topic = interfaces.CHAIN
    publisher = graph.user.create_publisher(topic.type, topic.name, topic.qos)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    late = graph.start(Learner)
    for learner in (early, late):
        graph.until(lambda learner=learner: learner.learnt, 'the chain')
        assert learner.learnt == [named]
        assert learner.source.named == named


def test_the_chain_can_change(graph: Graph, named: NamedChain) -> None:
    learner = graph.start(Learner)
    publisher = graph.speak(interfaces.CHAIN)
    other = NamedChain(Chain(number_of_rotors=2, mass=1.0), ('left', 'right'))
    for chain in (named, other):
        publisher.publish(chain_to_msg(chain, time_to_msg(0)))
        graph.until(lambda chain=chain: learner.source.named == chain, 'the chain')
    assert learner.learnt == [named, other]


def test_a_message_that_describes_no_chain_changes_nothing(
    graph: Graph, named: NamedChain
) -> None:
    learner = graph.start(Learner)
    publisher = graph.speak(interfaces.CHAIN)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    graph.until(lambda: learner.learnt, 'the chain')
    wrong = chain_to_msg(named, time_to_msg(0))
    wrong.spacing = float('nan')
    heard = graph.reports('learner')
    publisher.publish(wrong)
    graph.until(lambda: heard and values(heard[-1])['refused'] == '1', 'the refusal')
    assert 'spacing = nan must be a finite number' in values(heard[-1])['last refusal']
    assert learner.learnt == [named]


def test_parameters_take_the_place_of_the_topic(graph: Graph) -> None:
    given = {'chain_from': 'parameters', 'chain.number_of_rotors': 3, 'chain.mass': 0.5}
    learner = graph.start(Learner, given)
    chain = Chain(number_of_rotors=3, mass=0.5)
    assert learner.learnt == [NamedChain(chain, default_joint_names(3))]
    assert graph.user.count_subscribers(interfaces.CHAIN.name) == 0


def test_parameters_of_no_chain_are_refused(graph: Graph) -> None:
    with pytest.raises(ValueError, match=r'parameter chain\.mass of learner = -1\.0 must lie'):
        graph.start(Learner, {'chain_from': 'parameters', 'chain.mass': -1.0})
