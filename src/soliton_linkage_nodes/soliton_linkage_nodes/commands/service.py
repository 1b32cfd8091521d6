# SPDX-License-Identifier: Apache-2.0
"""List services, and call them."""

from __future__ import annotations

import argparse

from rclpy.node import Node

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor
from soliton_linkage_nodes.messages.fields import interface_type, read, to_yaml


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('service', __doc__)
    verbs.add_list(Node.get_service_names_and_types, 'print the names of all services')
    call = verbs.add('call', _call, 'call a service and print its response as YAML')
    call.add_argument('service')
    call.add_argument('type', help='type, such as std_srvs/srv/SetBool')
    call.add_argument(
        'values', nargs='?', default='{}', help="request in YAML, such as '{data: true}'"
    )
    return verbs.run(arguments)


def _call(visitor: Visitor, options: argparse.Namespace) -> None:
    service_type = interface_type(options.type, 'srv')
    request = read(service_type.Request, options.values)
    print(to_yaml(visitor.call(service_type, options.service, request)), end='')
