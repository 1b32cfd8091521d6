# SPDX-License-Identifier: Apache-2.0
"""Every integrator by its name, and one that is added from outside."""

import numpy as np
import pytest
from chains import FLIPPER, chain_of
from scipy.integrate import DenseOutput, OdeSolver
from scipy.interpolate import CubicHermiteSpline

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.integrators import INTEGRATORS
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain

TIME_UNITS = 6


def kicked(integrator: str, tolerance: float, damping: float = 0.0) -> ElasticSimulation:
    bare = chain_of(FLIPPER, 6)
    chain = Chain(6, bare.spacing, bare.rotor_length, bare.rest_angle, damping=damping)
    angles = chain.uniform_state(-1)
    rates = 0.2 / chain.time_unit * edge_mode(chain, angles, Edge.FIRST)
    return ElasticSimulation(
        chain, angles, rates, chain.time_unit, tolerance, integrator=integrator
    )


def moved(simulation: ElasticSimulation) -> Array:
    for _ in range(TIME_UNITS):
        simulation.advance()
    return np.concatenate([simulation.angles, simulation.rates * simulation.chain.time_unit])


@pytest.mark.parametrize('integrator', INTEGRATORS)
def test_the_error_of_each_is_of_the_size_of_its_tolerance(integrator):
    exact = moved(kicked('DOP853', 1e-13))
    tolerances, errors = (1e-5, 1e-9), []
    for tolerance in tolerances:
        simulation = kicked(integrator, tolerance)
        errors.append(np.linalg.norm(moved(simulation) - exact))
        assert abs(simulation.energy_drift) < 1000 * tolerance
        assert errors[-1] < 100 * tolerance
    # Those whose longest step is far more exact than is asked for start from less.
    assert errors[1] < errors[0] / 50


class Verlet(OdeSolver):
    """The velocity Verlet method, as one writes it on an afternoon."""

    def __init__(self, fun: object, t0: float, y0: Array, t_bound: float, **others: object):
        super().__init__(fun, t0, y0, t_bound, vectorized=False)
        self._step, self._slope = float(others['max_step']) / 500, self.fun(t0, self.y)

    def _step_impl(self) -> tuple[bool, str | None]:
        half = self.n // 2
        self._before = self.y, self._slope
        rates = self.y[half:] + self._step / 2 * self._slope[half:]
        angles = self.y[:half] + self._step * rates
        accelerations = self.fun(self.t, np.concatenate([angles, rates]))[half:]
        rates = rates + self._step / 2 * accelerations
        self.y, self._slope = (
            np.concatenate([angles, rates]),
            np.concatenate([rates, accelerations]),
        )
        self.t += self._step
        return True, None

    def _dense_output_impl(self) -> DenseOutput:
        states, slopes = zip(self._before, (self.y, self._slope), strict=True)
        return Between(self.t_old, self.t, np.array(states), np.array(slopes))


class Between(DenseOutput):
    def __init__(self, t_old: float, t: float, states: Array, slopes: Array):
        super().__init__(t_old, t)
        self._spline = CubicHermiteSpline([t_old, t], states, slopes)

    def _call_impl(self, t: Array) -> Array:
        return self._spline(t).T


def test_one_is_added_by_an_entry(monkeypatch):
    monkeypatch.setitem(INTEGRATORS, 'verlet', Verlet)
    simulation, exact = kicked('verlet', 1e-9), moved(kicked('DOP853', 1e-12))
    error = np.linalg.norm(moved(simulation) - exact)
    assert 1e-9 < error < 1e-3
    assert 0 < abs(simulation.energy_drift) < 1e-4
    with pytest.raises(ValueError, match=r"'leapfrog' must be one of .*'verlet'"):
        kicked('leapfrog', 1e-9)
