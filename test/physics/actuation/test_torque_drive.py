# SPDX-License-Identifier: Apache-2.0
"""Edges and joints act together, along the zero mode of the moment and joint by joint."""

from __future__ import annotations

import numpy as np
from chains import FLIPPER, chain_of
from linkage_motion import wall_between

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.linear.rigidity import Edge, edge_mode

CHAIN = chain_of(FLIPPER, 12)
PULSE = EdgeCommand(Edge.LAST, CommandKind.PULSE, 0.03, 1.0)


def test_torques_follow_the_mode_of_the_configuration_away_from_their_edge() -> None:
    drive = TorqueDrive(CHAIN, PneumaticActuator(), timeout=0.0)
    drive.edges.command(PULSE, Edge.LAST, 0.0)
    for number, rotor in enumerate((9, 5, 2)):
        angles = wall_between(CHAIN, rotor)
        time = 0.1 * number
        given = drive.torques(angles, time, time + 0.01).torques
        expected = 0.03 * edge_mode(CHAIN, angles, Edge.LAST, anywhere=True)
        np.testing.assert_allclose(given, expected, rtol=1e-12)


def test_joints_add_to_edges_and_dropping_ends_both() -> None:
    drive = TorqueDrive(CHAIN, PneumaticActuator(), timeout=0.0)
    angles = CHAIN.uniform_state(1)
    drive.edges.command(PULSE, Edge.LAST, 0.0)
    drive.joints.hold(np.array([3, 7]), np.array([1e-3, -2e-3]), 0.0)
    given = drive.torques(angles, 0.0, 0.01).torques
    expected = 0.03 * edge_mode(CHAIN, angles, Edge.LAST)
    expected[[3, 7]] += [1e-3, -2e-3]
    np.testing.assert_allclose(given, expected, rtol=1e-12)
    assert drive.unfinished(0.5)
    drive.drop(0.5)
    assert not drive.active
    assert not drive.torques(angles, 0.5, 0.51).torques.any()
