# SPDX-License-Identifier: Apache-2.0
"""The observer of an experiment waits for the chain before it detects arrivals."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.programs.experiment.observer import Observer, RoundTrip
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

CHAIN = Chain(number_of_rotors=8)


def test_a_state_that_comes_before_the_chain_does_not_suffice(graph):
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


def test_a_soliton_is_back_once_it_has_been_at_the_other_edge(graph):
    observer = graph.start(Observer)
    trip = RoundTrip(observer)
    graph.speak(interfaces.CHAIN).publish(
        chain_to_msg(NamedChain(CHAIN, default_joint_names(8)), time_to_msg(1))
    )
    graph.until(lambda: observer.rotors == 8, 'the chain')
    assert trip.remark == ''
    assert 'no soliton is visible now' in trip.missing()
    states = graph.speak(interfaces.SOLITON_STATE)
    ways = [(0.5, False), (4.0, False), (6.0, False), (3.0, False), (1.5, True)]
    for second, (rotor, ended) in enumerate(ways):
        header = Header(stamp=time_to_msg(10**9 * second))
        states.publish(SolitonState(header=header, solitons=[Soliton(rotor=rotor)]))
        graph.until(lambda rotor=rotor: observer.rotor == rotor, 'the state')
        assert trip.ended() is ended
        assert trip.remark.endswith('going out' if second < 2 else 'coming back')
    assert 'the soliton is at rotor 1.5 now; raise the parameter nudge or' in trip.missing()


def test_a_rejected_nudge_ends_the_wait(graph):
    observer = graph.start(Observer)
    refusal = KeyValue(key='last rejection', value='/nudge: too fast')
    status = DiagnosticStatus(name='edge_actuator: chain', values=[refusal])
    graph.speak(interfaces.DIAGNOSTICS).publish(DiagnosticArray(status=[status]))
    graph.until(lambda: observer.reports, 'the report')
    with pytest.raises(RuntimeError, match='edge_actuator rejected /nudge: too fast'):
        RoundTrip(observer).ended()
