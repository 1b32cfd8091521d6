# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.dynamics.elastic import ElasticSimulation as ElasticSimulation
from soliton_linkage.dynamics.elastic import simulate as simulate
from soliton_linkage.dynamics.ensemble import simulate_many as simulate_many
from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion as EquationOfMotion
from soliton_linkage.dynamics.initial_states import State as State
from soliton_linkage.dynamics.initial_states import leaning as leaning
from soliton_linkage.dynamics.initial_states import with_soliton as with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation as RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation as Simulation
from soliton_linkage.dynamics.work import TorqueLedger as TorqueLedger
