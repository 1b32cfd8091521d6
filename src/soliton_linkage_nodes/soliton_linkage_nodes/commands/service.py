# SPDX-License-Identifier: Apache-2.0
"""List services, and call them."""

from __future__ import annotations

import argparse

from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor
from soliton_linkage_nodes.messages.fields import interface_type, read, to_yaml


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('service', __doc__)
    listing = verbs.add('list', _list, 'print the names of all services')
    listing.add_argument('-t', '--show-types', action='store_true', help='also print the types')
    call = verbs.add('call', _call, 'call a service and print its response as YAML')
    call.add_argument('service')
    call.add_argument('type', help='type, such as std_srvs/srv/SetBool')
    call.add_argument(
        'values', nargs='?', default='{}', help="request in YAML, such as '{data: true}'"
    )
    return verbs.run(arguments)


def _list(visitor: Visitor, options: argparse.Namespace) -> None:
    for name, types in sorted(visitor.settled(visitor.node.get_service_names_and_types)):
        own = name.startswith(f'/{visitor.node.get_name()}/')
        if not (own or topic_or_service_is_hidden(name)):
            print(f'{name} [{", ".join(types)}]' if options.show_types else name)


def _call(visitor: Visitor, options: argparse.Namespace) -> None:
    service_type = interface_type(options.type, 'srv')
    request = read(service_type.Request, options.values)
    print(to_yaml(visitor.call(service_type, options.service, request)), end='')
