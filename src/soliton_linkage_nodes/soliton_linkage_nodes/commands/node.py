# SPDX-License-Identifier: Apache-2.0
"""List nodes, and show their topics, services and actions."""

from __future__ import annotations

import argparse

from rclpy.action import (
    get_action_client_names_and_types_by_node,
    get_action_server_names_and_types_by_node,
)
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor, full_name


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('node', __doc__)
    verbs.add('list', _list, 'print the names of all nodes')
    info = verbs.add('info', _info, 'print the topics, services and actions of a node')
    info.add_argument('node')
    return verbs.run(arguments)


def _list(visitor: Visitor, _: argparse.Namespace) -> None:
    for name, namespace in sorted(visitor.settled(visitor.node.get_node_names_and_namespaces)):
        if not (name == visitor.node.get_name() or name.startswith('_')):
            print(f'{namespace.rstrip("/")}/{name}')


def _info(visitor: Visitor, options: argparse.Namespace) -> None:
    node, wanted = visitor.node, full_name(options.node)
    namespace, _, name = wanted.rpartition('/')
    key = (name, namespace or '/')
    if not visitor.until(lambda: key in node.get_node_names_and_namespaces()):
        raise RuntimeError(f'there is no node {wanted}; list all with: soliton-linkage node list')
    found = visitor.settled(
        lambda: {
            'Subscribers': node.get_subscriber_names_and_types_by_node(*key),
            'Publishers': node.get_publisher_names_and_types_by_node(*key),
            'Service Servers': node.get_service_names_and_types_by_node(*key),
            'Service Clients': node.get_client_names_and_types_by_node(*key),
            'Action Servers': get_action_server_names_and_types_by_node(node, *key),
            'Action Clients': get_action_client_names_and_types_by_node(node, *key),
        }
    )
    print(wanted)
    for title, entries in found.items():
        print(f'  {title}:')
        for entry, types in sorted(entries):
            if not topic_or_service_is_hidden(entry):
                print(f'    {entry}: {", ".join(types)}')
