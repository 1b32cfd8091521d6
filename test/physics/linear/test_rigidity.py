# SPDX-License-Identifier: Apache-2.0
"""Laws of the rigidity matrix and its zero mode: one, annihilated, oriented, at the right edge."""

import dataclasses
import decimal
from decimal import Decimal

import numpy as np
import pytest
from chains import (
    EPS,
    EXAMPLES,
    FLIPPER,
    WIDE_SPINNER,
    any_configuration,
    chain_of,
)
from deviating_chains import (
    any_deviating_configuration,
    deviating,
    reach,
    rounding,
    shortest_length,
)
from hypothesis import assume, given
from hypothesis import strategies as st
from sampled_orbit import closed_orbit

from soliton_linkage.linear.rigidity import (
    rigidity_bands,
    rigidity_matrix,
    states_of_self_stress,
    zero_mode,
    zero_modes,
)
from soliton_linkage.linkage.chain import Array, Chain, staggered

SMALLEST = float(np.finfo(np.float64).tiny)


def leftovers(chain: Chain, angles: Array, mode: Array) -> Array:
    """|A_n t_n + B_n t_{n+1}| over |A_n t_n| + |B_n t_{n+1}| on each bond; 0 where both vanish."""
    first, second = rigidity_bands(chain, angles)
    terms = np.stack([first * mode[:-1], second * mode[1:]])
    sizes = np.abs(terms).sum(axis=0)
    seen = sizes > SMALLEST / EPS
    return np.abs(terms.sum(axis=0))[seen] / sizes[seen]


def exact_zero_mode(chain: Chain, angles: Array) -> Array:
    """Zero mode of the rounded levers from thirty digits, over its largest component."""
    exact = [Decimal(1)]
    with decimal.localcontext() as context:
        context.prec, context.Emin, context.Emax = 30, -(10**8), 10**8
        for first, second in np.stack(rigidity_bands(chain, angles), axis=1).tolist():
            exact.append(-exact[-1] * Decimal(first) / Decimal(second))
        largest = max(exact, key=abs)
        return np.array([float(component / largest) for component in exact])


def walls_at(chain: Chain, *places: float) -> Array:
    """Angles of walls at the given places [rotor spacings], leaning right before the first."""
    rotors = np.arange(chain.number_of_rotors)
    fields = [-np.tanh((rotors - place) / 3) for place in places]
    return staggered(chain.rest_angle * np.prod(fields, axis=0))


def pointing(chain: Chain, angles: Array, rotor: int, neighbour: int) -> float:
    """Angle at which a rotor points at its neighbour's mass, so that it stretches no spring."""
    across = chain.spacing * (neighbour - rotor) + chain.rotor_length * np.sin(angles[neighbour])
    return float(np.arctan2(across, chain.rotor_length * np.cos(angles[neighbour])))


def trapping(chain: Chain, m: int, n: int, seed: int) -> Array:
    """Return a configuration with A_m = 0 and B_n = 0, random for the rest."""
    angles = np.random.default_rng(seed).uniform(0.3, 1.2, chain.number_of_rotors)
    if m == n:
        angles[[m, m + 1]] = np.pi / 2, -np.pi / 2
        return angles
    angles[m] = pointing(chain, angles, m, m + 1)
    angles[n + 1] = pointing(chain, angles, n + 1, n)
    return angles


@given(st.one_of(any_configuration(), any_deviating_configuration()))
def test_the_rigidity_matrix_is_the_gradient_of_the_springs_lengths(configuration):
    chain, angles = configuration
    size = reach(chain)
    curvature = size / max(shortest_length(chain, angles), SMALLEST)
    assume(curvature < 30)
    step = EPS ** (1 / 3) / curvature
    shifts = step * np.eye(chain.number_of_rotors)
    change = chain.spring_extensions(angles + shifts) - chain.spring_extensions(angles - shifts)
    # As for the torques: third derivatives under 10 size * curvature^2, rounding of e_n.
    truncation = 10 * size * curvature**2 * step**2
    matrix = rigidity_matrix(chain, angles).toarray()
    assert matrix == pytest.approx(
        change.T / (2 * step), rel=0, abs=truncation + rounding(chain) / step
    )


@given(any_configuration(most=40), st.integers(0, 2**32), st.floats(0, 0.3))
def test_the_zero_mode_is_a_unit_vector_that_changes_no_length(configuration, seed, largest):
    even, angles = configuration
    chain = deviating(even, seed, largest)
    mode = zero_mode(chain, angles)
    assert np.linalg.norm(mode) == pytest.approx(1, rel=4 * EPS)
    # Each component is a product and a quotient away from the last.
    assert leftovers(chain, angles, mode).max(initial=0) <= 4 * EPS


def test_a_rotor_that_points_at_its_neighbours_mass_ends_the_zero_mode():
    chain = Chain(6, spacing=0.1, rotor_length=0.1, rest_angle=0.4)
    angles = np.array([0.3, -0.4, 0.0, -np.pi / 2, 0.5, 0.7])
    assert rigidity_bands(chain, angles)[0][2] == 0
    mode = zero_mode(chain, angles)
    assert np.abs(mode[3:]).max() < 1e-250
    assert np.abs(mode[:3]).min() > 0.01
    assert np.abs(rigidity_matrix(chain, angles) @ mode).max() <= 4 * EPS * chain.rotor_length

    mirrored = zero_mode(chain, -angles[::-1])
    assert rigidity_bands(chain, -angles[::-1])[1][2] == 0
    assert np.abs(mirrored) == pytest.approx(np.abs(mode[::-1]), rel=8 * EPS, abs=1e-250)


@pytest.mark.parametrize(
    ('example', 'rotors'), [*((example, 10) for example in EXAMPLES), (FLIPPER, 2)]
)
def test_the_zero_mode_turns_without_a_jump_along_the_whole_orbit_of_the_linkage(example, rotors):
    chain = chain_of(example, rotors)
    orbit = closed_orbit(chain, chain.uniform_state(-1)).angles
    modes = np.array([zero_mode(chain, angles) for angles in orbit])
    assert np.sum(modes[1:] * modes[:-1], axis=1).min() > 0.9
    # Along a curve of unit tangent t the next point lies a sample ahead, so none was flipped.
    assert np.sum((orbit[1:] - orbit[:-1]) * modes[:-1], axis=1).min() > 0
    assert np.abs(chain.spring_extensions(orbit)).max() < 1e-7 * chain.rotor_length


@pytest.mark.parametrize(('example', 'last'), [(FLIPPER, 79_999.0), (WIDE_SPINNER, 80_000.6)])
def test_walls_with_a_valley_between_too_deep_for_numbers_share_the_zero_mode(example, last):
    chain = chain_of(example, 100_000)
    angles = walls_at(chain, 19_999.2, 50_000, last)
    mode, ratios = zero_mode(chain, angles), exact_zero_mode(chain, angles)
    peak = int(np.argmax(np.abs(ratios)))
    seen = np.abs(ratios) > SMALLEST / EPS
    assert not seen[45_000:55_000].any()
    assert seen[19_950:20_050].all()
    assert seen[79_950:80_050].all()
    errors = np.abs(mode / mode[peak] / np.where(seen, ratios, 1) - 1)
    steps = np.abs(np.arange(100_000) - peak) + 1
    assert (errors <= 4 * EPS * steps)[seen].all()
    assert leftovers(chain, angles, mode).max() <= 4 * EPS


def test_periodic_ends_are_rejected_a_zero_mode_of_their_own():
    chain = dataclasses.replace(chain_of(FLIPPER, 6), periodic=True)
    with pytest.raises(ValueError, match='periodic ends has as many springs as rotors'):
        zero_mode(chain, chain.uniform_state(1))


@given(any_deviating_configuration())
def test_zero_modes_outnumber_states_of_self_stress_as_rotors_outnumber_springs(configuration):
    chain, angles = configuration
    modes, stresses = zero_modes(chain, angles), states_of_self_stress(chain, angles)
    missing = chain.number_of_rotors - chain.number_of_springs
    assert modes.shape[1] - stresses.shape[1] == missing == (0 if chain.periodic else 1)
    matrix = rigidity_matrix(chain, angles).toarray()
    size = np.abs(matrix).max()
    assert np.abs(matrix @ modes).max(initial=0) <= 4e-10 * size
    assert np.abs(matrix.T @ stresses).max(initial=0) <= 4e-10 * size
    for basis in (modes, stresses):
        assert basis.T @ basis == pytest.approx(np.eye(basis.shape[1]), abs=32 * EPS)


def test_rotors_that_point_outwards_trap_a_stress_between_them_and_free_a_motion():
    for m, n in [(0, 0), (3, 3), (0, 7), (2, 3), (1, 6)]:
        for seed in range(2):
            chain = chain_of((0.4, 0.8), 9)
            angles = trapping(chain, m, n, seed)
            first, second = rigidity_bands(chain, angles)
            assert max(abs(first[m]), abs(second[n])) <= 8 * EPS * chain.rotor_length
            assert zero_modes(chain, angles).shape[1] == 2
            stresses = states_of_self_stress(chain, angles)
            assert stresses.shape[1] == 1
            outside = np.delete(stresses[:, 0], np.arange(m, n + 1))
            assert np.abs(outside).max(initial=0) <= 1e-10
            mode = zero_mode(chain, angles)
            assert (
                np.abs(rigidity_matrix(chain, angles) @ mode).max() <= 8 * EPS * chain.rotor_length
            )
