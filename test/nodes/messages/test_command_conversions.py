# SPDX-License-Identifier: Apache-2.0
"""Commands and what became of them come back from their messages as they went in."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.kick_record import DeliveryTotals, KickReport
from soliton_linkage.actuation.waveform import DrivenQuantity, Waveform, WaveShape, WaveWindow
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages import command_conversions as conversions
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names

NAMED = NamedChain(Chain(number_of_rotors=4), default_joint_names(4))
STAMP = 1_700_000_000_123_456_789
LIMITS = {'rotor_0': 1.0, 'rotor_1': 2.0, 'rotor_2': 3.0, 'rotor_3': 4.0}
PULSE = EdgeCommand(Edge.LAST, CommandKind.PULSE, -0.5, 0.1, 0.2, 0.3)
NOISE = Waveform(
    WaveShape.NOISE, DrivenQuantity.ANGLE, 'rotor_2', WaveWindow.HANN, 20.0, 50.0, seed=7
)


def test_commands_come_back():
    for command in [
        PULSE,
        EdgeCommand(Edge.FIRST, CommandKind.KICK, 7.0),
        EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 0.0, 0.2),
        EdgeCommand(Edge.FIRST, CommandKind.WAVEFORM, 0.1, 2.0, 0.2, 0.3, NOISE),
    ]:
        for edge in Edge:
            command = dataclasses.replace(command, edge=edge)
            assert (
                conversions.edge_command_from_msg(conversions.edge_command_to_msg(command))
                == command
            )


def test_unknown_codes_are_rejected():
    for fields in [{'edge': 3}, {'kind': 4}, {'shape': 4}, {'quantity': 2}, {'window': 2}]:
        ((name, code),) = fields.items()
        with pytest.raises(ValueError, match=f'{name} = {code} must be one of 0, 1'):
            conversions.edge_command_from_msg(msg.EdgeCommand(**fields))


def test_a_delivery_survives_the_round_trip():
    delivered = DeliveryTotals(STAMP, 3, 0.1, True, -0.2, np.array([1.0, -2.0, 0.0, 1e-300]))
    back = conversions.delivery_from_msg(conversions.delivery_to_msg(delivered))
    for field in dataclasses.fields(DeliveryTotals):
        before, after = getattr(delivered, field.name), getattr(back, field.name)
        np.testing.assert_array_equal(before, after)


def kick(**changes: Any) -> KickReport:
    impulse = np.array([0.0, 1.5, 0.0, -2.5])
    usual = KickReport(STAMP, 'nudge', PULSE, 0.6, impulse, 0.25, 0.125, True, False, True)
    return dataclasses.replace(usual, **changes)


def test_a_kick_names_the_joints_that_it_acted_on():
    message = conversions.last_kick_to_msg(NAMED, kick())
    assert list(message.name) == ['rotor_1', 'rotor_3']
    assert list(message.impulse) == [1.5, -2.5]
    assert message.header.stamp.nanosec == 123_456_789
    for field in ('source', 'duration', 'work', 'peak_torque', 'saturated', 'measured'):
        assert getattr(message, field) == getattr(kick(), field)
    assert conversions.edge_command_from_msg(message.command) == PULSE


def test_torques_of_joints_were_not_asked_of_an_edge():
    message = conversions.last_kick_to_msg(NAMED, kick(command=None, source='~/commands'))
    assert message.command == msg.EdgeCommand()


def test_actuators_are_those_that_are_listed_or_all():
    for names in [(), ('rotor_3', 'rotor_0')]:
        actuators = conversions.joint_actuators(NAMED, names, LIMITS.__getitem__)
        assert actuators.names == (names or NAMED.joint_names)
        for name, rotor, limit in zip(
            actuators.names, actuators.rotors, actuators.limits, strict=True
        ):
            assert (NAMED.joint_names[rotor], LIMITS[name]) == (name, limit)


def test_each_effort_finds_its_rotor_and_its_limit():
    for names in [(), ('rotor_3', 'rotor_0')]:
        actuators = conversions.joint_actuators(NAMED, names, LIMITS.__getitem__)
        message = JointState(name=['rotor_3', 'rotor_0'], effort=[4.0, -1.0])
        rotors, torques = conversions.efforts_from_msg(actuators, 'joint_commands', message)
        np.testing.assert_array_equal(rotors, [3, 0])
        np.testing.assert_array_equal(torques, [4.0, -1.0])
        message = JointState(name=['rotor_0', 'rotor_3'], effort=[1.5, 1.5])
        with pytest.raises(
            ValueError, match=r'rotor_0 = 1.5 N m must lie in the range -1 to 1 N m'
        ):
            conversions.efforts_from_msg(actuators, 'joint_commands', message)
