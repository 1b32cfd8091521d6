# SPDX-License-Identifier: Apache-2.0
"""Linear theory in closed form against the rigidity matrix, its spectrum and its zero modes."""

import dataclasses
import math

import numpy as np
import pytest
from chains import EPS, FLIPPER, any_chain, chain_of
from exact_bands import ANY_LEAN_RATIO, exact
from hypothesis import assume, given
from hypothesis import strategies as st
from mpmath import mp, mpf

from soliton_linkage.linear.bands import (
    band_edges,
    bloch_dynamical_matrix,
    bloch_matrix,
    couplings,
    density_of_states,
    dispersion,
    gap,
    largest_group_velocity,
    penetration_depth,
    speed_of_sound,
    tail_ratio,
    winding_number,
    zero_mode_wave_number,
)
from soliton_linkage.linear.rigidity import (
    dynamical_matrix,
    mode_centre,
    rigidity_bands,
    rigidity_matrix,
    zero_mode,
)
from soliton_linkage.linkage.chain import Chain

LEANS = st.sampled_from([-1, 1])
NEAR_AN_EDGE = st.builds(
    lambda edge, away: edge + away, st.sampled_from([0, math.pi]), st.floats(-1e-3, 1e-3)
)
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(200)


def scale(chain: Chain) -> float:
    """Largest angular frequency of a phonon [rad/s]."""
    plus, minus = map(abs, couplings(chain))
    return (plus + minus) / (chain.rotor_length * chain.time_unit)


def rounding_of_levers(chain: Chain) -> float:
    """Rounding error of a lever [m/rad]: EPS of r, as often as r contributes to lengths."""
    return 16 * EPS * chain.rotor_length * (1 + chain.rotor_length / chain.rest_length)


def rounding_of_frequencies(chain: Chain) -> float:
    """The same for singular values of R, which has two levers a row, as frequencies [rad/s].

    The values themselves are found to EPS of the largest, times a few.
    """
    of_levers = 2 * rounding_of_levers(chain) / (chain.rotor_length * chain.time_unit)
    return of_levers + 32 * EPS * scale(chain)


@given(any_chain(), LEANS)
def test_couplings_are_the_levers_of_the_uniform_state_in_staggered_angles(chain, lean):
    plus, minus = couplings(chain, lean)
    first, second = rigidity_bands(chain, chain.uniform_state(lean))
    signs = (-1.0) ** np.arange(chain.number_of_rotors)
    limit = rounding_of_levers(chain)
    assert first * signs[:-1] == pytest.approx(-plus, rel=0, abs=limit)
    assert second * signs[1:] == pytest.approx(-minus, rel=0, abs=limit)


@given(any_chain(), LEANS)
def test_the_winding_number_counts_the_turns_of_the_determinant(chain, lean):
    plus, minus = couplings(chain, lean)
    assume(abs(plus**2 - minus**2) > 0.01 * plus**2)
    zone = np.linspace(-np.pi, np.pi, 2001) / (2 * chain.spacing)
    determinants = np.linalg.det(bloch_matrix(chain, zone, lean))
    turns = np.unwrap(np.angle(determinants))
    assert round((turns[-1] - turns[0]) / (2 * np.pi)) == winding_number(chain, lean)


@given(any_chain(fewest=4, most=20), LEANS)
def test_the_bloch_matrix_leads_from_waves_in_a_ring_to_its_extensions(chain, lean):
    cells = chain.number_of_rotors // 2
    ring = dataclasses.replace(chain, number_of_rotors=2 * cells, periodic=True)
    matrix = rigidity_matrix(ring, ring.uniform_state(lean))
    for cell in range(cells):
        wave_number = np.pi * cell / (cells * chain.spacing)
        waves = np.exp(2j * np.pi * cell * np.arange(cells) / cells)
        for sort, amplitudes in enumerate(np.eye(2)):
            turned = np.kron(waves, amplitudes * [1, -1])
            expected = np.kron(waves, bloch_matrix(chain, wave_number, lean)[:, sort])
            limit = 2 * rounding_of_levers(chain) + 32 * EPS * cells * couplings(chain)[0]
            assert np.abs(matrix @ turned - expected).max() <= limit


@given(any_chain(fewest=4, most=20), LEANS)
def test_the_bloch_dynamical_matrices_have_the_spectrum_of_the_ring(chain, lean):
    cells = chain.number_of_rotors // 2
    ring = dataclasses.replace(chain, number_of_rotors=2 * cells, periodic=True)
    matrix = dynamical_matrix(ring, ring.uniform_state(lean)).toarray()
    wave_numbers = np.pi * np.arange(cells) / (cells * chain.spacing)
    squares = np.linalg.eigvalsh(bloch_dynamical_matrix(chain, wave_numbers, lean))
    assert np.linalg.eigvalsh(matrix) == pytest.approx(
        np.sort(squares.ravel()), rel=0, abs=4 * scale(chain) * rounding_of_frequencies(chain)
    )


@given(ANY_LEAN_RATIO)
def test_couplings_and_band_edges_have_the_digits_of_an_exact_evaluation(chain):
    with mp.workdps(40):
        truth = exact(chain)
        sizes = sorted(map(abs, (truth.plus + truth.minus, truth.plus - truth.minus)))
        edges = [float(size / truth.unit) for size in sizes]
        plus, minus = couplings(chain)
        # Where the difference in q- cancels its input alone is uncertain by as much.
        assert abs(plus - truth.plus) <= 8 * EPS * truth.plus
        assert abs(minus - truth.minus) <= 8 * EPS * truth.plus
    assert band_edges(chain) == pytest.approx(edges, rel=8 * EPS, abs=0)
    assert gap(chain) == band_edges(chain)[0]


@given(ANY_LEAN_RATIO, st.one_of(st.floats(-30, 30), NEAR_AN_EDGE), st.sampled_from([-1, 1]))
def test_the_dispersion_has_the_digits_of_an_exact_evaluation(chain, phase, branch):
    wave_number = phase / chain.spacing
    with mp.workdps(40):
        square = exact(chain).squared_frequency(mpf(wave_number * chain.spacing), branch)
        expected = float(mp.sqrt(square))
    assert dispersion(chain, wave_number, branch) == pytest.approx(expected, rel=16 * EPS, abs=0)


@given(ANY_LEAN_RATIO)
def test_the_speed_of_sound_is_the_curvature_at_the_bottom_of_the_band(chain):
    with mp.workdps(60):
        truth = exact(chain)
        bottom = 0 if truth.minus < 0 else mp.pi
        away = mpf('1e-12')
        rise = truth.squared_frequency(bottom + away, 1) - truth.squared_frequency(bottom, 1)
        square = float(rise * mpf(chain.spacing) ** 2 / away**2)
        largest = float((truth.plus / truth.unit) ** 2) * chain.spacing**2
    assert speed_of_sound(chain) ** 2 == pytest.approx(square, rel=0, abs=32 * EPS * largest)


@given(ANY_LEAN_RATIO)
def test_the_largest_group_velocity_is_the_slope_at_its_wave_number(chain):
    with mp.workdps(60):
        truth = exact(chain)
        where = mp.acos(-truth.minus / truth.plus)
        around = [where - mpf('1e-20'), where + mpf('1e-20')]
        ends = [mp.sqrt(truth.squared_frequency(phase, 1)) for phase in around]
        slope = abs(ends[1] - ends[0]) / (around[1] - around[0]) * mpf(chain.spacing)
        largest = truth.plus / truth.unit * mpf(chain.spacing)
        assert abs(largest_group_velocity(chain) - slope) <= 16 * EPS * largest


@given(ANY_LEAN_RATIO)
def test_the_penetration_depth_has_the_digits_of_an_exact_evaluation(chain):
    assume(chain.lean_ratio != 1)
    smaller = min(chain.lean_ratio, 1 / chain.lean_ratio)
    sensitivity = 1 + smaller / ((1 - smaller**2) * math.atanh(smaller))
    with mp.workdps(60):
        truth = exact(chain)
        assume(truth.minus != 0)
        expected = mpf(chain.spacing) / mp.log(abs(truth.plus / truth.minus))
        error = abs(penetration_depth(chain) / expected - 1)
    assert error <= 8 * EPS * sensitivity


@given(any_chain(fewest=3), LEANS)
def test_the_zero_mode_is_a_wave_of_its_complex_wave_number(chain, lean):
    depth = penetration_depth(chain)
    assume(depth > chain.spacing / 30)
    wave_number = zero_mode_wave_number(chain, lean)
    angles = chain.uniform_state(lean)
    mode = zero_mode(chain, angles) * (-1.0) ** np.arange(chain.number_of_rotors)
    plus, minus = couplings(chain)
    # Levers of the state are off by their rounding, next to the smaller coupling.
    limit = 64 * EPS + 2 * rounding_of_levers(chain) * (1 / plus + 1 / abs(minus))
    near_the_edge = mode[1] / mode[0] if lean < 0 else mode[-1] / mode[-2]
    assert abs(np.exp(1j * wave_number * chain.spacing) / near_the_edge - 1) <= limit
    assert -(near_the_edge**-lean) == pytest.approx(
        tail_ratio(chain), rel=1e3 * EPS, abs=1e3 * EPS
    )
    assert abs(wave_number.imag) == pytest.approx(1 / depth, rel=4 * EPS)
    assert wave_number.real == (math.pi / chain.spacing if chain.lean_ratio > 1 else 0)


@given(any_chain(fewest=4), LEANS)
def test_the_zero_mode_is_at_the_edge_of_its_wave_number_and_the_winding_number(chain, lean):
    assume(abs(chain.lean_ratio - 1) > 1e-6)
    at_the_first_edge = winding_number(chain, lean) == 1
    assert (zero_mode_wave_number(chain, lean).imag > 0) == at_the_first_edge
    centre = mode_centre(zero_mode(chain, chain.uniform_state(lean)))
    assert (centre < (chain.number_of_rotors - 1) / 2) == at_the_first_edge


def test_at_d_1_the_band_is_flat_and_the_zero_mode_decays_at_once():
    angle = next(
        float(angle)
        for angle in 0.5235987755982988 + 1e-16 * np.arange(-5, 6)
        if 2 * math.sin(angle) == 1
    )
    chain = Chain(6, spacing=0.1, rotor_length=0.1, rest_angle=angle)
    assert chain.lean_ratio == 1
    lowest, highest = band_edges(chain)
    assert lowest == highest
    assert dispersion(chain, np.linspace(-40, 40, 9)) == pytest.approx(lowest, rel=4 * EPS)
    assert speed_of_sound(chain) == largest_group_velocity(chain) == penetration_depth(chain) == 0
    assert zero_mode_wave_number(chain) == complex(0, -math.inf)
    assert zero_mode_wave_number(chain, -1) == complex(0, math.inf)
    assert density_of_states(chain, [0.9 * lowest, lowest, 1.1 * lowest]).tolist() == [
        0,
        math.inf,
        0,
    ]


@given(any_chain(), st.floats(0.3, 2.8))
def test_the_density_of_states_is_that_of_evenly_spaced_wave_numbers(chain, phase):
    lowest, highest = band_edges(chain)
    assume(highest - lowest > 1e-3 * highest)
    omega = dispersion(chain, phase / chain.spacing)
    with mp.workdps(40):
        truth = exact(chain)
        slope = truth.plus * truth.minus * mp.sin(mpf(phase)) / truth.unit**2 / mpf(float(omega))
        expected = float(1 / (mp.pi * abs(slope)))
    sensitivity = highest / min(omega - lowest, highest - omega)
    assert density_of_states(chain, omega) == pytest.approx(
        expected, rel=32 * EPS * sensitivity, abs=0
    )


def test_invalid_arguments_are_rejected():
    chain = chain_of(FLIPPER, 2)
    for wrong in [math.nan, math.inf, -math.inf]:
        for function in (dispersion, bloch_matrix, bloch_dynamical_matrix):
            with pytest.raises(ValueError, match=r'wave number = .* rad/m must be a finite'):
                function(chain, [0.0, wrong])
    for wrong in [math.nan, math.inf, -1.0]:
        with pytest.raises(ValueError, match=f'frequency = {wrong} rad/s must be a finite'):
            density_of_states(chain, [1.0, wrong])
    for wrong in [0, 2]:
        with pytest.raises(ValueError, match=f'branch = {wrong} must be'):
            dispersion(chain, 0.0, wrong)
        for function in (couplings, winding_number, zero_mode_wave_number):
            with pytest.raises(ValueError, match=f'lean = {wrong} must be'):
                function(chain, wrong)
