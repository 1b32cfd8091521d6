# SPDX-License-Identifier: Apache-2.0
"""Position control of a soliton by feedback along the zero mode.

`Steering` estimates the wall in each frame with a `WallObserver` (the filter of the analyser),
tracks a `ReferenceTrajectory`, and converts the required force into torques with
`TorqueAllocation`.
"""

from soliton_linkage.steering.phonon_energy_estimator import PhononEnergyEstimator
from soliton_linkage.steering.reference_trajectory import (
    ReferencePoint,
    ReferenceTrajectory,
    adiabatic_rate,
    bandwidth,
    trajectory_to,
    trajectory_to_rest,
)
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings
from soliton_linkage.steering.steering import MoveResult, Outcome, Steering, WallState
from soliton_linkage.steering.torque_allocation import Effort, Reach, TorqueAllocation
from soliton_linkage.steering.wall_observer import WallEstimate, WallObserver

__all__ = [
    'DEFAULTS',
    'Effort',
    'MoveResult',
    'Outcome',
    'PhononEnergyEstimator',
    'Reach',
    'ReferencePoint',
    'ReferenceTrajectory',
    'Steering',
    'SteeringSettings',
    'TorqueAllocation',
    'WallEstimate',
    'WallObserver',
    'WallState',
    'adiabatic_rate',
    'bandwidth',
    'trajectory_to',
    'trajectory_to_rest',
]
