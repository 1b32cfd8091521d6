# SPDX-License-Identifier: Apache-2.0
"""Each kick is reported once, with its source, impulse and work, sent or measured."""

import numpy as np
import pytest

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.kick_record import DeliveryTotals, KickRecord, KickReport
from soliton_linkage.linear.rigidity import Edge

PERIOD = 10_000_000
KICK = EdgeCommand(Edge.FIRST, CommandKind.KICK, 3.0)
PULSE = EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.01, 0.1)
TORQUES = np.array([1.0, -2.0])
IMPULSES = np.array([0.5, 0.0])


class Desk:
    def __init__(self, measured: bool) -> None:
        self.reports: list[KickReport] = []
        self.now = 0.0
        self.record = KickRecord(2, self.reports.append, 0.5, lambda: self.now)
        self.record.measured = measured

    def frame(self, number: int) -> None:
        """Record a frame of rotors that turn by 0.1 and 0.3 rad per period."""
        self.record.frame(number * PERIOD, number * np.array([0.1, 0.3]))

    def frames(self, *numbers: int) -> None:
        """Record frames that arrive one period after the other."""
        for number in range(*numbers):
            self.now += PERIOD / 1e9
            self.frame(number)

    def deliver(self, number: int, **fields: object) -> None:
        nothing = {
            'impulses': 0,
            'work_of_impulses': 0.0,
            'torques_act': False,
            'work_of_torques': 0.0,
            'impulse_of_torques': np.zeros(2),
        }
        self.record.deliver(DeliveryTotals(stamp=number * PERIOD, **{**nothing, **fields}))


def test_unmeasured_torques_act_a_frame_after_they_were_sent():
    desk = Desk(measured=False)
    for number in range(6):
        desk.frame(number)
        if number == 1:
            desk.record.begin(PERIOD, 'edge_command', PULSE)
        if number in (1, 2):
            desk.record.sent(number * TORQUES, saturated=number == 2)
        if number == 3:
            desk.record.end(3 * PERIOD, cut_short=False)
            assert desk.reports == []
    (kick,) = desk.reports
    np.testing.assert_allclose(kick.impulse, 3 * 0.01 * TORQUES)
    assert kick.work == pytest.approx(3 * float(TORQUES @ [0.1, 0.3]))
    assert kick.peak_torque == pytest.approx(2 * np.sqrt(5))
    assert kick.duration == pytest.approx(0.02)
    assert (kick.stamp, kick.source, kick.command) == (PERIOD, 'edge_command', PULSE)
    assert (kick.saturated, kick.cut_short, kick.measured) == (True, False, False)
    assert not desk.record.open


def test_measured_torques_are_reported_with_the_difference_of_the_totals():
    desk = Desk(measured=True)
    desk.deliver(0, work_of_torques=5.0, impulse_of_torques=np.array([1.0, 1.0]))
    desk.frame(1)
    desk.record.begin(PERIOD, 'edge_command', PULSE)
    desk.record.sent(TORQUES, saturated=False)
    desk.frame(2)
    desk.record.end(2 * PERIOD, cut_short=True)
    desk.deliver(3, torques_act=True, work_of_torques=6.0)
    assert desk.reports == []
    desk.deliver(4, work_of_torques=7.5, impulse_of_torques=np.array([1.5, 4.0]))
    (kick,) = desk.reports
    assert kick.work == 2.5
    np.testing.assert_array_equal(kick.impulse, [0.5, 3.0])
    assert (kick.cut_short, kick.measured) == (True, True)


def test_an_episode_that_ends_with_torques_of_zero_does_not_wait_for_further_totals():
    desk = Desk(measured=True)
    desk.deliver(0)
    desk.frame(1)
    desk.record.begin(PERIOD, '~/trajectory', None)
    for number, torques in enumerate([TORQUES, 0 * TORQUES, 0 * TORQUES, 0 * TORQUES], start=1):
        desk.record.sent(torques, saturated=False)
        desk.frame(number + 1)
        if number == 2:
            desk.deliver(3, torques_act=True, work_of_torques=1.0)
        if number == 3:
            desk.deliver(4, work_of_torques=1.5)
    desk.record.end(5 * PERIOD)
    assert desk.reports == []
    desk.frame(6)
    (kick,) = desk.reports
    assert (kick.work, kick.measured, kick.cut_short) == (1.5, True, False)
    assert not desk.record.open


def test_a_command_that_replaces_another_splits_the_totals_at_its_frame():
    desk = Desk(measured=True)
    desk.frame(1)
    desk.record.begin(PERIOD, 'edge_command', PULSE)
    desk.record.sent(TORQUES, saturated=False)
    desk.deliver(2, torques_act=True, work_of_torques=1.0)
    desk.frame(2)
    desk.record.end(2 * PERIOD, cut_short=True, superseded=True)
    desk.record.begin(2 * PERIOD, 'nudge', PULSE)
    desk.record.sent(TORQUES, saturated=False)
    desk.deliver(3, torques_act=True, work_of_torques=3.0)
    desk.frame(3)
    desk.record.end(3 * PERIOD, cut_short=False)
    desk.deliver(4, torques_act=True, work_of_torques=4.0)
    desk.deliver(5, work_of_torques=4.5)
    assert [(kick.source, kick.work) for kick in desk.reports] == [
        ('edge_command', 3.0),
        ('nudge', 1.5),
    ]


def test_sources_of_one_episode_are_reported_together():
    desk = Desk(measured=False)
    desk.frame(1)
    for source, asked in (('edge_command', PULSE), ('~/commands', None), ('~/commands', None)):
        desk.record.begin(PERIOD, source, asked)
    desk.record.abandon(PERIOD)
    (kick,) = desk.reports
    assert (kick.source, kick.command, kick.cut_short) == ('edge_command, ~/commands', PULSE, True)


def test_an_unmeasured_kick_is_reported_immediately():
    desk = Desk(measured=False)
    desk.record.kicked(PERIOD, 'nudge', KICK, IMPULSES, 0.75)
    (kick,) = desk.reports
    assert (kick.work, kick.command, kick.measured, kick.peak_torque) == (0.75, KICK, False, 0.0)
    np.testing.assert_array_equal(kick.impulse, IMPULSES)


def test_a_measured_kick_is_reported_with_its_own_work_while_torques_act():
    desk = Desk(measured=True)
    desk.deliver(0, impulses=7, work_of_impulses=2.0)
    desk.record.kicked(PERIOD, 'nudge', KICK, IMPULSES, 0.75)
    desk.deliver(1, impulses=7, work_of_impulses=2.0, torques_act=True, work_of_torques=9.0)
    assert desk.reports == []
    desk.deliver(2, impulses=8, work_of_impulses=2.8, torques_act=True, work_of_torques=9.5)
    (kick,) = desk.reports
    assert kick.work == pytest.approx(0.8)
    assert kick.measured


def test_kicks_of_one_frame_are_reported_together():
    desk = Desk(measured=True)
    desk.deliver(0)
    for number in range(3):
        desk.record.kicked(PERIOD, 'nudge', KICK, (number + 1) * IMPULSES, 0.1)
    desk.deliver(1, impulses=2, work_of_impulses=1.0)
    desk.deliver(2, impulses=3, work_of_impulses=1.5)
    assert [kick.work for kick in desk.reports] == [1.0, 0.5]
    np.testing.assert_array_equal(desk.reports[0].impulse, 3 * IMPULSES)


def test_a_kick_that_is_never_measured_is_reported_without_impulse():
    desk = Desk(measured=True)
    desk.record.kicked(PERIOD, 'nudge', KICK, IMPULSES, 0.75)
    desk.frames(1, 60)
    (kick,) = desk.reports
    assert (kick.work, kick.cut_short, kick.measured) == (0.0, True, True)
    assert not kick.impulse.any()


def test_torques_without_further_totals_are_reported_up_to_the_last_ones():
    desk = Desk(measured=True)
    desk.deliver(0, work_of_torques=1.0)
    desk.frame(1)
    desk.record.begin(PERIOD, 'nudge', PULSE)
    desk.record.sent(TORQUES, saturated=False)
    desk.deliver(1, torques_act=True, work_of_torques=1.5)
    desk.frame(2)
    desk.record.end(2 * PERIOD, cut_short=False)
    desk.frames(3, 60)
    (kick,) = desk.reports
    assert (kick.work, kick.measured) == (0.5, True)


def test_frames_that_arrive_all_at_once_do_not_end_the_wait_for_the_totals():
    desk = Desk(measured=True)
    desk.deliver(0)
    desk.frame(1)
    desk.record.begin(PERIOD, 'nudge', PULSE)
    desk.record.sent(TORQUES, saturated=False)
    desk.record.kicked(PERIOD, 'nudge', KICK, IMPULSES, 0.75)
    desk.frame(2)
    desk.record.end(2 * PERIOD)
    for number in range(3, 300):
        desk.frame(number)
    assert desk.reports == []
    desk.deliver(2, torques_act=True, impulses=1, work_of_impulses=0.7, work_of_torques=1.5)
    desk.deliver(3, impulses=1, work_of_impulses=0.7, work_of_torques=2.25)
    assert [kick.work for kick in desk.reports] == [0.7, 2.25]
    assert not any(kick.cut_short for kick in desk.reports)


def test_a_paused_chain_does_not_end_the_wait_for_the_totals():
    desk = Desk(measured=True)
    desk.deliver(0)
    desk.frame(1)
    desk.record.kicked(PERIOD, 'nudge', KICK, IMPULSES, 0.75)
    desk.now += 3600.0
    desk.frame(2)
    assert desk.reports == []
    desk.deliver(2, impulses=1, work_of_impulses=0.7)
    assert [kick.work for kick in desk.reports] == [0.7]
