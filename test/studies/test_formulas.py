# SPDX-License-Identifier: Apache-2.0
"""A formula has the value of its notation, and prints its number and its symbols."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_studies.formulas import Formula, read_formula


def test_a_formula_has_the_value_of_its_notation() -> None:
    for text, value in [
        ('2', 2.0),
        ('−x + 7', 4.0),
        ('1 / 2x', 1 / 6),
        ('x² / y² · 2', 18 / 25),
        ('(16/3) x³', 144.0),
        ('√(x² + 16) − |x − y|', 3.0),
        ('x √|−4|', 6.0),
        ('||x| − |y|| / 2', 1.0),
        ('|x − y| |y − x|', 4.0),
        ('min(|x|, |y|) / max(1, 3)', 1.0),
        ('sin² x + cos² x', 1.0),
        ('ln((x + 1) / |1 − x|)', math.log(2)),
        ('1 − 1 / (1 + x² / (2 y²))²', 1 - 1 / (1 + 9 / 50) ** 2),
        ('π − 2x', math.pi - 6),
        ('1 / sin² x', 1 / math.sin(3) ** 2),
    ]:
        assert Formula(text, {'x': 3.0, 'y': 5.0}).value == pytest.approx(value, rel=1e-14)


def test_symbols_may_have_bars_and_indices_and_the_longest_match_is_used() -> None:
    values = {'v': 2.0, 'v₀': 3.0, 'θ̄': 5.0, 'M_eff': 7.0}
    assert Formula('v₀ v θ̄ M_eff²', values).value == 3 * 2 * 5 * 49


def test_an_invalid_formula_is_rejected() -> None:
    for text in ['', 'x +', '(x', '|x', 'x)', 'z', 'min(x)', 'x, x', '2 $ 3']:
        with pytest.raises(ValueError, match='is not expected'):
            _ = Formula(text, {'x': 3.0}).value


@given(st.floats(0.01, 100), st.floats(0.01, 100))
def test_a_printed_formula_is_parsed_with_its_number(speed: float, sound: float) -> None:
    printed = str(Formula('√(1 + v²/c²)', {'v': speed, 'c': sound}, 'slow'))
    formula, value = read_formula(printed)
    assert formula.text == '√(1 + v²/c²)'
    assert formula.value == pytest.approx(value, rel=1e-4)
    assert formula.value == pytest.approx(math.hypot(1, speed / sound), rel=1e-4)


def test_a_text_without_a_formula_is_rejected() -> None:
    with pytest.raises(ValueError, match='is not a printed formula'):
        read_formula('as set')
