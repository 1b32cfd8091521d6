# SPDX-License-Identifier: Apache-2.0
"""Linear theory in closed form against the rigidity matrix, its spectrum and its zero modes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from chains import EPS, EXAMPLES, FLIPPER, any_chain, chain_of
from hypothesis import assume, given
from hypothesis import strategies as st

from soliton_linkage.bands import couplings, dispersion, gap, penetration_depth, winding_number
from soliton_linkage.chain import Array, Chain
from soliton_linkage.rigidity import rigidity_bands, rigidity_matrix, zero_mode

LEANS = st.sampled_from([-1, 1])


def scale(chain: Chain) -> float:
    """Largest angular frequency of a phonon [rad/s]."""
    plus, minus = map(abs, couplings(chain))
    return (plus + minus) / (chain.rotor_length * chain.time_unit)


def rounding_of_levers(chain: Chain) -> float:
    """What rounding may do to a lever [m/rad]: EPS of r, as often as r makes up for lengths."""
    return 16 * EPS * chain.rotor_length * (1 + chain.rotor_length / chain.rest_length)


def rounding_of_frequencies(chain: Chain) -> float:
    """The same for singular values of R, which has two levers a row, as frequencies [rad/s].

    The values themselves are found to EPS of the largest, times a few.
    """
    of_levers = 2 * rounding_of_levers(chain) / (chain.rotor_length * chain.time_unit)
    return of_levers + 32 * EPS * scale(chain)


def frequencies(chain: Chain, matrix: Array) -> Array:
    """Angular frequencies of k_e / (M r^2) R^T R [rad/s], from the singular values of R."""
    singular = np.linalg.svd(matrix, compute_uv=False)
    return np.sort(singular) / (chain.rotor_length * chain.time_unit)


@given(any_chain(), LEANS)
def test_couplings_are_the_levers_of_the_uniform_state_in_staggered_angles(
    chain: Chain, lean: int
) -> None:
    plus, minus = couplings(chain, lean)
    first, second = rigidity_bands(chain, chain.uniform_state(lean))
    signs = (-1.0) ** np.arange(chain.number_of_rotors)
    limit = rounding_of_levers(chain)
    assert first * signs[:-1] == pytest.approx(-plus, rel=0, abs=limit)
    assert second * signs[1:] == pytest.approx(-minus, rel=0, abs=limit)


@given(any_chain())
def test_leaning_the_other_way_exchanges_the_couplings(chain: Chain) -> None:
    plus, minus = couplings(chain, 1)
    assert couplings(chain, -1) == (-minus, -plus)


@given(any_chain(fewest=3, most=20), LEANS)
def test_a_periodic_chain_has_the_spectrum_of_the_dispersion(chain: Chain, lean: int) -> None:
    # Rotor N of a chain of N + 1, N even, is rotor 0 of the ring.
    rotors = chain.number_of_rotors // 2 * 2
    unrolled = dataclasses.replace(chain, number_of_rotors=rotors + 1)
    matrix = rigidity_matrix(unrolled, unrolled.uniform_state(lean)).toarray()
    matrix[:, 0] += matrix[:, -1]
    wave_numbers = 2 * np.pi * np.arange(rotors) / (rotors * chain.spacing)
    expected = np.sort(dispersion(chain, wave_numbers))
    assert frequencies(chain, matrix[:, :-1]) == pytest.approx(
        expected, rel=0, abs=rounding_of_frequencies(chain)
    )


@given(any_chain(fewest=4), LEANS, st.floats(-4, 4), st.sampled_from([-1, 1]))
def test_waves_of_staggered_angles_are_on_one_branch_and_of_angles_on_the_other(
    chain: Chain, lean: int, phase: float, branch: int
) -> None:
    rotors = np.arange(chain.number_of_rotors)
    wave = np.exp(1j * phase * rotors)
    if branch == 1:
        wave *= (-1.0) ** rotors
    # Springs within an endless wave all stretch alike but for their phase, as does a force on
    # the rotors: |R wave| is r omega in the units of the springs.
    stretch = np.abs(rigidity_matrix(chain, chain.uniform_state(lean)) @ wave)
    omega = dispersion(chain, phase / chain.spacing, branch)
    limit = rounding_of_frequencies(chain)
    assert stretch / (chain.rotor_length * chain.time_unit) == pytest.approx(
        float(omega), rel=0, abs=limit
    )


@given(any_chain(), st.floats(-100, 100))
def test_the_branches_are_half_a_zone_apart(chain: Chain, cells: float) -> None:
    wave_number = cells / chain.spacing
    shifted = (cells + math.pi) / chain.spacing
    assert dispersion(chain, wave_number, -1) == pytest.approx(
        float(dispersion(chain, shifted)), rel=0, abs=1000 * EPS * scale(chain)
    )


@given(any_chain(most=30), LEANS)
def test_a_free_chain_has_the_closed_form_spectrum(chain: Chain, lean: int) -> None:
    plus, minus = couplings(chain)
    rotors = chain.number_of_rotors
    phases = np.pi * np.arange(1, rotors) / rotors
    squares = plus**2 + minus**2 + 2 * plus * minus * np.cos(phases)
    unit = chain.rotor_length * chain.time_unit
    matrix = rigidity_matrix(chain, chain.uniform_state(lean)).toarray()
    limit = 4 * scale(chain) * rounding_of_frequencies(chain)
    assert frequencies(chain, matrix) ** 2 == pytest.approx(
        np.sort(np.abs(squares)) / unit**2, rel=0, abs=limit
    )


@given(any_chain(), LEANS)
def test_the_gap_is_the_bottom_of_both_branches(chain: Chain, lean: int) -> None:
    zone = np.linspace(-np.pi, np.pi, 101) / chain.spacing
    lowest = min(dispersion(chain, zone, branch).min() for branch in (-1, 1))
    assert gap(chain) == pytest.approx(lowest, rel=0, abs=32 * EPS * scale(chain))


@given(any_chain())
def test_the_gap_has_its_closed_form_on_both_sides_of_d_1(chain: Chain) -> None:
    lean = chain.rotor_length * math.sin(2 * chain.rest_angle)
    reach = chain.spacing * math.cos(chain.rest_angle)
    closed_form = 2 * min(lean, reach) / (chain.rest_length * chain.time_unit)
    assert gap(chain) == pytest.approx(closed_form, rel=0, abs=16 * EPS * scale(chain))
    assert (lean < reach) == (chain.lean_ratio < 1) or chain.lean_ratio == pytest.approx(1)


@given(any_chain(fewest=3), LEANS)
def test_the_zero_mode_decays_by_e_over_a_penetration_depth(chain: Chain, lean: int) -> None:
    depth = penetration_depth(chain)
    assume(depth > chain.spacing / 100)
    mode = np.abs(zero_mode(chain, chain.uniform_state(lean)))
    ratio = mode[-2] / mode[-1] if lean > 0 else mode[1] / mode[0]
    assert ratio == pytest.approx(math.exp(-chain.spacing / depth), rel=1e3 * EPS, abs=1e3 * EPS)


def test_the_zero_mode_of_d_1_does_not_reach_beyond_its_edge() -> None:
    chain = Chain(5, spacing=0.1, rotor_length=0.1, rest_angle=math.asin(0.5))
    mode = np.abs(zero_mode(chain, chain.uniform_state(-1)))
    assert mode == pytest.approx([1, 0, 0, 0, 0], abs=4 * EPS)
    assert 0 <= penetration_depth(chain) < chain.spacing / 30


@given(any_chain(), LEANS)
def test_the_winding_number_counts_the_turns_of_the_determinant(chain: Chain, lean: int) -> None:
    plus, minus = couplings(chain, lean)
    assume(abs(plus**2 - minus**2) > 0.01 * plus**2)
    zone = np.linspace(-np.pi, np.pi, 2001)
    determinants = [
        np.linalg.det(np.array([[plus, minus], [minus * np.exp(1j * k), plus]])) for k in zone
    ]
    turns = np.unwrap(np.angle(determinants))
    assert round((turns[-1] - turns[0]) / (2 * np.pi)) == winding_number(chain, lean)


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_winding_number_is_1_leaning_left_and_0_leaning_right(
    example: tuple[float, float],
) -> None:
    chain = chain_of(example, 2)
    assert (winding_number(chain, -1), winding_number(chain, 1)) == (1, 0)


@pytest.mark.parametrize(
    ('example', 'expected'),
    [(FLIPPER, 0.81187), ((0.5, 0.1), 0.14083), ((2.0, 1.18), 0.41801), ((4.0, 0.9), 0.24509)],
)
def test_the_gaps_of_the_papers_chains_are_those_of_an_independent_program(
    example: tuple[float, float], expected: float
) -> None:
    chain = chain_of(example, 2)
    assert gap(chain) * chain.time_unit == pytest.approx(expected, abs=5e-6)


@pytest.mark.parametrize('branch', [0, 2])
def test_a_branch_that_is_neither_upper_nor_lower_is_refused(branch: int) -> None:
    with pytest.raises(ValueError, match=f'branch = {branch} must be'):
        dispersion(chain_of(FLIPPER, 2), 0.0, branch)
