# SPDX-License-Identifier: Apache-2.0
"""The observer of an experiment knows where the ends of the chain are before it judges."""

from __future__ import annotations

from graphs import Graph
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.programs.experiment.observer import Observer
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

CHAIN = Chain(number_of_rotors=8)


def test_a_state_that_comes_before_the_chain_does_not_suffice(graph: Graph) -> None:
    observer = graph.start(Observer)
    stamp = time_to_msg(1)
    states = graph.speak(interfaces.SOLITON_STATE)
    states.publish(SolitonState(header=Header(stamp=stamp)))
    graph.until(lambda: observer.states, 'the state')
    assert not observer.informed
    chains = graph.speak(interfaces.CHAIN)
    chains.publish(chain_to_msg(NamedChain(CHAIN, default_joint_names(8)), stamp))
    graph.until(lambda: observer.rotors == 8, 'the chain')
    assert observer.informed
    observer.forget()
    assert not observer.informed
