# SPDX-License-Identifier: Apache-2.0
"""Drawn deviations: one seed, one chain; independent, normal and of the size asked for."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.deviations import (
    NO_DEVIATIONS,
    Deviations,
    Disorder,
    drawn_deviations,
)

NAMES = tuple(field.name for field in dataclasses.fields(Deviations))
OF_SPRINGS = ('spacing', 'stiffness', 'rest_length', 'non_reciprocity')
POSITIVE = ('spacing', 'rotor_length', 'mass', 'stiffness', 'rest_length', 'damping')
SEEDS = st.integers(0, 2**64)


@given(SEEDS, st.integers(2, 50), st.booleans())
def test_the_same_seed_draws_the_same_deviations(seed, rotors, periodic):
    fractions = dict.fromkeys(NAMES, 0.01)
    first, second = (drawn_deviations(rotors, seed, periodic, **fractions) for _ in range(2))
    assert first == second
    assert first != drawn_deviations(rotors, seed + 1, periodic, **fractions)


@given(SEEDS, st.integers(2, 50), st.sets(st.sampled_from(NAMES), min_size=1))
def test_the_draws_of_a_quantity_do_not_depend_on_others(seed, rotors, names):
    together = drawn_deviations(rotors, seed, **dict.fromkeys(NAMES, 0.01))
    some = drawn_deviations(rotors, seed, **dict.fromkeys(sorted(names), 0.01))
    for name in NAMES:
        assert getattr(some, name) == (getattr(together, name) if name in names else ())


@given(SEEDS, st.sampled_from(NAMES), st.floats(0, 0.05))
def test_a_draw_scales_with_its_fraction(seed, name, fraction):
    unit = np.array(getattr(drawn_deviations(30, seed, **{name: 0.0625}), name)) / 0.0625
    drawn = getattr(drawn_deviations(30, seed, **{name: fraction}), name)
    assert np.array_equal(drawn, fraction * unit)


def test_there_is_one_fraction_a_rotor_or_one_a_spring():
    for name in NAMES:
        for periodic in [False, True]:
            drawn = drawn_deviations(20, 3, periodic, **{name: 0.01})
            drawn.check_fit(20, 20 if periodic else 19)
            assert len(getattr(drawn, name)) == (19 if name in OF_SPRINGS and not periodic else 20)


def test_deviations_are_normal_with_the_standard_deviation_asked_for():
    for name in NAMES:
        count = 40_000
        drawn = np.array(getattr(drawn_deviations(count, 7, True, **{name: 0.05}), name)) / 0.05
        # Five standard errors of the mean, the variance and the fourth moment of a normal draw.
        assert abs(drawn.mean()) <= 5 / math.sqrt(count)
        assert abs(np.mean(drawn**2) - 1) <= 5 * math.sqrt(2 / count)
        assert abs(np.mean(drawn**4) - 3) <= 5 * math.sqrt(96 / count)


def test_quantities_and_neighbours_deviate_independently():
    count = 40_000
    drawn = drawn_deviations(count, 7, True, **dict.fromkeys(NAMES, 0.05))
    draws = np.array([getattr(drawn, name) for name in NAMES])
    draws = np.concatenate([draws, np.roll(draws, 1, axis=1)])
    correlations = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlations).max() <= 5 / math.sqrt(count)


def test_a_fraction_of_0_changes_nothing():
    drawn = drawn_deviations(5, 1, **dict.fromkeys(NAMES, 0.0))
    for name in NAMES:
        assert not np.any(getattr(drawn, name))
    assert drawn_deviations(5, 1) == NO_DEVIATIONS


def test_invalid_draws_are_rejected():
    whole = 'must be a whole number >='
    for rotors, seed, fractions, complaint in [
        *(
            (5, 1, {'mass': bad}, f'deviation of mass = {bad} must be .* >= 0')
            for bad in (-0.01, math.nan, math.inf)
        ),
        (5, 1, {'rest_angle': 0.01}, f"'rest_angle'; must be one of {', '.join(NAMES)}"),
        (1000, 1, {'spacing': 1.0}, r'deviation \d+ of spacing = -.* above -1'),
        *((5, bad, {}, f'seed = {bad!r} {whole} 0') for bad in (-1, 1.5, '3', None, math.nan)),
        *((bad, 0, {}, f'number_of_rotors = {bad} {whole} 2') for bad in (-1, 0, 1, 2.5)),
    ]:
        with pytest.raises(ValueError, match=complaint):
            drawn_deviations(rotors, seed, **fractions)


def test_a_fraction_that_leaves_nothing_is_rejected_by_site():
    for name in POSITIVE:
        for fraction in [-1.0, -1.5, math.nan, math.inf, -math.inf]:
            complaint = re.escape(
                f'deviation 2 of {name} = {fraction:g} must be a finite number above -1'
            )
            with pytest.raises(ValueError, match=complaint):
                Deviations(**{name: (0.0, -0.99, fraction, -2.0)})


def test_fractions_of_forces_may_cancel_them_but_have_bounds():
    for name in sorted(set(NAMES) - set(POSITIVE)):
        for fraction in [-1001.0, math.nan, math.inf]:
            assert getattr(Deviations(**{name: (-1.0, 0.5)}), name) == (-1.0, 0.5)
            with pytest.raises(
                ValueError, match=rf'deviation 1 of {name} = .* or more, 1000 or less'
            ):
                Deviations(**{name: (0.0, fraction)})


def test_a_number_of_fractions_that_does_not_fit_is_rejected():
    for name in NAMES:
        for count in [1, 3, 6]:
            wanted, what = (4, 'springs') if name in OF_SPRINGS else (5, 'rotors')
            complaint = f'{count} deviations of {name} do not fit a chain of {wanted} {what}'
            with pytest.raises(ValueError, match=complaint):
                Deviations(**{name: (0.0,) * count}).check_fit(5, 4)
            Deviations(**{name: (0.0,) * wanted}).check_fit(5, 4)


@given(st.integers(0, 10**9), st.sets(st.sampled_from(NAMES)), st.booleans())
def test_disorder_draws_only_the_named_quantities(seed, names, periodic):
    fractions = dict.fromkeys(sorted(names), 0.01)
    drawn = Disorder(seed=seed, **fractions).drawn(12, periodic)
    assert drawn == drawn_deviations(12, seed, periodic, **fractions)
    assert {name for name in NAMES if getattr(drawn, name)} == names


def test_disorder_out_of_its_range_is_rejected():
    for name, value in [('mass', -0.01), ('spacing', 0.51), ('damping', math.nan), ('seed', -1)]:
        with pytest.raises(ValueError, match=rf'Disorder\.{name} = {value} must'):
            Disorder(**{name: value})


def test_fractions_that_are_given_go_beside_those_that_are_drawn():
    given_ones, drawn = Deviations(mass=(0.1, 0.2)), Deviations(spacing=(0.3,))
    assert given_ones.joined(drawn) == Deviations(mass=(0.1, 0.2), spacing=(0.3,))
    with pytest.raises(ValueError, match='deviations of mass are given twice'):
        given_ones.joined(Deviations(mass=(0.0, 0.1)))
