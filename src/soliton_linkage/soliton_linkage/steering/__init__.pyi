# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.steering.phonon_energy_estimator import (
    PhononEnergyEstimator as PhononEnergyEstimator,
)
from soliton_linkage.steering.reference_trajectory import ReferencePoint as ReferencePoint
from soliton_linkage.steering.reference_trajectory import (
    ReferenceTrajectory as ReferenceTrajectory,
)
from soliton_linkage.steering.reference_trajectory import adiabatic_rate as adiabatic_rate
from soliton_linkage.steering.reference_trajectory import bandwidth as bandwidth
from soliton_linkage.steering.reference_trajectory import trajectory_to as trajectory_to
from soliton_linkage.steering.reference_trajectory import trajectory_to_rest as trajectory_to_rest
from soliton_linkage.steering.settings import DEFAULTS as DEFAULTS
from soliton_linkage.steering.settings import SteeringSettings as SteeringSettings
from soliton_linkage.steering.steering import MoveResult as MoveResult
from soliton_linkage.steering.steering import Outcome as Outcome
from soliton_linkage.steering.steering import Steering as Steering
from soliton_linkage.steering.steering import WallState as WallState
from soliton_linkage.steering.torque_allocation import Effort as Effort
from soliton_linkage.steering.torque_allocation import Reach as Reach
from soliton_linkage.steering.torque_allocation import TorqueAllocation as TorqueAllocation
from soliton_linkage.steering.wall_observer import WallEstimate as WallEstimate
from soliton_linkage.steering.wall_observer import WallObserver as WallObserver
