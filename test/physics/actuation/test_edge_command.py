# SPDX-License-Identifier: Apache-2.0
"""Commands are checked completely; commands without duration are impulses of known size."""

import math

import numpy as np
import pytest

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand, EdgeLimits
from soliton_linkage.actuation.torque_drive import EdgeDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.chain import Chain

ACTUATOR = PneumaticActuator()
LIMITS = EdgeLimits(speed=100.0, torque=0.1)
KICK, PRESSURE, PULSE, _ = CommandKind
CHAIN = Chain(number_of_rotors=6)


def test_a_command_with_invalid_times_is_rejected():
    for fields, complaint in [
        ({'kind': KICK, 'duration': 0.5}, 'duration of a kick = 0.5 s must be 0'),
        ({'kind': KICK, 'ramp_up': math.nan}, 'ramp_up of a kick = nan s must be 0'),
        ({'kind': PULSE, 'duration': -1.0}, 'duration = -1 s must be a finite number'),
        ({'kind': PULSE, 'ramp_down': math.inf}, 'ramp_down = inf s must be a finite'),
        ({'kind': PRESSURE, 'ramp_up': math.nan}, 'ramp_up = nan s must be a finite'),
        ({'kind': PRESSURE, 'ramp_down': 0.1}, 'ramp_down = 0.1 s must be 0 for a pressure'),
        ({'kind': KICK, 'value': 101.0}, 'speed = 101 rad/s must lie in the range -100'),
        ({'kind': KICK, 'value': math.nan}, 'speed = nan rad/s must be a finite number'),
        ({'kind': PULSE, 'value': -0.2}, r'torque = -0.2 N m must lie .* raise torque_limit'),
        ({'kind': PRESSURE, 'value': 3e5}, 'pressure = 300000 Pa must lie in the range'),
    ]:
        with pytest.raises(ValueError, match=complaint):
            EdgeCommand(**{'edge': Edge.FIRST, 'value': 0.0, **fields}).check(LIMITS, ACTUATOR)


def test_kicks_and_pulses_without_duration_are_impulses():
    for command, instantaneous in [
        (EdgeCommand(Edge.FIRST, KICK, 1.0), True),
        (EdgeCommand(Edge.FIRST, PULSE, 1.0), True),
        (EdgeCommand(Edge.FIRST, PULSE, 1.0, ramp_up=0.1), False),
        (EdgeCommand(Edge.FIRST, PULSE, 1.0, 0.1), False),
        (EdgeCommand(Edge.FIRST, PRESSURE, 1.0), False),
    ]:
        assert command.instantaneous == instantaneous


def test_the_impulses_of_a_kick_give_its_speed_along_the_mode():
    angles = CHAIN.uniform_state(-1)
    _, mode = resolved_edge_mode(CHAIN, angles, Edge.NEAREST)
    simulation = ElasticSimulation(CHAIN, angles, 0 * angles, 1e-3)
    simulation.kick(EdgeCommand(Edge.FIRST, KICK, -3.0).impulses(CHAIN, mode, None))
    np.testing.assert_allclose(simulation.rates, -3.0 * mode, rtol=1e-12)


def test_a_pulse_without_duration_acts_for_one_period():
    pulse = EdgeCommand(Edge.FIRST, PULSE, 0.05)
    mode = np.full(6, 0.1)
    np.testing.assert_allclose(pulse.impulses(CHAIN, mode, 0.002), 1e-4 * mode, rtol=1e-12)
    with pytest.raises(ValueError, match='which is not known yet; specify a duration'):
        pulse.impulses(CHAIN, mode, None)


def test_a_kick_converted_to_a_pressure_keeps_its_impulse():
    for speed in [0.5, -0.5]:
        kick = EdgeCommand(Edge.FIRST, KICK, speed)
        pressure = kick.as_pressure(CHAIN, ACTUATOR, 0.1)
        assert (pressure.kind, pressure.duration) == (PRESSURE, 0.1)
        drive = EdgeDrive(ACTUATOR)
        drive.command(pressure, Edge.FIRST, 0.0)
        impulse = drive.mean_torque(0.0, 5.0).torque * 5.0
        assert impulse == pytest.approx(CHAIN.moment_of_inertia * speed, rel=1e-9)
