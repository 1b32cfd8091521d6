# SPDX-License-Identifier: Apache-2.0
"""List nodes."""

from __future__ import annotations

import argparse

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor


def main(arguments: list[str]) -> int:
    """Run the verb; return its exit code."""
    verbs = Verbs('node', __doc__)
    verbs.add('list', _list, 'print the names of all nodes')
    return verbs.run(arguments)


def _list(visitor: Visitor, _: argparse.Namespace) -> None:
    for name, namespace in sorted(visitor.settled(visitor.node.get_node_names_and_namespaces)):
        if name != visitor.node.get_name():
            print(f'{namespace.rstrip("/")}/{name}')
