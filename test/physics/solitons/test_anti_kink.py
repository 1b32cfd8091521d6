# SPDX-License-Identifier: Apache-2.0
"""Anti-kinks are states of least energy, equal at every second site, or pinned."""

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, chain_of
from scipy.optimize import minimize

from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array
from soliton_linkage.solitons.anti_kink import (
    anti_kink_path,
    constraint_field,
    continuum_anti_kink,
    resting_anti_kink,
)

ROTORS, BEGIN = 41, 20.0


def test_derivatives_of_the_constraint_field_agree_with_differences():
    for example in (FLIPPER, SPINNER):
        chain, step = chain_of(example, ROTORS), 1e-5
        angles = continuum_anti_kink(chain, 20.3)
        field, first, second = constraint_field(chain, angles)
        above, below = (constraint_field(chain, angles + h)[0] for h in (step, -step))
        assert first == pytest.approx((above - below) / (2 * step), abs=1e-8)
        assert second == pytest.approx((above - 2 * field + below) / step**2, abs=1e-4)


def test_no_other_state_with_the_same_field_sum_has_less_energy():
    chain = chain_of(FLIPPER, ROTORS)
    scale = chain.stiffness * chain.spacing**2
    _, states = anti_kink_path(chain, BEGIN)

    def cost(inner: Array, whole: Array) -> tuple[float, Array]:
        angles = np.concatenate([whole[:1], inner, whole[-1:]])
        torques = -chain.spring_torques(angles)[1:-1]
        return float(chain.elastic_energy(angles)) / scale, torques / scale

    def beside(inner: Array, whole: Array) -> float:
        angles = np.concatenate([whole[:1], inner, whole[-1:]])
        return float(
            (constraint_field(chain, angles)[0] - constraint_field(chain, whole)[0]).sum()
        )

    for state in states[::20]:
        start = state[1:-1] + 0.01 * np.random.default_rng(1).standard_normal(ROTORS - 2)
        held = {'type': 'eq', 'fun': beside, 'args': (state,)}
        found = minimize(cost, start, (state,), jac=True, constraints=held, tol=1e-12)
        assert found.success
        assert found.x == pytest.approx(state[1:-1], abs=1e-4)
        assert found.fun == pytest.approx(float(chain.elastic_energy(state)) / scale, rel=1e-6)


def test_the_path_repeats_after_two_rotors_with_uniform_arc_steps():
    chain = chain_of(FLIPPER, ROTORS)
    sites, states = anti_kink_path(chain, BEGIN)
    assert (sites[0], sites[-1]) == (BEGIN, BEGIN + 2)
    assert states[-1][4:] == pytest.approx(states[0][2:-2], abs=1e-6)
    arcs = np.linalg.norm(np.diff(states, axis=0), axis=1)
    assert arcs / np.diff(sites) == pytest.approx(arcs.sum() / 2)


def test_a_pinned_anti_kink_is_rejected():
    with pytest.raises(ArithmeticError, match='is pinned: it has no stable'):
        anti_kink_path(chain_of(SPINNER, ROTORS), BEGIN)


def test_an_anti_kink_of_spinners_has_a_stable_equilibrium():
    chain = chain_of(SPINNER, ROTORS)
    scale = chain.stiffness * chain.spacing**2
    site, angles = resting_anti_kink(chain, BEGIN + 0.5)
    assert BEGIN < site < BEGIN + 1
    assert np.abs(chain.spring_torques(angles)[1:-1]).max() < 1e-6 * scale
    inner = stiffness_matrix(chain, angles).toarray()[1:-1, 1:-1]
    assert np.linalg.eigvalsh(inner)[0] > 0
