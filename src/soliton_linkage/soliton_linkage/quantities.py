# SPDX-License-Identifier: Apache-2.0
"""Dataclass fields that carry their unit, meaning and range, and the check that they hold."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any


@dataclass(frozen=True)
class Quantity:
    """What a parameter means and which values it may take; the bounds are inclusive."""

    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    adjustable: bool = False

    def complaint(self, value: object) -> str | None:
        """Say what is wrong with a value and what to do about it, or None if it is allowed."""
        if self.choices and value not in self.choices:
            return f'must be one of {", ".join(map(repr, self.choices))}'
        if isinstance(value, float) and not math.isfinite(value):
            return f'must be a finite number{self._range()}'
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            below = self.minimum is not None and value < self.minimum
            above = self.maximum is not None and value > self.maximum
            if below or above:
                return f'must lie in the range{self._range()}'
        return None

    def _range(self) -> str:
        if self.minimum is None and self.maximum is None:
            return ''
        low = '-inf' if self.minimum is None else f'{self.minimum:g}'
        high = 'inf' if self.maximum is None else f'{self.maximum:g}'
        return f' {low} to {high}{" " + self.unit if self.unit else ""}'


def quantity(
    default: Any,
    description: str,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    adjustable: bool = False,
) -> Any:
    """Define a dataclass field with a default and a `Quantity` as its metadata."""
    described = Quantity(description, unit, minimum, maximum, choices, adjustable)
    return field(default=default, metadata={'quantity': described})


def described_fields(dataclass_type: Any) -> dict[str, Quantity]:
    """Return the quantity of each described field of a dataclass, by name."""
    return {f.name: f.metadata['quantity'] for f in fields(dataclass_type) if f.metadata}


def check_quantities(instance: Any) -> None:
    """Raise ValueError for the first field whose value its quantity does not allow."""
    for name, described in described_fields(instance).items():
        value = getattr(instance, name)
        complaint = described.complaint(value)
        if complaint:
            raise ValueError(f'{type(instance).__name__}.{name} = {value!r} {complaint}')
