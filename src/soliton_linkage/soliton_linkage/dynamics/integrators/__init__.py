# SPDX-License-Identifier: Apache-2.0
"""Solvers of springs in motion, by name: those of scipy, and faster ones made for chains.

One file each, and its steps, loops and coefficients; one more is registered by an entry of
INTEGRATORS.
"""

from __future__ import annotations

from scipy.integrate import BDF, DOP853, LSODA, RK23, RK45, OdeSolver, Radau

from soliton_linkage.dynamics.integrators.chain_solver import ChainSolver, SolverSettings
from soliton_linkage.dynamics.integrators.symmetric_multistep import SymmetricMultistep
from soliton_linkage.dynamics.integrators.symplectic_nystrom import SymplecticNystrom

__all__ = [
    'INTEGRATORS',
    'ChainSolver',
    'SolverSettings',
    'SymmetricMultistep',
    'SymplecticNystrom',
]

INTEGRATORS: dict[str, type[OdeSolver]] = {
    'DOP853': DOP853,
    'symplectic': SymplecticNystrom,
    'multistep': SymmetricMultistep,
    'RK23': RK23,
    'RK45': RK45,
    'Radau': Radau,
    'BDF': BDF,
    'LSODA': LSODA,
}
"""Solvers of `EquationOfMotion` by the name that `ElasticSimulation` takes."""
