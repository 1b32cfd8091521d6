# SPDX-License-Identifier: Apache-2.0
"""The ledger of energy, work and dissipation closes with every force and every integrator."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from chains import FLIPPER, chain_of

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.dynamics.integrators import INTEGRATORS
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

ROTORS = 8
TERMS: dict[str, dict[str, Any]] = {
    'springs only': {},
    'damping': {'damping': 2e-6},
    'dry friction': {'dry_friction': 2e-6, 'friction_rate': 0.5},
    'quadratic damping': {'quadratic_damping': 1e-6},
    'non-reciprocity': {'non_reciprocity': 1e-5},
    'on-site potential': {'on_site_torque': 1e-5, 'on_site_order': 2, 'on_site_phase': 0.3},
    'feedback': {'feedback': Feedback(rate=2e-6, left_angle=1e-5, right_angle=-1e-5, delay=1)},
}
TERMS['all at once'] = {name: value for each in TERMS.values() for name, value in each.items()}
NOT_CONSERVATIVE = [name for name in TERMS if name not in ('springs only', 'on-site potential')]
CASES = [
    (mechanics, name)
    for mechanics in (*INTEGRATORS, 'rigid')
    for name in TERMS
    if mechanics in ('symplectic', 'rigid') or name in ('springs only', 'damping', 'all at once')
]


def moved(mechanics: str, terms: dict[str, Any], tolerance: float) -> Simulation:
    """A soliton that kicks, torques, tilt and a change of the motors disturb."""
    chain = dataclasses.replace(chain_of(FLIPPER, ROTORS), **terms)
    start, torques = with_soliton(chain, 3.0, 0.1), np.zeros(ROTORS)
    given = chain, start.angles, start.rates, 0.01, tolerance
    if mechanics == 'rigid':
        simulation: Simulation = RigidSimulation(*given)
    else:
        simulation = ElasticSimulation(*given, integrator=mechanics)
    simulation.record(0.05)
    torques[2] = 2e-5
    simulation.hold(torques)
    simulation.kick(0.2 * torques)
    simulation.record(0.05)
    simulation.set_gravity(Gravity(0.05, 0.2))
    if chain.non_reciprocity:
        simulation.set_non_reciprocity(-chain.non_reciprocity)
    simulation.record(0.05)
    simulation.set_gravity(NO_GRAVITY)
    simulation.hold(0 * torques)
    simulation.record(0.05)
    return simulation


@pytest.mark.parametrize(('mechanics', 'name'), CASES)
def test_energy_changes_by_work_and_dissipation(mechanics, name):
    # The tolerance limits the error of each step, of which a run has 20 to 400.
    tolerance = 1e-7 if mechanics in ('RK23', 'BDF') else 1e-9
    simulation = moved(mechanics, TERMS[name], tolerance)
    assert simulation.kick_work > 0
    assert (abs(simulation.dissipated) > 1e-3 * simulation.energy) == (name in NOT_CONSERVATIVE)
    assert abs(simulation.energy_drift) < 20 * tolerance
