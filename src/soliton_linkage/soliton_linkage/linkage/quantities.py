# SPDX-License-Identifier: Apache-2.0
"""Definition of dataclass fields with unit, meaning and range, and validation of their values."""

from __future__ import annotations

import math
import numbers
from collections.abc import Collection
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

LARGEST_SEED = 10**9
"""Largest allowed random seed. The value fits into a signed 32-bit integer."""

LARGEST_ANGLE = 1e9
"""Largest allowed unwrapped angle [rad]. Double precision resolves 1e-7 rad at this angle, and the
resolution of encoders is coarser."""

Described = TypeVar('Described')


@dataclass(frozen=True)
class Quantity:
    """Meaning, unit and allowed range of a parameter; the limits are allowed values."""

    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: Collection[str] = ()
    adjustable: bool = False

    def complaint(self, value: object) -> str | None:
        """Return a text with the condition that a value violates, or None if it violates none."""
        if self.choices and value not in self.choices:
            return f'must be one of {", ".join(map(repr, self.choices))}'
        if isinstance(value, numbers.Real) and not isinstance(value, bool):
            number = float(value)
            if not math.isfinite(number):
                return f'must be a finite number{self._range(" in the range", " of")}'
            below = self.minimum is not None and number < self.minimum
            above = self.maximum is not None and number > self.maximum
            if below or above:
                return f'must {self._range("lie in the range", "be")}'
        return None

    def _range(self, between: str, beyond: str) -> str:
        low, high, unit = self.minimum, self.maximum, f' {self.unit}' if self.unit else ''
        if low is not None and high is not None:
            return f'{between} {low:g} to {high:g}{unit}'
        if low is not None:
            return f'{beyond} {low:g}{unit} or more'
        return '' if high is None else f'{beyond} {high:g}{unit} or less'


def quantity(
    default: Any,
    description: str,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Collection[str] = (),
    adjustable: bool = False,
) -> Any:
    """Return a dataclass field with a default value, and with a `Quantity` in its metadata.

    The arguments after `default` are the fields of the `Quantity`.
    """
    described = Quantity(description, unit, minimum, maximum, choices, adjustable)
    return field(default=default, metadata={'quantity': described})


def document_fields(dataclass_type: type[Described]) -> type[Described]:
    """Add the meaning of each field to the docstring of a dataclass, so that `help` shows it."""
    lines = [
        f'    {name}: {one.description}{f" [{one.unit}]" if one.unit else ""}'
        for name, one in described_fields(dataclass_type).items()
    ]
    dataclass_type.__doc__ = '\n'.join([f'{dataclass_type.__doc__}\n    Fields:', *lines])
    return dataclass_type


def described_fields(dataclass_type: Any) -> dict[str, Quantity]:
    """Return a dictionary from the name of each field defined by `quantity` to its `Quantity`."""
    described = [f for f in fields(dataclass_type) if 'quantity' in f.metadata]
    return {f.name: f.metadata['quantity'] for f in described}


def check_quantities(instance: Any) -> None:
    """Raise ValueError if a value is outside the range of its `Quantity` or has the wrong type.

    A field whose default is an integer must be an integer. A field whose default is a float must
    be a number.
    """
    for name, described in described_fields(instance).items():
        value = getattr(instance, name)
        default = type(instance).__dataclass_fields__[name].default
        complaint = _complaint_of_kind(value, default) or described.complaint(value)
        if complaint:
            raise ValueError(f'{type(instance).__name__}.{name} = {value!r} {complaint}')


class CheckedQuantities:
    """Base class of dataclasses whose values are checked by `check_quantities`."""

    def __post_init__(self) -> None:
        check_quantities(self)


def _complaint_of_kind(value: object, default: object) -> str | None:
    if isinstance(default, bool) or not isinstance(default, (int, float)):
        return None
    kind, words = (numbers.Real, 'a number')
    if isinstance(default, int):
        kind, words = (numbers.Integral, 'a whole number')
    right = isinstance(value, kind) and not isinstance(value, bool)
    return None if right else f'must be {words}'
