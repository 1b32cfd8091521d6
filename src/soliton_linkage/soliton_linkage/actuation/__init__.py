# SPDX-License-Identifier: Apache-2.0
"""Actuators at the edges and joints of a chain: a `ChainDriver` converts commands into torques."""

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
from soliton_linkage.actuation.waveform import DrivenQuantity, Waveform, WaveShape, WaveWindow

__all__ = [
    'ACTUATORS',
    'Actuator',
    'ChainDriver',
    'CommandKind',
    'DeliveryTotals',
    'DriveTorques',
    'DrivenQuantity',
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
    'WaveShape',
    'WaveWindow',
    'Waveform',
    'actuator_type',
    'trapezoid',
]
