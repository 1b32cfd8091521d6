# SPDX-License-Identifier: Apache-2.0
"""Laws of chains whose rotors and springs differ and whose ends may be periodic."""

import dataclasses
import math

import mpmath
import numpy as np
import pytest
from chains import EPS, any_chain
from deviating_chains import (
    any_deviating_chain,
    any_deviating_configuration,
    bare_springs,
    reach,
    rounding,
    shortest_length,
)
from hypothesis import assume, given
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations


@given(any_deviating_configuration())
def test_extensions_of_springs_that_differ_are_rounded_less_than_their_lengths(configuration):
    chain, angles = configuration
    extensions = chain.spring_extensions(angles)
    with mpmath.workdps(40):
        places = [
            (r * mpmath.sin(phi), r * mpmath.cos(phi))
            for r, phi in zip(
                map(mpmath.mpf, chain.rotor_lengths), map(mpmath.mpf, angles), strict=True
            )
        ]
        for n, extension in enumerate(extensions):
            (h, v), (h_after, v_after) = places[n], places[(n + 1) % len(places)]
            across = mpmath.mpf(chain.spacings[n]) + h_after - h
            exact = mpmath.hypot(across, v_after - v) - mpmath.mpf(chain.rest_lengths[n])
            assert abs(extension - exact) <= rounding(chain)


@given(any_deviating_configuration())
def test_springs_energy_and_torques_agree_with_their_bare_twins_one_by_one(configuration):
    chain, angles = configuration
    shortest = shortest_length(chain, angles)
    assume(shortest > 1e-3 * reach(chain))
    extensions, first, second = chain.springs(angles)
    bare, bare_first, bare_second = bare_springs(chain, angles)
    limit = rounding(chain) + 8 * EPS * reach(chain)
    assert extensions == pytest.approx(bare, rel=0, abs=limit)
    # A lever is a rotor's length times a sine, whose angle is rounded with the direction.
    of_levers = 16 * EPS * reach(chain) ** 2 / shortest
    assert first == pytest.approx(bare_first, rel=0, abs=of_levers)
    assert second == pytest.approx(bare_second, rel=0, abs=of_levers)
    stiffest = float(chain.stiffnesses.max())
    assert chain.elastic_energy(angles) == pytest.approx(
        math.fsum(0.5 * chain.stiffnesses * bare**2),
        rel=8 * EPS,
        abs=chain.number_of_springs * stiffest * reach(chain) * limit,
    )
    tensions, torques = chain.stiffnesses * bare, np.zeros(chain.number_of_rotors)
    for n in range(chain.number_of_springs):
        torques[n] -= tensions[n] * bare_first[n]
        torques[(n + 1) % chain.number_of_rotors] -= tensions[n] * bare_second[n]
    lever = float(chain.rotor_lengths.max())
    assert chain.spring_torques(angles) == pytest.approx(
        torques, rel=0, abs=2 * stiffest * (lever * limit + reach(chain) * of_levers)
    )


@given(any_chain(), st.booleans(), st.lists(st.floats(-0.9, 3), min_size=5, max_size=5))
def test_rotors_and_springs_that_deviate_alike_are_a_chain_of_other_parameters(
    chain, periodic, fractions
):
    rotors = chain.number_of_rotors + chain.number_of_rotors % 2
    chain = dataclasses.replace(chain, number_of_rotors=rotors, periodic=periodic, damping=0.1)
    springs, (a, r, mass, stiffness, damping) = chain.number_of_springs, fractions
    scaled = dataclasses.replace(
        chain,
        spacing=chain.spacing * (1 + a),
        rotor_length=chain.rotor_length * (1 + r),
        mass=chain.mass * (1 + mass),
        stiffness=chain.stiffness * (1 + stiffness),
        damping=chain.damping * (1 + damping),
    )
    drawn = Deviations(
        spacing=(a,) * springs,
        rotor_length=(r,) * rotors,
        mass=(mass,) * rotors,
        stiffness=(stiffness,) * springs,
        rest_length=(scaled.rest_length / chain.rest_length - 1,) * springs,
        damping=(damping,) * rotors,
    )
    same = dataclasses.replace(chain, deviations=drawn)
    for name in ('spacings', 'rotor_lengths', 'stiffnesses', 'masses', 'dampings'):
        assert getattr(same, name) == pytest.approx(getattr(scaled, name), rel=4 * EPS)
    assert same.moments_of_inertia == pytest.approx(scaled.moment_of_inertia, rel=16 * EPS)
    assert same.rest_lengths == pytest.approx(
        scaled.rest_lengths, rel=0, abs=8 * EPS * (chain.rest_length + scaled.rest_length)
    )


@given(any_deviating_chain())
def test_kinetic_energy_counts_each_mass_at_its_own_speed(chain):
    rates = np.linspace(-3, 5, chain.number_of_rotors)
    speeds = chain.rotor_lengths * rates
    expected = math.fsum(0.5 * chain.masses * speeds**2)
    assert chain.kinetic_energy(rates) == pytest.approx(expected, rel=16 * EPS)


def test_a_periodic_chain_of_odd_number_is_rejected():
    for rotors in [3, 41]:
        with pytest.raises(
            ValueError, match=f'number_of_rotors = {rotors} must be even if the ends are periodic'
        ):
            Chain(rotors, periodic=True)


def test_a_damping_that_would_drive_is_rejected():
    for damping in [-1e-9, math.nan, math.inf]:
        with pytest.raises(ValueError, match=rf'Chain\.damping = {damping} must (be|lie)'):
            Chain(damping=damping)


def test_deviations_of_another_chain_are_rejected():
    for periodic, springs in [(False, 5), (True, 6)]:
        for count in {5, 6, 7} - {springs}:
            drawn = Deviations(stiffness=(0.1,) * count)
            with pytest.raises(
                ValueError, match=f'{count} deviations of stiffness .* {springs} spr'
            ):
                Chain(6, periodic=periodic, deviations=drawn)
        with pytest.raises(
            ValueError, match='5 deviations of mass do not fit a chain of 6 rotors'
        ):
            Chain(6, periodic=periodic, deviations=Deviations(mass=(0.1,) * 5))
