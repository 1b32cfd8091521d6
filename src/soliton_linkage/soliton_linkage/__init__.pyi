# SPDX-License-Identifier: Apache-2.0
# Public names of the package for type checkers; `__init__` imports each name at its first use.

from soliton_linkage.actuation.actuators import PneumaticActuator as PneumaticActuator
from soliton_linkage.actuation.torque_drive import EdgeDrive as EdgeDrive
from soliton_linkage.dynamics.elastic import (
    ElasticSimulation as ElasticSimulation,
)
from soliton_linkage.dynamics.elastic import (
    simulate as simulate,
)
from soliton_linkage.dynamics.ensemble import simulate_many as simulate_many
from soliton_linkage.dynamics.initial_states import (
    State as State,
)
from soliton_linkage.dynamics.initial_states import (
    leaning as leaning,
)
from soliton_linkage.dynamics.initial_states import (
    with_soliton as with_soliton,
)
from soliton_linkage.dynamics.rigid import RigidSimulation as RigidSimulation
from soliton_linkage.estimation.analyser import Analyser as Analyser
from soliton_linkage.estimation.analysis import Analysis as Analysis
from soliton_linkage.linear.bands import (
    dispersion as dispersion,
)
from soliton_linkage.linear.bands import (
    gap as gap,
)
from soliton_linkage.linear.bands import (
    penetration_depth as penetration_depth,
)
from soliton_linkage.linear.bands import (
    speed_of_sound as speed_of_sound,
)
from soliton_linkage.linear.normal_modes import normal_modes as normal_modes
from soliton_linkage.linear.rigidity import (
    Edge as Edge,
)
from soliton_linkage.linear.rigidity import (
    edge_mode as edge_mode,
)
from soliton_linkage.linear.rigidity import (
    rigidity_matrix as rigidity_matrix,
)
from soliton_linkage.linear.rigidity import (
    zero_mode as zero_mode,
)
from soliton_linkage.linkage.chain import (
    Chain as Chain,
)
from soliton_linkage.linkage.chain import (
    Motion as Motion,
)
from soliton_linkage.linkage.chain import (
    displacement as displacement,
)
from soliton_linkage.linkage.chain import (
    staggered as staggered,
)
from soliton_linkage.linkage.deviations import Deviations as Deviations
from soliton_linkage.linkage.feedback import Feedback as Feedback
from soliton_linkage.linkage.gravity import Gravity as Gravity
from soliton_linkage.linkage.recording import Recording as Recording
from soliton_linkage.orbit.deviating_orbit import orbit_of as orbit_of
from soliton_linkage.orbit.orbit import Orbit as Orbit
from soliton_linkage.solitons.passage import find_obstacles as find_obstacles
from soliton_linkage.solitons.static_wall import site_arc as site_arc
from soliton_linkage.solitons.static_wall import static_wall as static_wall
from soliton_linkage.solitons.tanh_fit import Soliton as Soliton
from soliton_linkage.solitons.tanh_fit import find_solitons as find_solitons
from soliton_linkage.solitons.track import (
    Crossing as Crossing,
)
from soliton_linkage.solitons.track import (
    Track as Track,
)
from soliton_linkage.solitons.track import (
    find_crossings as find_crossings,
)
from soliton_linkage.solitons.track import (
    follow as follow,
)
from soliton_linkage.steering.steering import Steering as Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation as TorqueAllocation
