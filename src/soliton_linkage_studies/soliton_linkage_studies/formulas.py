# SPDX-License-Identifier: Apache-2.0
"""Formulas that are printed and computed from one text, so that a number is that of its formula.

They are written as on paper: `√(1 − v²/c²)`, `4 r² sin² θ̄`, `||q₊| − |q₋|| / r`. What stands side
by side is multiplied, before anything is divided.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from soliton_linkage.linear.bands import couplings
from soliton_linkage.linkage.chain import Chain

_FUNCTIONS: dict[str, Callable[[float], float]] = {
    '√': math.sqrt,
    'sin': math.sin,
    'cos': math.cos,
    'ln': math.log,
}
_CHOICES: dict[str, Callable[[float, float], float]] = {'min': min, 'max': max}
_POWERS = {'²': 2, '³': 3, '⁴': 4}
"""Exponents as they are printed [1]."""
_ALIKE = str.maketrans('∣-', '|−')
"""Bars as tables have them, and the minus of keyboards."""
_VALUE = re.compile(r'(?P<text>.*?) = (?P<value>\S+)(?: for (?P<values>[^()]*))?(?: \(.*\))?')


@dataclass(frozen=True)
class Formula:
    """A formula and the values of its symbols; raises ValueError for what it does not know."""

    text: str
    values: Mapping[str, float]
    remark: str = ''
    """What else there is to say of it."""

    @property
    def value(self) -> float:
        """What the text gives with the values."""
        return _Reader(self.text, self.values).whole()

    def __str__(self) -> str:
        """Return text, value, values and remark, from which `read_formula` has it again."""
        symbols = ', '.join(f'{name} = {value:.8g}' for name, value in self.values.items())
        remark = f' ({self.remark})' if self.remark else ''
        return f'{self.text} = {self.value:.5g}{f" for {symbols}" if symbols else ""}{remark}'


def chain_formula(text: str, chain: Chain, remark: str = '', **more: float) -> Formula:
    """Return a formula of a chain, of whose symbols it prints those that it has."""
    plus, minus = couplings(chain)
    values = {
        'r': chain.rotor_length,
        'a': chain.spacing,
        'θ̄': chain.rest_angle,
        'l̄': chain.rest_length,
        'ū': chain.rotor_length * math.sin(chain.rest_angle),
        'd': chain.lean_ratio,
        'q₊': plus,
        'q₋': minus,
        **more,
    }
    used = _tokens(text, values)
    return Formula(text, {name: value for name, value in values.items() if name in used}, remark)


def read_formula(printed: str) -> tuple[Formula, float]:
    """Return the formula of a printed one, and the value that is printed with it."""
    found = _VALUE.fullmatch(printed)
    if found is None:
        raise ValueError(f'{printed!r} is no formula; print it as formula = value for symbols')
    pairs = (each.split(' = ') for each in (found['values'] or '').split(', ') if each)
    return Formula(found['text'], {name: float(value) for name, value in pairs}), float(
        found['value']
    )


def _tokens(text: str, values: Mapping[str, float]) -> list[str]:
    names = sorted([*values, *_FUNCTIONS, *_CHOICES], key=len, reverse=True)
    token = '|'.join([r'\d+(?:\.\d+)?', *map(re.escape, names), r'[²³⁴+−·/(),|]', r'\S'])
    return re.findall(token, text.translate(_ALIKE))


class _Reader:
    """Reads a formula from left to right and computes it on the way."""

    def __init__(self, text: str, values: Mapping[str, float]) -> None:
        self._text, self._values = text, {'π': math.pi, **values}
        self._tokens = [*_tokens(text, self._values), '']
        self._bars = 0

    def whole(self) -> float:
        """Value of the whole text."""
        value = self._sum()
        if self._next:
            raise self._complaint()
        return value

    @property
    def _next(self) -> str:
        return self._tokens[0]

    def _take(self, *wanted: str) -> str:
        if wanted and self._next not in wanted:
            raise self._complaint()
        return self._tokens.pop(0)

    def _complaint(self) -> ValueError:
        what = repr(self._next) if self._next else 'its end'
        return ValueError(f'formula {self._text!r}: {what} is not expected; give it a value')

    def _sum(self) -> float:
        sign = -1 if self._next == '−' and self._take() else 1
        value = sign * self._quotient()
        while self._next in ('+', '−'):
            sign = 1 if self._take() == '+' else -1
            value += sign * self._quotient()
        return value

    def _quotient(self) -> float:
        value = self._product()
        while self._next in ('/', '·'):
            value = value / self._product() if self._take() == '/' else value * self._product()
        return value

    def _product(self) -> float:
        value = self._power()
        while self._next and self._next not in '+−/·),' and not (self._next == '|' and self._bars):
            value *= self._power()
        return value

    def _power(self) -> float:
        name = self._next
        if name in _FUNCTIONS:
            self._take()
            exponent = self._exponent()
            argument = self._atom() if name == '√' else self._power()
            return float(_FUNCTIONS[name](argument) ** exponent)
        return float(self._atom() ** self._exponent())

    def _exponent(self) -> int:
        return _POWERS[self._take()] if self._next in _POWERS else 1

    def _atom(self) -> float:
        name = self._take()
        if name in _CHOICES:
            self._take('(')
            pair = self._inside(), self._take(',') and self._inside()
            self._take(')')
            return _CHOICES[name](float(pair[0]), float(pair[1]))
        if name == '(':
            value = self._inside()
            self._take(')')
            return value
        if name == '|':
            self._bars += 1
            value = abs(self._sum())
            self._take('|')
            self._bars -= 1
            return value
        if name in self._values:
            return self._values[name]
        if name and name[0].isdigit():
            return float(name)
        self._tokens.insert(0, name)
        raise self._complaint()

    def _inside(self) -> float:
        """Sum within parentheses, in which bars open anew."""
        outer, self._bars = self._bars, 0
        value = self._sum()
        self._bars = outer
        return value
