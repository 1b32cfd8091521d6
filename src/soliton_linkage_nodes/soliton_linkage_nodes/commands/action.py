# SPDX-License-Identifier: Apache-2.0
"""List actions, and send goals to them."""

from __future__ import annotations

import argparse
import math
import signal
import threading
from textwrap import indent
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, get_action_names_and_types

from soliton_linkage_nodes.commands.visitor import ANSWER_LIMIT, Verbs, Visitor
from soliton_linkage_nodes.messages.fields import interface_type, read, to_yaml
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS

_STATUS = {
    getattr(GoalStatus, f'STATUS_{name}'): name for name in ('SUCCEEDED', 'CANCELED', 'ABORTED')
}


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('action', __doc__)
    verbs.add_list(get_action_names_and_types, 'print the names of all actions')
    summary = 'send a goal and print its result; Ctrl-C cancels it'
    send = verbs.add('send_goal', _send_goal, summary)
    send.add_argument('action')
    send.add_argument('type', help='type, such as soliton_linkage_msgs/action/MoveSoliton')
    send.add_argument(
        'goal', nargs='?', default='{}', help="goal in YAML, such as '{rotor: 12.5}'"
    )
    send.add_argument('-f', '--feedback', action='store_true', help='also print the feedback')
    return verbs.run(arguments)


def _send_goal(visitor: Visitor, options: argparse.Namespace) -> int:
    action_type = interface_type(options.type, 'action')
    goal = read(action_type.Goal, options.goal)
    client = ActionClient(visitor.node, action_type, options.action, **ACTION_QOS)
    print('Waiting for an action server to become available...', flush=True)
    if not visitor.until(client.server_is_ready):
        raise RuntimeError(
            f'there is no action {options.action} of the type {options.type}; '
            'list all with: soliton-linkage action list -t'
        )
    interrupted = _note_interrupt()
    _print('Sending goal', goal)
    show = (lambda each: _print('Feedback', each.feedback)) if options.feedback else None
    sent = client.send_goal_async(goal, feedback_callback=show)
    if not visitor.until(sent.done, ANSWER_LIMIT):
        raise RuntimeError(f'{options.action} gave no response within {ANSWER_LIMIT:g} s')
    handle = sent.result()
    if not handle.accepted:
        raise RuntimeError('Goal was rejected.')
    print(f'Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n', flush=True)
    ended = handle.get_result_async()

    def over() -> bool:
        return ended.done() or not client.server_is_ready()

    visitor.until(lambda: over() or interrupted.is_set(), math.inf)
    if interrupted.is_set() and not over():
        print('Canceling goal...', flush=True)
        handle.cancel_goal_async()
        visitor.until(over, math.inf)
    if not ended.done():
        raise RuntimeError(f'{options.action} has stopped without a result')
    status = ended.result().status
    _print('Result', ended.result().result)
    print(f'Goal finished with status: {_STATUS.get(status, status)}')
    if interrupted.is_set():
        return int(signal.SIGINT)
    return int(status != GoalStatus.STATUS_SUCCEEDED)


def _note_interrupt() -> threading.Event:
    """Return an event that the first Ctrl-C sets; the second one raises KeyboardInterrupt.

    The first Ctrl-C raises no exception, because an exception inside rclpy's executor could block
    later callbacks.
    """
    interrupted = threading.Event()

    def note(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        interrupted.set()

    signal.signal(signal.SIGINT, note)
    return interrupted


def _print(title: str, message: Any) -> None:
    print(f'{title}:\n{indent(to_yaml(message), "    ")}', flush=True)
