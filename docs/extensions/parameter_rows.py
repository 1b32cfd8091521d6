# SPDX-License-Identifier: Apache-2.0
"""Table rows of parameters from the fields of a dataclass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module

from soliton_linkage.linkage.quantities import Quantity, described_fields


def parameter_rows(described: str, prefix: str = '') -> Iterator[tuple[str, str, str, str]]:
    """Yield name, default, range and meaning of each parameter of a dataclass, as Markdown.

    `described` is MODULE:CLASS. `prefix` is written before each name.
    """
    module, _, name = described.partition(':')
    parameters = getattr(import_module(module), name)
    quantities = described_fields(parameters)
    for field in fields(parameters):
        if field.name in quantities:
            one = quantities[field.name]
            unit = f' [{one.unit}]' if one.unit else ''
            running = '; adjustable at run time' if one.adjustable else ''
            meaning = f'{one.description}{unit}{running}'
            yield f'`{prefix}{field.name}`', shown(field.default), allowed(one), meaning


def shown(default: object) -> str:
    """Return a default value in the syntax of parameter files, or `empty`."""
    if default in ('', ()):
        return 'empty'
    return str(default).lower() if isinstance(default, bool) else str(default)


def allowed(one: Quantity) -> str:
    """Return the range of a parameter as text."""
    if one.choices:
        return ', '.join(f'`{choice}`' for choice in one.choices)
    low, high = one.minimum, one.maximum
    if low is None and high is None:
        return ''
    if high is None:
        return f'{low:g} or more'
    return f'up to {high:g}' if low is None else f'{low:g} to {high:g}'
