# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy grants each node exactly the topics and services that it opens."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from graphs import Graph
from recordings import run_of, write_bag

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.chain_identifier.node import ChainIdentifier
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.serial_encoders.node import SerialEncoders
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering
from soliton_linkage_nodes.visualisation.node import Visualisation

POLICY = Path(__file__).parents[2] / 'config/security/policy.xml'
RULES = {
    'topics': ('publish', 'subscribe'),
    'services': ('reply', 'request'),
    'actions': ('call', 'execute'),
}
EXACT = (
    'edge_actuator',
    'soliton_analyser',
    'soliton_steering',
    'chain_identifier',
    'bag_recorder',
)
OPTIONAL = {('subscribe', '/clock'), ('publish', '/clock')}
OF_ACTIONS = ('cancel_goal', 'get_result', 'send_goal', 'feedback', 'status')

Rights = set[tuple[str, str]]


def enclaves() -> Iterator[tuple[str, ElementTree.Element]]:
    root = ElementTree.parse(POLICY).getroot()
    for enclave in root.findall('enclaves/enclave'):
        yield enclave.get('path', '').rpartition('/')[2], enclave


def allowed(enclave: ElementTree.Element) -> Rights:
    rights = set()
    for profile in enclave.findall('profiles/profile'):
        for group in profile:
            (how,) = group.attrib
            for item in group:
                name = (item.text or '').replace('~', f'/{profile.get("node")}')
                rights.add((how, name if name.startswith('/') else f'/{name}'))
    return rights


def opened(graph: Graph, node: str) -> Rights:
    """Return the endpoints of a node and of its hidden subscription node."""
    asked = {
        'publish': graph.user.get_publisher_names_and_types_by_node,
        'subscribe': graph.user.get_subscriber_names_and_types_by_node,
        'reply': graph.user.get_service_names_and_types_by_node,
        'request': graph.user.get_client_names_and_types_by_node,
    }
    inbox = f'_{node}_inbox'
    names = {name for name, _ in graph.user.get_node_names_and_namespaces()}
    found = {
        (how, topic)
        for each in {node, inbox} & names
        for how, names_of in asked.items()
        for topic, _ in names_of(each, '/')
    }
    return {right for how, topic in found for right in as_right(how, topic)}


def as_right(how: str, topic: str) -> Rights:
    """A right to a topic, or to the action that it belongs to."""
    action, _, part = topic.partition('/_action/')
    if not part:
        return {(how, topic)}
    assert part in OF_ACTIONS
    return {('execute' if how in ('publish', 'reply') else 'call', action)}


def test_the_policy_has_the_form_of_the_schema():
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.attrib) == ('policy', {'version': '0.2.0'})
    assert [child.tag for child in root] == ['enclaves']
    for _, enclave in enclaves():
        assert enclave.attrib.keys() == {'path'}
        for profile in enclave.findall('profiles/profile'):
            assert profile.attrib.keys() == {'ns', 'node'}
            for group in profile:
                assert group.attrib.items() <= {(rule, 'ALLOW') for rule in RULES[group.tag]}
                assert {item.tag for item in group} == {group.tag.removesuffix('s')}
    sros2 = pytest.importorskip('sros2.policy', reason='needs sros2: apt install ros-jazzy-sros2')
    sros2.load_policy(POLICY)


def test_nodes_open_what_the_policy_allows(graph, named, tmp_path, terminal):
    bag = write_bag(tmp_path / 'bag', run_of(named, 2))
    given: dict[Any, dict[str, Any]] = {
        Simulator: {'publish_clock': True},
        EdgeActuator: {},
        SolitonAnalyser: {},
        SolitonSteering: {},
        ChainIdentifier: {},
        BagRecorder: {'output': str(tmp_path / 'run')},
        Visualisation: {},
        BagPlayer: {'bag': str(bag), 'start_paused': True},
        SerialEncoders: {'port': terminal.path, 'chain_from': 'parameters'},
    }
    nodes = [graph.start(node, parameters).get_name() for node, parameters in given.items()]
    rights = {name: allowed(enclave) for name, enclave in enclaves()}

    def missing() -> dict[str, Rights]:
        unused = {node: rights[node] - opened(graph, node) - OPTIONAL for node in EXACT}
        return {node: left for node, left in unused.items() if left}

    graph.until(lambda: not missing(), 'the endpoints of the policy', missing)
    for node in nodes:
        assert set() < opened(graph, node) <= rights[node], node


def test_a_user_may_command_and_watch_all_that_there_is():
    rights = {name: allowed(enclave) for name, enclave in enclaves()}
    for topic in (*interfaces.SUITE_TOPICS, *interfaces.DISPLAY_TOPICS):
        assert ('subscribe', f'/{topic.name.lstrip("/")}') in rights['user']
    heard = {name for how, name in rights['edge_actuator'] if how == 'subscribe'}
    commands = heard - {f'/{n}' for n in ('chain', 'delivery', 'joint_states', 'clock')}
    assert {('publish', name) for name in commands} <= rights['user']
