# SPDX-License-Identifier: Apache-2.0
# The public names of the package: what type checkers read, and `__init__` imports when asked.

from soliton_linkage.actuation.edge_drive import EdgeDrive as EdgeDrive
from soliton_linkage.actuation.pneumatics import PneumaticActuator as PneumaticActuator
from soliton_linkage.dynamics.elastic import (
    ElasticSimulation as ElasticSimulation,
    simulate as simulate,
)
from soliton_linkage.dynamics.initial_states import (
    State as State,
    leaning as leaning,
    with_soliton as with_soliton,
)
from soliton_linkage.dynamics.rigid import RigidSimulation as RigidSimulation
from soliton_linkage.estimation.analyser import Analyser as Analyser, Analysis as Analysis
from soliton_linkage.linear.bands import (
    dispersion as dispersion,
    gap as gap,
    penetration_depth as penetration_depth,
    speed_of_sound as speed_of_sound,
)
from soliton_linkage.linear.normal_modes import normal_modes as normal_modes
from soliton_linkage.linear.rigidity import (
    Edge as Edge,
    edge_mode as edge_mode,
    rigidity_matrix as rigidity_matrix,
    zero_mode as zero_mode,
)
from soliton_linkage.linkage.chain import (
    Chain as Chain,
    Motion as Motion,
    displacement as displacement,
    staggered as staggered,
)
from soliton_linkage.linkage.deviations import Deviations as Deviations
from soliton_linkage.linkage.gravity import Gravity as Gravity
from soliton_linkage.linkage.recording import Recording as Recording
from soliton_linkage.orbit.deviating_orbit import orbit_of as orbit_of
from soliton_linkage.orbit.orbit import Orbit as Orbit
from soliton_linkage.solitons.passage import find_obstacles as find_obstacles
from soliton_linkage.solitons.static_wall import site_arc as site_arc, static_wall as static_wall
from soliton_linkage.solitons.tanh_fit import Soliton as Soliton, find_solitons as find_solitons
from soliton_linkage.solitons.track import (
    Crossing as Crossing,
    Track as Track,
    find_crossings as find_crossings,
    follow as follow,
)
from soliton_linkage.steering.steering import Steering as Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation as TorqueAllocation
