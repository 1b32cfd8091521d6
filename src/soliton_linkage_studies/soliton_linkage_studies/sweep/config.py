# SPDX-License-Identifier: Apache-2.0
"""Configuration of a sweep, read from its YAML file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations, drawn_deviations
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage_studies.measures import (
    MEASURES,
    MECHANICS,
    Measure,
    SweepTrial,
    Value,
)
from soliton_linkage_studies.settings import Section, load_settings

_SECTIONS = ('measure', 'chain', 'deviations', 'trial', 'seeds', 'sweep')
_DEVIATIONS = tuple(f.name for f in fields(Deviations))
_FRACTIONS = (*_DEVIATIONS, 'scale')
_MOST_POINTS = 10_000
"""Largest number of points of an axis [1]; larger numbers are probably typing errors."""
_MOST_ROWS = 10_000_000
"""Largest number of rows of a table [1]; such a table has a size of about one gigabyte."""


def _limits() -> dict[str, tuple[float, float]]:
    described = {**described_fields(Chain), **described_fields(SweepTrial)}
    limits = {
        name: (one.minimum, one.maximum)
        for name, one in described.items()
        if one.minimum is not None and one.maximum is not None
    }
    limits |= {'damping': (0.0, 1e6), 'rotor_length_ratio': (1e-3, 1e3)}
    limits |= {f'deviations.{name}': (0.0, 1.0) for name in _DEVIATIONS}
    return {**limits, 'deviations.scale': (0.0, 1e3)}


_LIMITS = _limits()
_CHAIN = tuple(name for name in described_fields(Chain) if name != 'periodic')
_TRIAL = tuple(described_fields(SweepTrial))
_LENGTHS = {'rotor_length', 'rotor_length_ratio'}


@dataclass(frozen=True)
class Axis:
    """Parameter that a sweep varies, with its values."""

    name: str
    values: tuple[Value, ...]
    logarithmic: bool = False


@dataclass(frozen=True)
class SweepStudy:
    """Sweep: one measurement of a wall for each point of a parameter grid and each seed.

    Rows are numbered in the order of the grid; from row to row, the seed changes fastest, then the
    value of the last axis.
    """

    name: str
    measure_name: str
    parameters: dict[str, Value]
    """Parameters of all points by name; an axis replaces the parameter of the same name."""
    axes: tuple[Axis, ...]
    seeds: tuple[int, ...]

    @property
    def measure(self) -> Measure:
        """Definition of the measured quantities."""
        return MEASURES[self.measure_name]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        axes = (axis.name for axis in self.axes)
        return ('row', *axes, 'seed', *self.measure.columns, 'failure')

    @property
    def rows(self) -> int:
        """Number of rows of the table."""
        return math.prod(len(axis.values) for axis in self.axes) * len(self.seeds)

    def point(self, row: int) -> tuple[dict[str, Value], int]:
        """Return the axis values by name, and the seed, for a row of the table."""
        rest, seed = divmod(row, len(self.seeds))
        values: dict[str, Value] = {}
        for axis in reversed(self.axes):
            rest, number = divmod(rest, len(axis.values))
            values[axis.name] = axis.values[number]
        return {axis.name: values[axis.name] for axis in self.axes}, self.seeds[seed]

    def cells(self, row: int) -> list[str]:
        """Measure a row; return its cells as text. The last cell is empty or an error message."""
        values, seed = self.point(row)
        measured, failure = [''] * len(self.measure.columns), ''
        try:
            taken = self.measure.take(*trial_of({**self.parameters, **values}, seed))
            measured = [_text(taken[name]) for name in self.measure.columns]
        except (ArithmeticError, ValueError) as error:
            failure = ' '.join(str(error).split())
        return [str(row), *map(_text, values.values()), str(seed), *measured, failure]

    def described(self) -> dict[str, Any]:
        """Return all data that determine the rows, as types that YAML can store."""
        return {
            'measure': self.measure_name,
            'parameters': dict(sorted(self.parameters.items())),
            'sweep': {axis.name: list(axis.values) for axis in self.axes},
            'seeds': list(self.seeds),
        }


def trial_of(parameters: Mapping[str, Value], seed: int) -> tuple[Chain, SweepTrial]:
    """Return the chain and the `SweepTrial`; `seed` selects the random deviations of the chain.

    The keys of `parameters` are fields of `Chain` and `SweepTrial`; `rotor_length_ratio` (r / a)
    may replace `rotor_length`. A key `deviations.<field>` gives the relative standard deviation of
    a field of `Deviations`, and `deviations.scale` multiplies all these deviations. Raises
    ValueError for invalid parameters.
    """
    given: dict[str, Any] = {name: parameters[name] for name in _CHAIN if name in parameters}
    if 'rotor_length_ratio' in parameters:
        spacing = float(given.get('spacing', Chain.spacing))
        given['rotor_length'] = float(parameters['rotor_length_ratio']) * spacing
    trial: dict[str, Any] = {name: parameters[name] for name in _TRIAL if name in parameters}
    scale = float(parameters.get('deviations.scale', 1.0))
    fractions: dict[str, Any] = {
        name: scale * float(parameters.get(f'deviations.{name}', 0.0)) for name in _DEVIATIONS
    }
    drawn = {name: fraction for name, fraction in fractions.items() if fraction}
    rotors = given.get('number_of_rotors', Chain.number_of_rotors)
    deviations = drawn_deviations(rotors, seed, **drawn)
    return Chain(**given, deviations=deviations), SweepTrial(**trial)


def read_sweep_study(path: Path, quick: bool = False) -> SweepStudy:
    """Read a sweep from a YAML file; `quick` reduces the grid to a few points per axis."""
    settings = load_settings(path)
    settings.check_keys(*_SECTIONS)
    parameters = _parameters(settings)
    if not settings.values.get('sweep') or not isinstance(settings.values['sweep'], Mapping):
        raise settings.error('sweep', 'must contain one or more parameters with their values')
    section = settings.section('sweep')
    section.check_keys(*_LIMITS, 'mechanics')
    axes = tuple(_axis(section, name) for name in section.values)
    swept = _LENGTHS & {axis.name for axis in axes}
    if swept == _LENGTHS or parameters.keys() >= _LENGTHS:
        where = 'sweep' if swept else 'chain'
        raise settings.error(where, 'contains rotor_length and rotor_length_ratio; remove one')
    if swept:
        parameters = {key: parameters[key] for key in parameters.keys() - _LENGTHS}
    seeds = _seeds(settings)
    name = path.stem
    if quick:
        name, axes, seeds = f'{name}-quick', tuple(map(_thinned, axes)), seeds[:2]
    study = SweepStudy(name, settings.text('measure', tuple(MEASURES)), parameters, axes, seeds)
    _check(settings, study)
    return study


def _parameters(settings: Section) -> dict[str, Value]:
    parameters: dict[str, Value] = {}
    for name, allowed, prefix in (
        ('chain', (*_CHAIN, 'rotor_length_ratio'), ''),
        ('deviations', _FRACTIONS, 'deviations.'),
        ('trial', _TRIAL, ''),
    ):
        if name not in settings.values:
            continue
        section = settings.section(name)
        if 'periodic' in section.values:
            reason = 'because sweeps use chains with free ends'
            raise section.error('periodic', f'is not known, {reason}; remove it')
        section.check_keys(*allowed)
        for key in section.values:
            parameters[prefix + key] = _value(section, key, prefix + key)
    return parameters


def _value(section: Section, key: str, parameter: str) -> Value:
    if parameter == 'mechanics':
        return section.text(key, MECHANICS)
    low, high = _LIMITS[parameter]
    if parameter == 'number_of_rotors':
        return section.whole_number(key, int(low), int(high))
    return section.number(key, low, high)


def _axis(section: Section, name: str) -> Axis:
    content = section.values[name]
    if isinstance(content, Mapping):
        axis = _range(section.section(name), name)
    elif isinstance(content, list) and 0 < len(content) <= _MOST_POINTS:
        each = _listed(section, f'{section.name}.{name}', content)
        axis = Axis(name, tuple(_value(each, key, name) for key in each.values))
    else:
        raise section.error(
            name,
            f'must be a list of 1 to {_MOST_POINTS} values, or a range; write '
            '{from: 0.1, to: 1.0, points: 10, scale: linear}',
        )
    if len(set(axis.values)) < len(axis.values):
        raise section.error(name, 'has duplicate values; remove them or reduce the points')
    return axis


def _listed(section: Section, name: str, content: list[Any]) -> Section:
    return Section(section.file, name, {str(n): value for n, value in enumerate(content)})


def _range(section: Section, name: str) -> Axis:
    section.check_keys('from', 'to', 'points', 'scale')
    if name == 'mechanics':
        raise section.error('from', f'must be a list; write [{", ".join(MECHANICS)}]')
    low, high = _LIMITS[name]
    first, last = (section.number(end, low, high) for end in ('from', 'to'))
    points = section.whole_number('points', 2, _MOST_POINTS)
    logarithmic = section.text('scale', ('linear', 'log'), 'linear') == 'log'
    if logarithmic and min(first, last) <= 0:
        end = 'from' if first <= 0 else 'to'
        raise section.error(end, 'must be above 0 on a log scale; write scale: linear')
    spaced = np.geomspace if logarithmic else np.linspace
    values: list[Value] = spaced(first, last, points).tolist()
    if name == 'number_of_rotors':
        values = [round(float(value)) for value in values]
    return Axis(name, tuple(values), logarithmic)


def _thinned(axis: Axis) -> Axis:
    points = len(axis.values)
    kept = np.unique(np.linspace(0, points - 1, min(points, 8)).round().astype(int))
    return replace(axis, values=tuple(axis.values[index] for index in kept))


def _seeds(settings: Section) -> tuple[int, ...]:
    content = settings.values.get('seeds', 1)
    if not isinstance(content, list):
        return tuple(range(settings.whole_number('seeds', 1, _MOST_POINTS, 1)))
    section = _listed(settings, 'seeds', content)
    seeds = tuple(section.whole_number(key, 0, 2**32) for key in section.values)
    if not seeds or len(set(seeds)) < len(seeds):
        raise settings.error('seeds', 'must be a list of different seeds, or the number of seeds')
    return seeds


def _check(settings: Section, study: SweepStudy) -> None:
    if study.rows > _MOST_ROWS:
        count = f'gives {study.rows} rows, more than {_MOST_ROWS}'
        raise settings.error('sweep', f'{count}; reduce the points or the seeds')
    first = {axis.name: axis.values[0] for axis in study.axes}
    for axis in study.axes:
        for value in axis.values:
            point = {**study.parameters, **first, axis.name: value, 'deviations.scale': 0.0}
            try:
                trial_of(point, 0)
            except ValueError as error:
                where = f'{settings.file}: sweep.{axis.name} = {value!r}'
                raise ValueError(
                    f'{where} gives {error}; change this value or a parameter of the chain'
                ) from None


def _text(value: Value) -> str:
    return repr(value) if isinstance(value, float) else str(value)
