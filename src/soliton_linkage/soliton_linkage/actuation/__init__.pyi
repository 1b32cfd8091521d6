# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.actuation.actuators import ACTUATORS as ACTUATORS
from soliton_linkage.actuation.actuators import Actuator as Actuator
from soliton_linkage.actuation.actuators import PneumaticActuator as PneumaticActuator
from soliton_linkage.actuation.actuators import actuator_type as actuator_type
from soliton_linkage.actuation.chain_driver import ChainDriver as ChainDriver
from soliton_linkage.actuation.edge_command import CommandKind as CommandKind
from soliton_linkage.actuation.edge_command import EdgeCommand as EdgeCommand
from soliton_linkage.actuation.edge_command import EdgeLimits as EdgeLimits
from soliton_linkage.actuation.kick_record import DeliveryTotals as DeliveryTotals
from soliton_linkage.actuation.kick_record import KickRecord as KickRecord
from soliton_linkage.actuation.kick_record import KickReport as KickReport
from soliton_linkage.actuation.profile import Profile as Profile
from soliton_linkage.actuation.profile import trapezoid as trapezoid
from soliton_linkage.actuation.torque_drive import DriveTorques as DriveTorques
from soliton_linkage.actuation.torque_drive import EdgeDrive as EdgeDrive
from soliton_linkage.actuation.torque_drive import JointDrive as JointDrive
from soliton_linkage.actuation.torque_drive import MeanTorque as MeanTorque
from soliton_linkage.actuation.torque_drive import TorqueDrive as TorqueDrive
from soliton_linkage.actuation.waveform import DrivenQuantity as DrivenQuantity
from soliton_linkage.actuation.waveform import Waveform as Waveform
from soliton_linkage.actuation.waveform import WaveShape as WaveShape
from soliton_linkage.actuation.waveform import WaveWindow as WaveWindow
