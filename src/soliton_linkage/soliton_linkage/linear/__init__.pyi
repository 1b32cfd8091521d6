# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.linear.bands import couplings as couplings
from soliton_linkage.linear.bands import dispersion as dispersion
from soliton_linkage.linear.bands import gap as gap
from soliton_linkage.linear.bands import penetration_depth as penetration_depth
from soliton_linkage.linear.bands import speed_of_sound as speed_of_sound
from soliton_linkage.linear.bands import winding_number as winding_number
from soliton_linkage.linear.rigidity import Edge as Edge
from soliton_linkage.linear.rigidity import dynamical_matrix as dynamical_matrix
from soliton_linkage.linear.rigidity import edge_mode as edge_mode
from soliton_linkage.linear.rigidity import rigidity_matrix as rigidity_matrix
from soliton_linkage.linear.rigidity import states_of_self_stress as states_of_self_stress
from soliton_linkage.linear.rigidity import zero_mode as zero_mode
from soliton_linkage.linear.rigidity import zero_modes as zero_modes
from soliton_linkage.linear.statics import equilibrium as equilibrium
from soliton_linkage.linear.statics import rest_state as rest_state
from soliton_linkage.linear.statics import toggled_angle as toggled_angle
from soliton_linkage.linear.statics import unstretched as unstretched
