# SPDX-License-Identifier: Apache-2.0
"""Laws of the normal modes: closed forms, their digits, energies, and the motion they predict."""

import dataclasses
import math

import numpy as np
import pytest
from chains import EPS, EXAMPLES, FLIPPER, SPINNER, WIDE_FLIPPER, WOBBLER, any_chain, chain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import wall_between
from mpmath import mp, mpf

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.bands import band_edges, density_of_states, dispersion
from soliton_linkage.linear.normal_modes import (
    NormalModes,
    mode_density,
    mode_energies,
    mode_frequencies,
    normal_modes,
    phonon_energies,
    phonon_energy,
)
from soliton_linkage.linear.rigidity import (
    dynamical_matrix,
    mode_towards_last,
    rigidity_bands,
    rigidity_matrix,
    zero_mode,
)
from soliton_linkage.linear.statics import rest_state, unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations, drawn_deviations

LEANS = st.sampled_from([-1, 1])


def rounding(chain: Chain) -> float:
    """Rounding error of a frequency [rad/s]: of two levers per row, and of the solver."""
    levers = 32 * EPS * (1 + chain.rotor_length / chain.rest_length) / chain.time_unit
    return levers + 16 * math.sqrt(chain.number_of_rotors) * EPS * band_edges(chain)[1]


def disordered(example: tuple[float, float], rotors: int, periodic: bool = False) -> Chain:
    spread = dict.fromkeys(['spacing', 'rotor_length', 'rest_length'], 0.003)
    deviations = drawn_deviations(rotors, 5, periodic, mass=0.1, stiffness=0.1, **spread)
    chain = chain_of(example, rotors)
    return dataclasses.replace(chain, periodic=periodic, deviations=deviations)


def relaxed_states(example: tuple[float, float]) -> list[tuple[Chain, Array]]:
    """Return chains of each kind, with a wall or without, with relaxed springs."""
    even, deviating = chain_of(example, 20), disordered(example, 20)
    ring = dataclasses.replace(even, periodic=True)
    uneven_ring = disordered(example, 20, periodic=True)
    return [
        (even, even.uniform_state(1)),
        (even, unstretched(even, wall_between(even, 9))),
        (deviating, rest_state(deviating, -1)),
        (deviating, unstretched(deviating, wall_between(even, 9))),
        (ring, ring.uniform_state(-1)),
        (uneven_ring, rest_state(uneven_ring, 1)),
    ]


RELAXED = [
    pytest.param(*relaxed_states(example)[number], id=f'{example}-{number}')
    for number, example in enumerate((FLIPPER, WOBBLER, SPINNER, WOBBLER, SPINNER, FLIPPER))
]


def random_motion(chain: Chain, size: float = 1.0, seed: int = 7) -> tuple[Array, Array]:
    """Return small displacements [rad] and rates [rad/s] of comparable energy."""
    generator = np.random.default_rng(seed)
    displacement, rates = size * generator.standard_normal((2, chain.number_of_rotors))
    return displacement, rates / chain.time_unit


def total_energy(chain: Chain, angles: Array, rates: Array) -> float:
    return float(chain.elastic_energy(angles) + chain.kinetic_energy(rates))


@given(any_chain(most=30), LEANS)
def test_the_frequencies_of_a_free_chain_have_their_closed_form(chain, lean):
    rotors = chain.number_of_rotors
    wave_numbers = np.pi * np.arange(1, rotors) / (rotors * chain.spacing)
    expected = np.concatenate([[0.0], np.sort(dispersion(chain, wave_numbers))])
    for frequencies in (
        normal_modes(chain, chain.uniform_state(lean)).frequencies,
        mode_frequencies(chain, chain.uniform_state(lean)),
    ):
        assert frequencies == pytest.approx(expected, rel=0, abs=rounding(chain))
        assert frequencies[0] == 0
        assert (np.diff(frequencies) >= 0).all()


@given(any_chain(fewest=3, most=30), LEANS, st.sampled_from([-1, 1]))
def test_the_frequencies_of_a_ring_are_those_of_either_branch(chain, lean, branch):
    rotors = chain.number_of_rotors // 2 * 2
    ring = dataclasses.replace(chain, number_of_rotors=rotors, periodic=True)
    wave_numbers = 2 * np.pi * np.arange(rotors) / (rotors * chain.spacing)
    expected = np.sort(dispersion(chain, wave_numbers, branch))
    modes = normal_modes(ring, ring.uniform_state(lean))
    assert modes.frequencies == pytest.approx(expected, rel=0, abs=rounding(ring))


@settings(max_examples=30)
@given(any_chain(fewest=3, most=7), LEANS, st.data())
def test_frequencies_have_the_digits_of_the_levers_down_to_rounding_of_the_largest(
    chain, lean, data
):
    # Masses that differ by up to 1e12 spread the frequencies over six orders of magnitude.
    powers = data.draw(
        st.lists(st.floats(-9, 3), min_size=(n := chain.number_of_rotors), max_size=n)
    )
    masses = tuple(10**power - 1 for power in powers)
    heavy = dataclasses.replace(chain, deviations=Deviations(mass=masses))
    angles = heavy.uniform_state(lean)
    with mp.workdps(60):
        weighted = mp.zeros(n - 1, n)
        for spring, (first, second) in enumerate(np.stack(rigidity_bands(heavy, angles), axis=1)):
            for rotor, lever in ((spring, first), (spring + 1, second)):
                inertia = mpf(heavy.moments_of_inertia[rotor])
                weighted[spring, rotor] = mpf(lever) * mp.sqrt(heavy.stiffness / inertia)
        squares = mp.eigsy(weighted * weighted.T, eigvals_only=True)
        expected = np.array([0.0, *sorted(float(mp.sqrt(abs(square))) for square in squares)])
    limit = 32 * EPS * expected[-1]
    assert normal_modes(heavy, angles).frequencies == pytest.approx(expected, rel=0, abs=limit)
    assert mode_frequencies(heavy, angles) == pytest.approx(expected, rel=0, abs=limit)


@pytest.mark.parametrize(('chain', 'angles'), RELAXED)
def test_shapes_are_orthonormal_eigenvectors_and_the_slowest_is_the_zero_mode(chain, angles):
    modes = normal_modes(chain, angles)
    weighted = np.sqrt(chain.moments_of_inertia)[:, None] * modes.shapes
    assert np.abs(weighted.T @ weighted - np.eye(chain.number_of_rotors)).max() <= 100 * EPS
    forces = dynamical_matrix(chain, angles) @ weighted
    limit = 100 * EPS * modes.frequencies[-1] ** 2
    assert np.abs(forces - weighted * modes.frequencies**2).max() <= limit
    if chain.periodic:
        assert modes.frequencies[0] > 1e-3 * modes.frequencies[-1]
        return
    mode = zero_mode(chain, angles)
    shape = modes.shapes[:, 0] / np.linalg.norm(modes.shapes[:, 0])
    # Where the other modes begin above a gap, that is how far rounding turns a shape.
    limit = 100 * EPS * modes.frequencies[-1] / modes.frequencies[1]
    assert np.abs(shape * np.sign(shape @ mode) - mode).max() <= limit


@pytest.mark.parametrize(('chain', 'angles'), RELAXED)
def test_energies_of_modes_add_up_to_that_of_the_linearised_springs(chain, angles):
    displacement, rates = random_motion(chain)
    energies = mode_energies(normal_modes(chain, angles), displacement, rates)
    stretches = rigidity_matrix(chain, angles) @ displacement
    expected = 0.5 * chain.stiffnesses @ stretches**2 + chain.kinetic_energy(rates)
    assert energies.sum() == pytest.approx(expected, rel=200 * EPS)
    assert (energies >= 0).all()


@pytest.mark.parametrize(('chain', 'angles'), RELAXED)
def test_energies_of_phonons_add_up_to_the_whole_to_third_order(chain, angles):
    sizes = np.array([4e-4, 2e-4, 1e-4])
    errors = []
    for size in sizes:
        displacement, rates = random_motion(chain, size)
        _, energies = phonon_energies(chain, angles + displacement, rates)
        errors.append(energies.sum() - total_energy(chain, angles + displacement, rates))
    orders = np.diff(np.log(np.abs(errors))) / np.diff(np.log(sizes))
    assert orders == pytest.approx(3, abs=0.1)


@pytest.mark.parametrize(('chain', 'angles'), RELAXED[:4])
def test_a_nudge_along_the_zero_mode_gives_no_energy_to_phonons(chain, angles):
    rates = 3 / chain.time_unit * zero_mode(chain, angles)
    whole = total_energy(chain, angles, rates)
    assert phonon_energy(chain, angles, rates) <= 1e-20 * whole
    _, energies = phonon_energies(chain, angles, rates)
    assert energies[0] == pytest.approx(whole, rel=100 * EPS)


@pytest.mark.parametrize(('chain', 'angles'), RELAXED)
def test_a_mode_vibrates_at_its_frequency_up_to_second_order(chain, angles):
    modes = normal_modes(chain, angles)
    number = chain.number_of_rotors // 2
    shape, omega = modes.shapes[:, number], modes.frequencies[number]
    shape = shape / np.abs(shape).max()
    period = 2 * np.pi / omega / 16
    sizes = np.array([2e-4, 1e-4])
    errors = []
    for size in sizes:
        start = angles + size * shape
        motion = simulate(chain, start, 0 * start, 40 * period, period, 1e-13)
        expected = angles + size * np.cos(omega * motion.times)[:, None] * shape
        errors.append(np.abs(motion.angles - expected).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert errors[1] < 0.05 * sizes[1]


def test_a_slow_wall_keeps_energy_out_of_its_zero_mode_as_the_fourth_power_of_its_speed():
    chain = chain_of(WIDE_FLIPPER, 40)
    start = unstretched(chain, wall_between(chain, 19))
    kept = []
    for speed in (4e-3, 2e-3):
        rate = speed * chain.spacing / chain.rotor_length / chain.time_unit
        kick = rate * mode_towards_last(chain, start)
        motion = simulate(chain, start, kick, 200 * chain.time_unit, chain.time_unit)
        states = zip(motion.angles[1:], motion.rates[1:], strict=True)
        kept.append(np.mean([phonon_energy(chain, *state) for state in states]))
    assert math.log2(kept[0] / kept[1]) == pytest.approx(4, abs=0.1)


def test_the_modes_of_a_long_chain_have_the_density_of_states():
    for example in EXAMPLES:
        chain = chain_of(example, 500)
        lowest, highest = band_edges(chain)
        frequencies = mode_frequencies(chain, chain.uniform_state(-1))
        edges = np.linspace(lowest, highest, 12)
        edges[[0, -1]] = 0.9 * lowest, 1.1 * highest
        counts = mode_density(frequencies, edges) * np.diff(edges) * 500
        squares = np.clip(edges, lowest, highest) ** 2
        shares = (squares - lowest**2) / (highest**2 - lowest**2)
        phases = 2 * np.arcsin(np.sqrt(np.clip(shares, 0, 1)))
        # Wave numbers lie pi / 500 apart, and one mode is the zero mode.
        assert np.abs(counts - 500 * np.diff(phases) / np.pi).max() <= 1
        middle = (edges[5] + edges[6]) / 2
        assert counts[5] / 500 / (edges[6] - edges[5]) == pytest.approx(
            float(density_of_states(chain, middle)), rel=0.1
        )


def test_a_hundred_thousand_rotors_have_an_energy_of_phonons():
    chain = chain_of(FLIPPER, 100_000)
    angles = chain.uniform_state(1)
    displacement, rates = random_motion(chain, 1e-5)
    energy = phonon_energy(chain, angles + displacement, rates)
    # The zero mode is one of them, and the rest of the difference is of third order.
    whole = total_energy(chain, angles + displacement, rates)
    assert energy == pytest.approx(whole, rel=3e-4)


def test_modes_about_stretched_springs_are_rejected():
    chain = chain_of(FLIPPER, 5)
    angles = chain.uniform_state(1) + 0.1 * np.eye(5)[2]
    for function in (normal_modes, mode_frequencies):
        with pytest.raises(ValueError, match=r'spring \d is stretched by .* more than 1e-06'):
            function(chain, angles)


def test_angles_and_rates_that_do_not_fit_the_chain_are_rejected():
    chain = chain_of(FLIPPER, 5)
    angles, zeros = chain.uniform_state(1), np.zeros(5)
    for wrong in (zeros[:4], np.array([0, 0, np.nan, 0, 0])):
        for function in (normal_modes, mode_frequencies):
            with pytest.raises(ValueError, match='angle'):
                function(chain, wrong)
        for function in (phonon_energies, phonon_energy):
            with pytest.raises(ValueError, match='angle'):
                function(chain, wrong, zeros)
            with pytest.raises(ValueError, match='rate'):
                function(chain, angles, wrong)


def test_a_motion_that_does_not_fit_the_modes_is_rejected():
    for shape in [(4,), (2, 6), ()]:
        chain = chain_of(FLIPPER, 5)
        modes: NormalModes = normal_modes(chain, chain.uniform_state(1))
        wrong, fitting = np.zeros(shape), np.zeros(5)
        with pytest.raises(ValueError, match=r'displacements of shape .* the modes of 5 rotors'):
            mode_energies(modes, wrong, fitting)
        with pytest.raises(ValueError, match=r'rates of shape .* the modes of 5 rotors'):
            mode_energies(modes, fitting, wrong)


def test_a_density_of_no_frequencies_or_without_bins_is_rejected():
    for frequency in [np.nan, np.inf, -1.0]:
        with pytest.raises(ValueError, match=rf'frequency = {frequency} rad/s must be'):
            mode_density([1.0, frequency], [0.0, 2.0])
        with pytest.raises(ValueError, match='density of 0 modes'):
            mode_density([], [0.0, 2.0])
    for edges in [[0.0], [0.0, 0.0], [2.0, 1.0], [[0.0, 1.0]], [0.0, np.inf]]:
        with pytest.raises(ValueError, match=r'edges of bins = .* in ascending order'):
            mode_density([1.0], edges)
