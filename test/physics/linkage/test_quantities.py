# SPDX-License-Identifier: Apache-2.0
"""Described fields accept values in their range, and reject others with the reason."""

import math
import re
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.quantities import (
    Quantity,
    check_quantities,
    described_fields,
    document_fields,
    quantity,
)


@dataclass(frozen=True)
class Lamp:
    brightness: float = quantity(1.0, 'light that it gives', 'cd', 0.5, 2.0)
    bulbs: int = quantity(3, 'number of bulbs', '', 1)
    colour: str = quantity('red', 'colour of the light', choices=('red', 'green'))
    dimmable: bool = quantity(False, 'whether it can be dimmed', adjustable=True)
    label: str = field(default='', metadata={'note': 'described by no quantity'})

    def __post_init__(self) -> None:
        check_quantities(self)


@given(st.floats(), st.floats(), st.floats(allow_nan=False))
def test_a_number_is_allowed_exactly_where_it_is_finite_and_within_the_bounds(low, high, value):
    complaint = Quantity('', 'm', low, high).complaint(value)
    outside = value < low or value > high
    assert (complaint is None) == (math.isfinite(value) and not outside)
    if complaint:
        assert f'{low:g} to {high:g} m' in complaint


def test_numbers_of_numpy_are_held_to_the_bounds_like_others():
    for kind in [int, float, np.float64, np.float32, np.int64, np.uint8]:
        described = Quantity('', '', 2, 5)
        assert described.complaint(kind(2)) is None
        assert described.complaint(kind(5)) is None
        assert described.complaint(kind(6)) == 'must lie in the range 2 to 5'


def test_a_complaint_names_the_limit_and_its_unit():
    for low, high, value, complaint in [
        (None, 2.0, 3.0, 'must be 2 s or less'),
        (1.0, None, 0.0, 'must be 1 s or more'),
        (None, None, math.nan, 'must be a finite number'),
        (1.0, None, math.inf, 'must be a finite number of 1 s or more'),
    ]:
        assert Quantity('', 's', low, high).complaint(value) == complaint


def test_a_field_that_is_not_allowed_is_rejected_by_name_and_value():
    for arguments, complaint in [
        ({'brightness': 3.0}, 'Lamp.brightness = 3.0 must lie in the range 0.5 to 2 cd'),
        ({'brightness': 'much'}, "Lamp.brightness = 'much' must be a number"),
        ({'brightness': True}, 'Lamp.brightness = True must be a number'),
        ({'bulbs': 0}, 'Lamp.bulbs = 0 must be 1 or more'),
        ({'bulbs': 2.0}, 'Lamp.bulbs = 2.0 must be a whole number'),
        ({'colour': 'blue'}, "Lamp.colour = 'blue' must be one of 'red', 'green'"),
    ]:
        with pytest.raises(ValueError, match=f'^{re.escape(complaint)}$'):
            Lamp(**arguments)


def test_a_field_that_is_allowed_is_kept():
    for arguments in [
        {},
        {'brightness': 1},
        {'brightness': np.float32(1)},
        {'bulbs': np.int64(9)},
        {'colour': 'green'},
        {'dimmable': True},
        {'label': 'any'},
    ]:
        lamp = Lamp(**arguments)
        assert all(getattr(lamp, name) == value for name, value in arguments.items())


def test_fields_are_described_completely():
    described = described_fields(Lamp)
    assert list(described) == ['brightness', 'bulbs', 'colour', 'dimmable']
    assert described['brightness'] == Quantity('light that it gives', 'cd', 0.5, 2.0)
    assert described['colour'].choices == ('red', 'green')
    assert [name for name, what in described.items() if what.adjustable] == ['dimmable']


def test_help_shows_the_meaning_of_fields():
    @document_fields
    @dataclass(frozen=True)
    class Kettle:
        """Boils water."""

        volume: float = quantity(1.0, 'water that it holds', 'l')

    assert Kettle.__doc__ is not None
    assert Kettle.__doc__.startswith('Boils water.')
    assert 'volume: water that it holds [l]' in Kettle.__doc__
