# SPDX-License-Identifier: Apache-2.0
"""Actuators at the edges and on the joints, what they are commanded, and what they did.

Commands go to a `ChainDriver`, which has torques for each frame of a chain. `Actuator` says what
an actuator is; `ACTUATORS` lists those that there are.
"""

from soliton_linkage.actuation.actuators import (
    ACTUATORS,
    Actuator,
    PneumaticActuator,
    actuator_type,
)
from soliton_linkage.actuation.chain_driver import ChainDriver
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand, EdgeLimits
from soliton_linkage.actuation.kick_record import DeliveryTotals, KickRecord, KickReport
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.actuation.torque_drive import (
    DriveTorques,
    EdgeDrive,
    JointDrive,
    MeanTorque,
    TorqueDrive,
)

__all__ = [
    'ACTUATORS',
    'Actuator',
    'ChainDriver',
    'CommandKind',
    'DeliveryTotals',
    'DriveTorques',
    'EdgeCommand',
    'EdgeDrive',
    'EdgeLimits',
    'JointDrive',
    'KickRecord',
    'KickReport',
    'MeanTorque',
    'PneumaticActuator',
    'Profile',
    'TorqueDrive',
    'actuator_type',
    'trapezoid',
]
