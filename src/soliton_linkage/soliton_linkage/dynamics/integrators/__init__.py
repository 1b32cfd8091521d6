# SPDX-License-Identifier: Apache-2.0
"""Registry of solvers for chains of springs: `symplectic` and the solvers of scipy."""

from __future__ import annotations

from scipy.integrate import BDF, DOP853, LSODA, RK23, RK45, OdeSolver, Radau

from soliton_linkage.dynamics.integrators.symplectic_nystrom import (
    SolverSettings,
    SymplecticNystrom,
)

__all__ = ['INTEGRATORS', 'SolverSettings', 'SymplecticNystrom']

INTEGRATORS: dict[str, type[OdeSolver]] = {
    'symplectic': SymplecticNystrom,
    'DOP853': DOP853,
    'RK23': RK23,
    'RK45': RK45,
    'Radau': Radau,
    'BDF': BDF,
    'LSODA': LSODA,
}
"""Solvers for an `EquationOfMotion`; the keys are the names that `ElasticSimulation` accepts."""
