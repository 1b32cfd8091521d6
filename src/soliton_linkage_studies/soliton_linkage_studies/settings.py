# SPDX-License-Identifier: Apache-2.0
"""Settings of studies, read from YAML files; errors state the file, the key and the value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import yaml

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.quantities import described_fields, quantity

_CHAIN_KEYS = (
    *('number_of_rotors', 'rotor_length_ratio', 'rest_angle', 'spacing'),
    *('mass', 'stiffness', 'damping'),
)


def setting(description: str, unit: str, minimum: float, maximum: float) -> Any:
    """Return a dataclass field with a closed range, for a value that `Section.values_of` reads."""
    return quantity(MISSING, description, unit, minimum, maximum)


@dataclass(frozen=True)
class Section:
    """Section of a settings file; its methods raise ValueError for a missing or invalid value."""

    file: str
    """Path of the file, for error messages."""
    name: str
    """Keys that lead to this section, joined by dots; empty for the whole file."""
    values: Mapping[str, object]

    def error(self, key: str, what: str) -> ValueError:
        """Return an error; its text is the file, the key, the value if present, and `what`."""
        where = f'{self.file}: {self._full(key)}'
        value = f' = {self.values[key]!r}' if key in self.values else ''
        return ValueError(f'{where}{value} {what}')

    def check_keys(self, *keys: str) -> None:
        """Raise ValueError if the section has a key that is not in `keys`."""
        for key in self.values:
            if key not in keys:
                raise self.error(key, f'is not known; known keys are {", ".join(keys)}')

    def section(self, key: str) -> Section:
        """Return the section at a key; its value must be a mapping."""
        value = self._value(key, 'a section of keys')
        if not isinstance(value, Mapping):
            raise self.error(key, 'must be a section; indent its keys beneath it')
        return _section(self.file, self._full(key), value)

    def sections(self, key: str) -> dict[str, Section]:
        """Return the subsections of the section at a key, by name."""
        found = self.section(key)
        return {name: found.section(name) for name in found.values}

    def chain(self, key: str = 'chain') -> Chain:
        """Return the chain that the section at a key describes; see `chain_from`."""
        return chain_from(self.section(key))

    def chains(self) -> dict[str, Chain]:
        """Return the chains in the section `chains` by name; see `chain_from`."""
        return {name: chain_from(each) for name, each in self.sections('chains').items()}

    def values_of(self, kind: type, *more: str) -> dict[str, Any]:
        """Read a value for each field of the dataclass `kind`; return the values by field name.

        The function `setting` must have defined the fields. The section may also contain the keys
        `more`, whose values are not returned. Raises ValueError for an invalid value or any other
        key.
        """
        described = described_fields(kind)
        self.check_keys(*more, *described)
        types = {field.name: field.type for field in fields(kind)}
        readers: dict[Any, Any] = {
            'int': self.whole_number,
            'tuple[float, ...]': self.numbers,
        }
        return {
            name: readers.get(types[name], self.number)(name, one.minimum, one.maximum)
            for name, one in described.items()
        }

    def number(
        self, key: str, minimum: float, maximum: float, default: float | None = None
    ) -> float:
        """Return a finite number in a closed range, or the default if the key is absent."""
        wanted = f'a number in the range {minimum:g} to {maximum:g}'
        return self._checked(key, self._value(key, wanted, default), minimum, maximum, wanted)

    def whole_number(
        self, key: str, minimum: int, maximum: int, default: int | None = None
    ) -> int:
        """Return a whole number in a closed range, or the default if the key is absent."""
        wanted = f'a whole number in the range {minimum} to {maximum}'
        value = self._value(key, wanted, default)
        number = self._checked(key, value, minimum, maximum, wanted)
        if not isinstance(value, int):
            raise self.error(key, f'must be {wanted}; omit the decimal point')
        return int(number)

    def numbers(self, key: str, minimum: float, maximum: float) -> tuple[float, ...]:
        """Return a list of one or more numbers, each in a closed range."""
        wanted = f'a list of numbers in the range {minimum:g} to {maximum:g}'
        values = self._value(key, wanted)
        if not isinstance(values, Sequence) or isinstance(values, str) or not values:
            raise self.error(key, f'must be {wanted}; write [1.0, 2.0]')
        return tuple(self._checked(key, value, minimum, maximum, wanted) for value in values)

    def text(self, key: str, choices: tuple[str, ...] = (), default: str | None = None) -> str:
        """Return a text, or the default if the key is absent.

        If `choices` are given, the text must be one of them.
        """
        wanted = f'one of {", ".join(choices)}' if choices else 'a text'
        value = self._value(key, wanted, default)
        if not isinstance(value, str) or (choices and value not in choices):
            raise self.error(key, f'must be {wanted}')
        return value

    def _value(self, key: str, wanted: str, default: object = None) -> object:
        if key not in self.values and default is None:
            raise self.error(key, f'is missing; give {wanted}')
        return self.values.get(key, default)

    def _checked(
        self, key: str, value: object, minimum: float, maximum: float, wanted: str
    ) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            hint = '; write exponents as 1.0e-3' if isinstance(value, str) else ''
            raise self.error(key, f'must be {wanted}{hint}')
        if not (math.isfinite(value) and minimum <= value <= maximum):
            raise self.error(key, f'must be {wanted}; choose a value in this range')
        return float(value)

    def _full(self, key: str) -> str:
        return f'{self.name}.{key}' if self.name else key


def load_settings(path: Path | str) -> Section:
    """Read a YAML file. Raises ValueError if the file cannot be read or contains no mapping."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f'{path}: cannot be read ({error}); give a settings file') from error
    except yaml.YAMLError as error:
        where = ' '.join(str(error).split())
        raise ValueError(f'{path}: is not YAML ({where}); correct the file there') from error
    if not isinstance(content, Mapping):
        raise ValueError(
            f'{path}: contains {type(content).__name__} {str(content)[:40]!r} instead of sections '
            'of keys and values; write key: value'
        )
    return _section(str(path), '', content)


def chain_from(section: Section) -> Chain:
    """Return the chain that a section of a settings file describes.

    The keys `number_of_rotors`, `rest_angle` and `rotor_length_ratio` (rotor length / spacing [1])
    are required. The keys `spacing`, `mass`, `stiffness` and `damping` are optional. Units are
    those of the fields of `Chain`.
    """
    section.check_keys(*_CHAIN_KEYS)
    limits = {
        name: (described.minimum or 0.0, described.maximum or math.inf)
        for name, described in described_fields(Chain).items()
    }
    fewest, most = limits['number_of_rotors']
    number_of_rotors = section.whole_number('number_of_rotors', int(fewest), int(most))
    ratio = section.number('rotor_length_ratio', 1e-3, 1e3)
    rest_angle = section.number('rest_angle', *limits['rest_angle'])
    spacing, mass, stiffness = (
        section.number(key, *limits[key], getattr(Chain, key))
        for key in ('spacing', 'mass', 'stiffness')
    )
    damping = section.number('damping', 0.0, 1e6, 0.0)
    lengths = spacing, ratio * spacing
    try:
        return Chain(number_of_rotors, *lengths, rest_angle, mass, stiffness, damping)
    except ValueError as error:
        raise ValueError(
            f'{section.file}: {section.name} gives {error}; change rotor_length_ratio or spacing'
        ) from error


def _section(file: str, name: str, values: Mapping[object, object]) -> Section:
    for key in values:
        if not isinstance(key, str):
            where = f'{name}: ' if name else ''
            raise ValueError(f'{file}: {where}key {key!r} must be a text; put it in quotes')
    return Section(file, name, {str(key): value for key, value in values.items()})
