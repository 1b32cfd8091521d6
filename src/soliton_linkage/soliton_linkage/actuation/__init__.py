# SPDX-License-Identifier: Apache-2.0
"""Actuators at the edges and at the joints of a chain: commands, torques, impulses and work.

A `ChainDriver` accepts commands and returns the torques to apply after each frame. `Actuator` is
the interface of an actuator model, and `ACTUATORS` lists the available models.
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
