# SPDX-License-Identifier: Apache-2.0
"""Get and set the lifecycle state of nodes."""

from __future__ import annotations

import argparse

from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('lifecycle', __doc__)
    verbs.add('get', _get, 'print the state of a node').add_argument('node')
    setting = verbs.add('set', _set, 'request a transition of a node')
    setting.add_argument('node')
    setting.add_argument('transition', help='transition, such as configure or activate')
    return verbs.run(arguments)


def _get(visitor: Visitor, options: argparse.Namespace) -> None:
    state = visitor.call_node(options.node, GetState).current_state
    print(f'{state.label} [{state.id}]')


def _set(visitor: Visitor, options: argparse.Namespace) -> None:
    answer = visitor.call_node(options.node, GetAvailableTransitions)
    known = [each.transition for each in answer.available_transitions]
    chosen = [each for each in known if options.transition in (each.label, str(each.id))]
    if not chosen:
        available = ', '.join(f'{each.label} [{each.id}]' for each in known)
        raise RuntimeError(
            f'Unknown transition {options.transition!r} requested, available ones are: {available}'
        )
    if not visitor.call_node(options.node, ChangeState, transition=chosen[0]).success:
        raise RuntimeError(f'Transitioning failed; the log of {options.node} has the reason')
    print('Transitioning successful')
