# SPDX-License-Identifier: Apache-2.0
"""An actuator from outside needs a dataclass and a line in the registry, and drives the chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from soliton_linkage.actuation.actuator import ACTUATORS, Actuator, actuator_type
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand, EdgeLimits
from soliton_linkage.actuation.edge_drive import EdgeDrive
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import Profile
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.linear.rigidity import Edge, mode_towards_last
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import quantity

PERIOD = 0.004
HALF_A_SECOND = EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 2.0, 0.5)


@dataclass(frozen=True)
class DirectDrive:
    """A motor whose current is there as soon as it is commanded [A]."""

    torque_constant: float = quantity(1e-3, 'torque of a current', 'N m/A', 0.0)
    highest_current: float = quantity(5.0, 'largest current', 'A', 0.0)

    def check_command(self, command: float) -> None:
        if not abs(command) <= self.highest_current:
            raise ValueError(f'current = {command:g} A must be at most {self.highest_current:g} A')

    def driven(
        self, level: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        return float(command.before(end)), float(command.integral(start, end))

    def torque(self, level: float) -> float:
        return self.torque_constant * level

    def saturates(self, level: float) -> bool:
        return False

    def pulse_command(self, impulse: float, duration: float) -> float:
        return impulse / (self.torque_constant * duration)


@pytest.fixture
def motor(monkeypatch: pytest.MonkeyPatch) -> Actuator:
    monkeypatch.setitem(ACTUATORS, 'direct_drive', DirectDrive)
    return actuator_type('direct_drive')()


def test_an_actuator_is_chosen_by_its_name() -> None:
    assert actuator_type('pneumatic') is PneumaticActuator
    with pytest.raises(ValueError, match="actuator = 'steam' must be one of 'pneumatic'"):
        actuator_type('steam')


def test_another_actuator_gives_the_torque_that_it_is_commanded(motor: Actuator) -> None:
    drive = EdgeDrive(motor)
    drive.command(HALF_A_SECOND, Edge.FIRST, 1.0)
    given = [drive.mean_torque(t, t + PERIOD).torque for t in 1 + PERIOD * np.arange(150)]
    np.testing.assert_allclose(given[:125], 2e-3, rtol=1e-9)
    np.testing.assert_allclose(given[125:], 0.0, atol=1e-15)
    assert not drive.active


def test_another_actuator_acts_along_the_zero_mode(motor: Actuator) -> None:
    chain = Chain(number_of_rotors=6)
    angles = chain.uniform_state(-1)
    drive = TorqueDrive(chain, motor, 0.0)
    drive.edges.command(HALF_A_SECOND, Edge.FIRST, 0.0)
    expected = 2e-3 * mode_towards_last(chain, angles)
    np.testing.assert_allclose(drive.torques(angles, 0.0, PERIOD).torques, expected, rtol=1e-12)


def test_another_actuator_says_what_it_can_be_asked_for(motor: Actuator) -> None:
    command = EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 7.0)
    with pytest.raises(ValueError, match='current = 7 A must be at most 5 A'):
        command.check(EdgeLimits(speed=1.0, torque=1.0), motor)


def test_a_nudge_by_another_actuator_has_the_impulse_of_the_kick(motor: Actuator) -> None:
    chain = Chain(number_of_rotors=6)
    kick = EdgeCommand(Edge.LAST, CommandKind.KICK, 0.3)
    drive = EdgeDrive(motor)
    drive.command(kick.as_pressure(chain, motor, 0.1), Edge.LAST, 0.0)
    impulse = drive.mean_torque(0.0, 1.0).torque
    assert impulse == pytest.approx(-chain.moment_of_inertia * 0.3, rel=1e-9)
