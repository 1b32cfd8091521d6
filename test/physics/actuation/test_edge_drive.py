# SPDX-License-Identifier: Apache-2.0
"""Commands give the torques of their profile or of their actuator."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.edge_drive import EdgeDrive
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import trapezoid
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array

ACTUATOR = PneumaticActuator(filling_time=0.03, venting_time=0.05, saturation_torque=1.0)
PERIOD = 0.004


def torques(drive: EdgeDrive, start: float, end: float) -> Array:
    """Return the mean torques over periods."""
    count = round((end - start) / PERIOD)
    starts = [start + PERIOD * number for number in range(count)]
    return np.array([drive.mean_torque(t, t + PERIOD).torque for t in starts])


@pytest.mark.parametrize('side', [Edge.FIRST, Edge.LAST])
@pytest.mark.parametrize('duration', [0.0005, 0.0301])
@pytest.mark.parametrize('ramps', [(0.0, 0.0), (0.0017, 0.0), (0.02, 0.05)])
def test_a_pulse_gives_the_whole_of_its_impulse_however_short_it_is(
    ramps: tuple[float, float], duration: float, side: Edge
) -> None:
    drive = EdgeDrive(ACTUATOR)
    command = EdgeCommand(side, CommandKind.PULSE, -0.05, duration, *ramps)
    drive.command(command, side, 1.0)
    given = torques(drive, 1.0, 1.3).sum() * PERIOD
    sense = 1 if side is Edge.FIRST else -1
    assert given == pytest.approx(-0.05 * sense * (duration + sum(ramps) / 2), rel=1e-9)
    assert not drive.active


@pytest.mark.parametrize('side', [Edge.FIRST, Edge.LAST])
def test_a_pressure_gives_the_torque_of_the_chamber(side: Edge) -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(side, CommandKind.PRESSURE, 1e5, 0.1, 0.02, 0.03), side, 2.0)
    given = torques(drive, 2.0, 2.3)
    command = trapezoid(1e5, 0.02, 0.1, 0.03)
    integrals = [ACTUATOR.driven(0.0, command, 0.0, PERIOD * n)[1] for n in range(76)]
    sense = 1 if side is Edge.FIRST else -1
    expected = sense * ACTUATOR.torque_per_pressure * np.diff(integrals) / PERIOD
    np.testing.assert_allclose(given, expected, atol=1e-13)


def test_missed_frames_do_not_change_the_pressure_afterwards() -> None:
    drives = [EdgeDrive(ACTUATOR), EdgeDrive(ACTUATOR)]
    for drive in drives:
        drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 0.1), Edge.FIRST, 0.0)
    torques(drives[0], 0.0, 0.2)
    late = [drive.mean_torque(0.2, 0.2 + PERIOD).torque for drive in drives]
    assert late[0] == pytest.approx(late[1], rel=1e-9)


def test_a_pressure_without_duration_is_held_until_it_is_vented() -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(Edge.LAST, CommandKind.PRESSURE, 1e5), Edge.LAST, 0.0)
    held = drive.mean_torque(50.0, 50.0 + PERIOD)
    assert held.torque == pytest.approx(-1e5 * ACTUATOR.torque_per_pressure)
    assert not drive.unfinished(50.0)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 0.0), Edge.FIRST, 51.0)
    area = torques(drive, 51.0, 52.0).sum() * PERIOD
    venting = -1e5 * ACTUATOR.torque_per_pressure * ACTUATOR.venting_time
    assert area == pytest.approx(venting, rel=1e-5)
    assert not drive.active
    assert drive.levels == (0.0, 0.0)


def test_a_command_takes_the_place_of_the_last_one_which_vents() -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 1.0), Edge.FIRST, 0.0)
    drive.mean_torque(0.4, 0.4 + PERIOD)
    assert drive.unfinished(0.5)
    drive.command(EdgeCommand(Edge.LAST, CommandKind.PRESSURE, 5e4), Edge.LAST, 0.5)
    drive.mean_torque(0.5, 0.5 + PERIOD)
    drive.mean_torque(3.0, 3.0 + PERIOD)
    assert drive.levels == (0.0, pytest.approx(5e4))
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.01, 0.1), Edge.FIRST, 3.1)
    venting = ACTUATOR.follow(5e4, 0.0, 0.0, PERIOD)[1] / PERIOD
    expected = 0.01 - ACTUATOR.torque_per_pressure * venting
    assert drive.mean_torque(3.1, 3.1 + PERIOD).torque == pytest.approx(expected)


def test_a_torque_beyond_saturation_is_not_given_and_that_is_said() -> None:
    actuator = PneumaticActuator(torque_per_pressure=1e-7, saturation_torque=0.005)
    drive = EdgeDrive(actuator)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5), Edge.FIRST, 0.0)
    first = drive.mean_torque(0.0, PERIOD)
    late = drive.mean_torque(1.0, 1.0 + PERIOD)
    assert (first.saturated, late.saturated) == (False, True)
    assert late.torque == 0.005


def test_dropping_ends_a_pulse_and_vents() -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.05, 1.0), Edge.FIRST, 0.0)
    assert drive.unfinished(0.1)
    drive.drop(0.1)
    assert not drive.active
    assert not drive.unfinished(0.1)
