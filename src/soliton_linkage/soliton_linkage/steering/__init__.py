# SPDX-License-Identifier: Apache-2.0
"""Position control of a soliton by feedback along the zero mode.

In each frame, `Steering` estimates the wall with a `WallObserver`, computes the force that keeps
it on a `ReferenceTrajectory`, and converts this force into torques with `TorqueAllocation`.
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
