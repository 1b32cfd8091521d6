# SPDX-License-Identifier: Apache-2.0
"""Orders are checked whole, and give the torques of their profile or of their chamber."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from soliton_linkage.actuation.edge_drive import EdgeDrive, EdgeLimits, EdgeOrder, Kind
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import trapezoid
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array

ACTUATOR = PneumaticActuator(filling_time=0.03, venting_time=0.05, saturation_torque=1.0)
LIMITS = EdgeLimits(speed=100.0, torque=0.1)
PERIOD = 0.004


def torques(drive: EdgeDrive, start: float, end: float) -> Array:
    """Return the mean torques over periods."""
    count = round((end - start) / PERIOD)
    starts = [start + PERIOD * number for number in range(count)]
    return np.array([drive.mean_torque(t, t + PERIOD).torque for t in starts])


@pytest.mark.parametrize('side', [Edge.FIRST, Edge.LAST])
@pytest.mark.parametrize('duration', [0.0005, 0.0301, 0.1])
@pytest.mark.parametrize('ramps', [(0.0, 0.0), (0.0017, 0.0), (0.02, 0.05)])
def test_a_pulse_gives_the_whole_of_its_impulse_however_short_it_is(
    ramps: tuple[float, float], duration: float, side: Edge
) -> None:
    drive = EdgeDrive(ACTUATOR)
    order = EdgeOrder(side, Kind.PULSE, -0.05, duration, *ramps)
    drive.obey(order, side, 1.0)
    given = torques(drive, 1.0, 1.3).sum() * PERIOD
    sense = 1 if side is Edge.FIRST else -1
    assert given == pytest.approx(-0.05 * sense * (duration + sum(ramps) / 2), rel=1e-9)
    assert not drive.active


@pytest.mark.parametrize('side', [Edge.FIRST, Edge.LAST])
def test_a_pressure_gives_the_torque_of_the_chamber(side: Edge) -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.obey(EdgeOrder(side, Kind.PRESSURE, 1e5, 0.1, 0.02, 0.03), side, 2.0)
    given = torques(drive, 2.0, 2.3)
    command = trapezoid(1e5, 0.02, 0.1, 0.03)
    integrals = [ACTUATOR.driven(0.0, command, 0.0, PERIOD * n)[1] for n in range(76)]
    sense = 1 if side is Edge.FIRST else -1
    expected = sense * ACTUATOR.torque_per_pressure * np.diff(integrals) / PERIOD
    np.testing.assert_allclose(given, expected, atol=1e-13)


def test_missed_frames_do_not_change_the_pressure_afterwards() -> None:
    drives = [EdgeDrive(ACTUATOR), EdgeDrive(ACTUATOR)]
    for drive in drives:
        drive.obey(EdgeOrder(Edge.FIRST, Kind.PRESSURE, 1e5, 0.1), Edge.FIRST, 0.0)
    torques(drives[0], 0.0, 0.2)
    late = [drive.mean_torque(0.2, 0.2 + PERIOD).torque for drive in drives]
    assert late[0] == pytest.approx(late[1], rel=1e-9)


def test_a_pressure_without_duration_is_held_until_it_is_vented() -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.obey(EdgeOrder(Edge.LAST, Kind.PRESSURE, 1e5), Edge.LAST, 0.0)
    held = drive.mean_torque(50.0, 50.0 + PERIOD)
    assert held.torque == pytest.approx(-1e5 * ACTUATOR.torque_per_pressure)
    assert not drive.unfinished(50.0)
    drive.obey(EdgeOrder(Edge.FIRST, Kind.PRESSURE, 0.0), Edge.FIRST, 51.0)
    area = torques(drive, 51.0, 52.0).sum() * PERIOD
    venting = -1e5 * ACTUATOR.torque_per_pressure * ACTUATOR.venting_time
    assert area == pytest.approx(venting, rel=1e-5)
    assert not drive.active
    assert drive.pressures == (0.0, 0.0)


def test_an_order_takes_the_place_of_the_last_one_which_vents() -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.obey(EdgeOrder(Edge.FIRST, Kind.PRESSURE, 1e5, 1.0), Edge.FIRST, 0.0)
    drive.mean_torque(0.4, 0.4 + PERIOD)
    assert drive.unfinished(0.5)
    drive.obey(EdgeOrder(Edge.LAST, Kind.PRESSURE, 5e4), Edge.LAST, 0.5)
    drive.mean_torque(0.5, 0.5 + PERIOD)
    drive.mean_torque(3.0, 3.0 + PERIOD)
    assert drive.pressures == (0.0, pytest.approx(5e4))
    drive.obey(EdgeOrder(Edge.FIRST, Kind.PULSE, 0.01, 0.1), Edge.FIRST, 3.1)
    venting = ACTUATOR.follow(5e4, 0.0, 0.0, PERIOD)[1] / PERIOD
    expected = 0.01 - ACTUATOR.torque_per_pressure * venting
    assert drive.mean_torque(3.1, 3.1 + PERIOD).torque == pytest.approx(expected)


def test_a_torque_beyond_saturation_is_not_given_and_that_is_said() -> None:
    actuator = PneumaticActuator(torque_per_pressure=1e-7, saturation_torque=0.005)
    drive = EdgeDrive(actuator)
    drive.obey(EdgeOrder(Edge.FIRST, Kind.PRESSURE, 1e5), Edge.FIRST, 0.0)
    first = drive.mean_torque(0.0, PERIOD)
    late = drive.mean_torque(1.0, 1.0 + PERIOD)
    assert (first.saturated, late.saturated) == (False, True)
    assert late.torque == 0.005


def test_dropping_ends_a_pulse_and_vents() -> None:
    drive = EdgeDrive(ACTUATOR)
    drive.obey(EdgeOrder(Edge.FIRST, Kind.PULSE, 0.05, 1.0), Edge.FIRST, 0.0)
    assert drive.unfinished(0.1)
    drive.drop(0.1)
    assert not drive.active
    assert not drive.unfinished(0.1)


@pytest.mark.parametrize(
    ('fields', 'complaint'),
    [
        ({'kind': Kind.KICK, 'duration': 0.5}, 'duration of a kick = 0.5 s must be 0'),
        ({'kind': Kind.KICK, 'ramp_up': math.nan}, 'ramp_up of a kick = nan s must be 0'),
        ({'kind': Kind.PULSE, 'duration': -1.0}, 'duration = -1 s must be a finite number'),
        ({'kind': Kind.PULSE, 'ramp_down': math.inf}, 'ramp_down = inf s must be a finite'),
        ({'kind': Kind.PRESSURE, 'ramp_up': math.nan}, 'ramp_up = nan s must be a finite'),
        ({'kind': Kind.PRESSURE, 'ramp_down': 0.1}, 'ramp_down = 0.1 s must be 0 for a pressure'),
        ({'kind': Kind.KICK, 'value': 101.0}, 'speed = 101 rad/s must lie in the range -100'),
        ({'kind': Kind.KICK, 'value': math.nan}, 'speed = nan rad/s must be a finite number'),
        ({'kind': Kind.PULSE, 'value': -0.2}, r'torque = -0.2 N m must lie .* raise torque_limit'),
        ({'kind': Kind.PRESSURE, 'value': 3e5}, 'pressure = 300000 Pa must lie in the range'),
    ],
)
def test_an_order_that_makes_no_sense_is_refused(fields: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        EdgeOrder(**{'edge': Edge.FIRST, 'value': 0.0, **fields}).check(LIMITS, ACTUATOR)


@pytest.mark.parametrize(
    ('order', 'instantaneous'),
    [
        (EdgeOrder(Edge.FIRST, Kind.KICK, 1.0), True),
        (EdgeOrder(Edge.FIRST, Kind.PULSE, 1.0), True),
        (EdgeOrder(Edge.FIRST, Kind.PULSE, 1.0, ramp_up=0.1), False),
        (EdgeOrder(Edge.FIRST, Kind.PULSE, 1.0, 0.1), False),
        (EdgeOrder(Edge.FIRST, Kind.PRESSURE, 1.0), False),
    ],
)
def test_kicks_and_pulses_without_a_time_are_impulses(
    order: EdgeOrder, instantaneous: bool
) -> None:
    assert order.instantaneous == instantaneous
