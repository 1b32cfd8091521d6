# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.linear.bands import exact_tail as exact_tail
from soliton_linkage.solitons.continuum import FlipperTheory as FlipperTheory
from soliton_linkage.solitons.continuum import SpinnerTheory as SpinnerTheory
from soliton_linkage.solitons.continuum import wall_theory as wall_theory
from soliton_linkage.solitons.passage import blocked_bonds as blocked_bonds
from soliton_linkage.solitons.passage import find_obstacles as find_obstacles
from soliton_linkage.solitons.passage import motion_of_bonds as motion_of_bonds
from soliton_linkage.solitons.static_wall import site_arc as site_arc
from soliton_linkage.solitons.tanh_fit import Soliton as Soliton
from soliton_linkage.solitons.tanh_fit import find_solitons as find_solitons
from soliton_linkage.solitons.tanh_fit import order_field as order_field
from soliton_linkage.solitons.track import Crossing as Crossing
from soliton_linkage.solitons.track import Track as Track
from soliton_linkage.solitons.track import find_crossings as find_crossings
from soliton_linkage.solitons.track import follow as follow
