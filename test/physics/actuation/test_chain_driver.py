# SPDX-License-Identifier: Apache-2.0
"""Commands start at the next frame, and their torques end even if frames are missing."""

from dataclasses import replace

import numpy as np
import pytest

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.chain_driver import ChainDriver
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.kick_record import KickReport
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain

PERIOD = 10_000_000
PULSE = EdgeCommand(Edge.FIRST, CommandKind.PULSE, 1e-3, 0.05)


class Desk:
    def __init__(self) -> None:
        self.reports: list[KickReport] = []
        chain = Chain(number_of_rotors=8)
        self.driver = ChainDriver(chain, PneumaticActuator(), 0.5, 0.2, self.reports.append)
        self.angles = chain.uniform_state(-1)
        self.stamp = 10**18

    def frame(self, step: int = PERIOD) -> float | None:
        """Return the size of the torques that go with the next frame, if any do."""
        before, self.stamp = self.stamp, self.stamp + step
        torques = self.driver.frame(before, self.stamp, self.angles)
        return None if torques is None else float(np.linalg.norm(torques))

    def torques(self, count: int) -> list[float | None]:
        return [self.frame() for _ in range(count)]


@pytest.fixture
def desk():
    return Desk()


def test_a_command_starts_at_the_next_frame_and_ends_with_zero_torques(desk):
    assert not desk.driver.busy
    desk.driver.command('edge_command', PULSE, Edge.FIRST)
    assert desk.driver.busy
    assert desk.torques(7) == [pytest.approx(1e-3)] * 5 + [0.0, None]
    (kick,) = desk.reports
    assert np.linalg.norm(kick.impulse) == pytest.approx(1e-3 * 0.05)
    assert kick.duration == pytest.approx(0.05)
    assert (kick.cut_short, kick.measured) == (False, False)
    assert not desk.driver.busy


def test_a_command_that_replaces_another_is_reported_separately(desk):
    desk.driver.command('edge_command', PULSE, Edge.FIRST)
    desk.torques(2)
    desk.driver.command('nudge', PULSE, Edge.FIRST)
    desk.torques(8)
    assert [(kick.source, kick.cut_short) for kick in desk.reports] == [
        ('edge_command', True),
        ('nudge', False),
    ]
    impulses = [np.linalg.norm(kick.impulse) for kick in desk.reports]
    assert impulses == [pytest.approx(2e-5), pytest.approx(5e-5)]


@pytest.mark.parametrize('duration', [0.05, 1.2])
def test_a_long_gap_between_frames_cuts_the_torques_short(desk, duration):
    desk.driver.command('edge_command', replace(PULSE, duration=duration), Edge.FIRST)
    desk.torques(2)
    desk.frame(step=10**9)
    desk.torques(25)
    (kick,) = desk.reports
    assert kick.cut_short


def test_decreasing_stamps_end_all_commands(desk):
    desk.driver.command('edge_command', PULSE, Edge.FIRST)
    desk.torques(2)
    with pytest.raises(ValueError, match='all torques are dropped'):
        desk.frame(step=-(10**9))
    assert not desk.driver.driving
    assert desk.torques(4)[-1] is None
    assert [kick.cut_short for kick in desk.reports] == [True]
    desk.driver.command('edge_command', PULSE, Edge.FIRST)
    assert desk.torques(6) == [pytest.approx(1e-3)] * 5 + [0.0]


def test_a_repeated_stamp_is_rejected_and_commands_stay_active(desk):
    desk.driver.command('edge_command', PULSE, Edge.FIRST)
    desk.torques(2)
    with pytest.raises(ValueError, match='must be later than the previous one'):
        desk.frame(step=0)
    assert desk.torques(4) == [pytest.approx(1e-3)] * 3 + [0.0]


def test_an_abandoned_driver_reports_its_torques_as_cut_short(desk):
    desk.driver.hold('~/commands', np.array([2]), np.array([1e-3]))
    desk.torques(5)
    desk.driver.abandon()
    (kick,) = desk.reports
    assert (kick.source, kick.command, kick.cut_short) == ('~/commands', None, True)
    np.testing.assert_allclose(kick.impulse[2], 1e-3 * 0.03)
