# SPDX-License-Identifier: Apache-2.0
"""A node reports once a second, counts rejected input and logs each kind once."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from graphs import values
from rclpy.node import Node

from soliton_linkage_nodes.runtime import diagnostics
from soliton_linkage_nodes.runtime.diagnostics import MOST_LINES, Diagnostics, LogThrottle, Report


class Reporter(Node):
    """Reports what the test puts into it."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__('reporter', namespace='/lab', **kwargs)
        self.report = Report('well', {'speed [rad/s]': 1.0 / 3.0, 'turns': 7})
        self.diagnostics = Diagnostics(self, 'turning', lambda: self.report)


@pytest.fixture
def reporter(graph):
    return graph.start(Reporter)


def test_it_reports_once_a_second_whatever_the_clock_of_ros_does(reporter):
    (timer,) = reporter.timers
    assert timer.timer_period_ns == 10**9
    assert timer.clock.clock_type.name == 'STEADY_TIME'


def test_a_report_names_node_and_task_and_holds_the_figures(graph, reporter):
    status = graph.next_report('reporter')
    assert (status.name, status.hardware_id) == ('reporter: turning', '/lab/reporter')
    assert (status.level, status.message) == (DiagnosticStatus.OK, 'well')
    assert values(status) == {
        'speed [rad/s]': '0.333333',
        'turns': '7',
        'rejected': '0',
        'last rejection': '',
    }


def test_a_warning_of_the_node_is_a_warning(graph, reporter):
    reporter.report = Report('late', warning=True)
    status = graph.next_report('reporter')
    assert (status.level, status.message) == (DiagnosticStatus.WARN, 'late')


def test_rejections_warn_in_the_next_report_and_stay_counted(graph, reporter):
    heard = graph.reports('reporter')
    graph.until(lambda: heard, 'a report')
    reporter.diagnostics.reject('nudge', ValueError('speed = nan'))
    reporter.diagnostics.reject('nudge', ValueError('speed = inf'))
    graph.until(lambda: len(heard) >= 3, 'two more reports')
    _, warning, later = heard[:3]
    assert (warning.level, later.level) == (DiagnosticStatus.WARN, DiagnosticStatus.OK)
    assert warning.message == '2 rejected: nudge: speed = inf'
    assert later.message == 'well'
    assert values(later)['rejected'] == '2'
    assert values(later)['last rejection'] == 'nudge: speed = inf'


def test_a_flood_of_rejections_is_counted_and_logged_in_one_line(reporter, capfd):
    for _ in range(1000):
        reporter.diagnostics.reject('nudge', 'speed = nan rad/s must be a finite number')
    assert reporter.diagnostics.rejected == 1000
    (line,) = capfd.readouterr().err.splitlines()
    assert line.endswith('rejected nudge: speed = nan rad/s must be a finite number')


def test_invalid_messages_are_rejected_and_valid_ones_processed(reporter):
    take = reporter.diagnostics.guarded('numbers', float)
    for text in ('1.5', 'one', '2'):
        take(text)
    assert reporter.diagnostics.rejected == 1
    divide = reporter.diagnostics.guarded('numbers', lambda number: 1 / number)
    divide(0)
    assert reporter.diagnostics.rejected == 2


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(diagnostics.time, 'monotonic', lambda: now[0])
    return now


@pytest.mark.usefixtures('clock')
def test_each_reason_gets_a_line():
    said: list[str] = []
    throttle = LogThrottle(said.append, 1.0)
    reasons = [f'nudge: {chr(97 + n)} is wrong' for n in range(26)]
    for reason in reasons:
        throttle.log(reason)
    assert said == reasons


def test_a_reason_with_other_numbers_is_the_same_until_a_while_is_over(clock):
    said: list[str] = []
    throttle = LogThrottle(said.append, 1.0)
    for speed in range(1000):
        throttle.log(f'speed = {speed}.5e-3 rad/s of rotor_{speed} is too fast')
    clock[0] += 1.0
    throttle.log('speed = inf rad/s of rotor_3 is too fast')
    assert said == [
        'speed = 0.5e-3 rad/s of rotor_0 is too fast',
        'speed = inf rad/s of rotor_3 is too fast (and 999 more of this kind)',
    ]


def test_a_flood_of_reasons_is_bounded_in_lines_and_memory(clock):
    said: list[str] = []
    throttle = LogThrottle(said.append, 1.0)
    names = [''.join(chr(97 + n // 26**k % 26) for k in range(4)) for n in range(20_000)]
    for name in names:
        throttle.log(f'no joint {name}')
    assert len(said) == MOST_LINES
    assert len(throttle) <= MOST_LINES
    clock[0] += 1.0
    throttle.log('no joint at all')
    assert said[MOST_LINES] == (
        f'no joint at all (and {20_000 - MOST_LINES} other messages in the previous second)'
    )
