# SPDX-License-Identifier: Apache-2.0
"""If a callback raises, the node drops that message or call, logs one line and continues."""

import time
from typing import Any

from graphs import values
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import SERVICE_QOS, GuardedNode


class Clumsy(GuardedNode):
    """Node that fails on every message except positive numbers."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('clumsy', **kwargs)
        self.taken: list[float] = []
        self.ticks = 0
        self.diagnostics = Diagnostics(self, 'stumbling', lambda: Report('well'))
        self.create_subscription(Float64, 'nudge', self._on_message, 100)
        self.create_service(Trigger, '~/ask', self._on_call)
        self.create_timer(0.05, self._on_timer)
        self.declare_parameter('speed', 1.0)
        self.add_on_set_parameters_callback(lambda changes: changes[7])

    def _on_message(self, message: Float64) -> None:
        self.taken.append([message.data][0 if message.data > 0 else 1])

    def _on_call(self, _request: Any, _response: Any) -> Any:
        raise KeyError('nothing')

    def _on_timer(self) -> None:
        self.ticks += 1
        raise RuntimeError(f'tick {self.ticks}\nwas too much')


def test_a_message_whose_callback_raises_is_the_only_one_lost(graph, said):
    node = graph.start(Clumsy)
    publisher = graph.speak(interfaces.NUDGE)
    for number in (1.0, -1.0, 2.0):
        publisher.publish(Float64(data=number))
    graph.until(lambda: node.taken == [1.0, 2.0], 'the others')
    (line,) = [line for line in said().splitlines() if 'nudge' in line]
    assert 'could not process a message of nudge: IndexError: list index out of range' in line
    assert 'test_guarded.py:' in line


def test_a_call_that_fails_is_answered(graph):
    graph.start(Clumsy)
    response = graph.call(Trigger, 'clumsy/ask')
    assert not response.success
    assert response.message.startswith("could not answer ~/ask: KeyError: 'nothing'")


def test_a_timer_that_fails_continues_and_logs_one_line(graph, said):
    node = graph.start(Clumsy)
    graph.until(lambda: node.ticks > 5, 'more ticks')
    first, *others = [line for line in said().splitlines() if 'tick' in line]
    assert 'RuntimeError: tick 1 was too much' in first
    assert all('was too much' in line for line in others), 'each error is one line'
    status = graph.next_report('clumsy')
    assert int(values(status)['failed']) >= 5
    assert 'could not run a timer' in status.message


def test_a_timer_that_is_destroyed_when_it_is_due_calls_back_no_more(graph):
    node = graph.start(Clumsy)
    calls: list[str] = []

    def end(_request: Any, response: Any) -> Any:
        time.sleep(0.01)
        node.destroy_timer(timer)
        calls.clear()
        return response

    node.create_service(Trigger, '~/end', end)
    for _ in range(20):
        timer = node.create_timer(0.002, lambda: calls.append('again'))
        graph.until(lambda: calls, 'a call')
        graph.call(Trigger, 'clumsy/end')
        graph.until(lambda late=node.ticks + 1: node.ticks >= late, 'other timers')
        assert not calls


def test_an_invalid_parameter_is_rejected_with_the_reason(graph):
    graph.start(Clumsy)
    for name, reason in (
        ('speed', 'could not answer clumsy/set_parameters: IndexError'),
        ('sped', "parameter 'sped' of clumsy is unknown; did you mean 'speed'?"),
    ):
        (result,) = graph.change('clumsy', {name: 2.0})
        assert not result.successful
        assert reason in result.reason


def test_two_hundred_calls_at_once_are_all_answered(graph):
    graph.start(Clumsy)
    clients = [
        graph.user.create_client(Trigger, 'clumsy/ask', qos_profile=SERVICE_QOS) for _ in range(20)
    ]
    for client in clients:
        graph.until(client.service_is_ready, 'the service')
    answers = [client.call_async(Trigger.Request()) for client in clients for _ in range(10)]
    graph.until(lambda: all(answer.done() for answer in answers), 'all answers')
