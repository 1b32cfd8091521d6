# SPDX-License-Identifier: Apache-2.0
"""Formulas as texts that can be both printed and evaluated.

The text is in mathematical notation, such as `√(1 − v²/c²)`, `4 r² sin² θ̄` or `||q₊| − |q₋|| / r`.
Adjacent factors are multiplied before any division.
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
"""Exponents by their printed character [1]."""
_ALIKE = str.maketrans('∣-', '|−')
"""Replacements for other forms of the vertical bar and the minus sign."""
_VALUE = re.compile(r'(?P<text>.*?) = (?P<value>\S+)(?: for (?P<values>[^()]*))?(?: \(.*\))?')


@dataclass(frozen=True)
class Formula:
    """Formula and the values of its symbols; `value` raises ValueError for an unknown symbol."""

    text: str
    values: Mapping[str, float]
    remark: str = ''
    """Note that is printed in parentheses after the formula."""

    @property
    def value(self) -> float:
        """Value of the formula; raises ValueError if it cannot be parsed."""
        return _Parser(self.text, self.values).evaluate()

    def __str__(self) -> str:
        """Return text, value, symbol values and remark in the format of `read_formula`."""
        symbols = ', '.join(f'{name} = {value:.8g}' for name, value in self.values.items())
        remark = f' ({self.remark})' if self.remark else ''
        return f'{self.text} = {self.value:.5g}{f" for {symbols}" if symbols else ""}{remark}'


def chain_formula(text: str, chain: Chain, remark: str = '', **more: float) -> Formula:
    """Return a formula with the symbol values of a chain; only used symbols are printed."""
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
    """Parse a printed formula; return it and its printed value.

    Raises ValueError if the text is not a printed formula.
    """
    found = _VALUE.fullmatch(printed)
    if found is None:
        raise ValueError(
            f'{printed!r} is not a printed formula; write: formula = value for symbols'
        )
    pairs = (each.split(' = ') for each in (found['values'] or '').split(', ') if each)
    return Formula(found['text'], {name: float(value) for name, value in pairs}), float(
        found['value']
    )


def _tokens(text: str, values: Mapping[str, float]) -> list[str]:
    names = sorted([*values, *_FUNCTIONS, *_CHOICES], key=len, reverse=True)
    token = '|'.join([r'\d+(?:\.\d+)?', *map(re.escape, names), r'[²³⁴+−·/(),|]', r'\S'])
    return re.findall(token, text.translate(_ALIKE))


class _Parser:
    """Recursive-descent parser that evaluates a formula."""

    def __init__(self, text: str, values: Mapping[str, float]) -> None:
        self._text, self._values = text, {'π': math.pi, **values}
        self._tokens = [*_tokens(text, self._values), '']
        self._bars = 0

    def evaluate(self) -> float:
        """Evaluate the whole text."""
        value = self._sum()
        if self._next:
            raise self._error()
        return value

    @property
    def _next(self) -> str:
        return self._tokens[0]

    def _take(self, *wanted: str) -> str:
        if wanted and self._next not in wanted:
            raise self._error()
        return self._tokens.pop(0)

    def _error(self) -> ValueError:
        found = repr(self._next) if self._next else 'its end'
        return ValueError(f'formula {self._text!r}: {found} is not expected; correct the text')

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
        raise self._error()

    def _inside(self) -> float:
        """Evaluate a sum in parentheses; a vertical bar inside opens a new absolute value."""
        outer, self._bars = self._bars, 0
        value = self._sum()
        self._bars = outer
        return value
