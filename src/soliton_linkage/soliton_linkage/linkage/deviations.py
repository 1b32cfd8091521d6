# SPDX-License-Identifier: Apache-2.0
"""Relative deviations of single rotors and springs from the parameters of the chain."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Any

import numpy as np

from soliton_linkage.linkage.quantities import (
    LARGEST_SEED,
    CheckedQuantities,
    document_fields,
    quantity,
)

_LARGEST_FRACTION = 1e3
"""Largest allowed relative deviation [1]. Without a limit, products of deviating quantities could
overflow. The value is far below this danger and far above any realistic deviation."""
_LOWEST_FRACTIONS = {
    'dry_friction': -1.0,
    'quadratic_damping': -1.0,
    'non_reciprocity': -_LARGEST_FRACTION,
    'on_site_torque': -_LARGEST_FRACTION,
    'feedback': -_LARGEST_FRACTION,
}
"""Lowest allowed relative deviations [1] of the quantities that may become 0 or negative."""


def _fractions(of: str, each: str) -> Any:
    return quantity((), f'relative deviations of the {of}, one per {each}')


@document_fields
@dataclass(frozen=True)
class Deviations:
    """Relative deviations of single rotors and springs from the parameters of the chain.

    A rotor with 0.02 in `rotor_length` is 1.02 times as long as `Chain.rotor_length`. An empty
    tuple means that no rotor or spring deviates in this quantity. Raises ValueError for deviations
    of -1 or less, with exceptions: `dry_friction` and `quadratic_damping` may be -1, and
    `non_reciprocity`, `on_site_torque` and `feedback` may be as low as -1000.
    """

    spacing: tuple[float, ...] = _fractions('distances between rotors', 'spring')
    rotor_length: tuple[float, ...] = _fractions('rotor lengths', 'rotor')
    mass: tuple[float, ...] = _fractions('masses', 'rotor')
    stiffness: tuple[float, ...] = _fractions('stiffnesses', 'spring')
    rest_length: tuple[float, ...] = _fractions('rest lengths', 'spring')
    damping: tuple[float, ...] = _fractions('dampings', 'rotor')
    dry_friction: tuple[float, ...] = _fractions('dry frictions', 'rotor')
    quadratic_damping: tuple[float, ...] = _fractions('quadratic dampings', 'rotor')
    non_reciprocity: tuple[float, ...] = _fractions('non-reciprocities', 'spring')
    on_site_torque: tuple[float, ...] = _fractions('on-site torques', 'rotor')
    feedback: tuple[float, ...] = _fractions('feedback gains', 'rotor')

    def __post_init__(self) -> None:
        for name in _NAMES:
            for place, fraction in enumerate(getattr(self, name)):
                lowest = _LOWEST_FRACTIONS.get(name, -1.0)
                allowed = fraction > -1 or (name in _LOWEST_FRACTIONS and fraction >= lowest)
                if not (allowed and fraction <= _LARGEST_FRACTION):
                    bound = f'{lowest:g} or more' if name in _LOWEST_FRACTIONS else 'above -1'
                    raise ValueError(
                        f'deviation {place} of {name} = {fraction:g} must be a finite number '
                        f'{bound}, {_LARGEST_FRACTION:g} or less; give the deviation as '
                        'a fraction of the parameter'
                    )

    def check_fit(self, number_of_rotors: int, number_of_springs: int) -> None:
        """Raise ValueError unless each tuple is empty or has one value per rotor or spring."""
        for name in _NAMES:
            of_springs = name in OF_SPRINGS
            wanted = number_of_springs if of_springs else number_of_rotors
            given = len(getattr(self, name))
            if given not in (0, wanted):
                raise ValueError(
                    f'{given} deviations of {name} do not fit a chain of {wanted} '
                    f'{"springs" if of_springs else "rotors"}; give one for each, or none'
                )

    def joined(self, others: Deviations) -> Deviations:
        """Return the deviations of both objects; ValueError if a quantity deviates in both."""
        for name in _NAMES:
            if getattr(self, name) and getattr(others, name):
                raise ValueError(
                    f'deviations of {name} are given twice, as values and as a standard deviation '
                    'of random values; remove one of them'
                )
        both = {name: getattr(self, name) or getattr(others, name) for name in _NAMES}
        return Deviations(**both)


_NAMES = tuple(f.name for f in fields(Deviations))
OF_SPRINGS = ('spacing', 'stiffness', 'rest_length', 'non_reciprocity')
"""Names of the quantities that have one value per spring; all others have one value per rotor."""
NO_DEVIATIONS = Deviations()
_LARGEST_SPREAD = 0.5
"""Largest allowed relative standard deviation [1]. At 0.5, one random deviation in forty is below
-1, a value that `Deviations` rejects for most quantities."""


def _spread(of: str) -> Any:
    return quantity(0.0, f'relative standard deviation of the {of}', '', 0.0, _LARGEST_SPREAD)


@document_fields
@dataclass(frozen=True)
class Disorder(CheckedQuantities):
    """Relative standard deviations and seed of random deviations.

    Raises ValueError for values out of range.
    """

    spacing: float = _spread('distances between pivots')
    rotor_length: float = _spread('lengths of the rotors')
    mass: float = _spread('masses')
    stiffness: float = _spread('stiffnesses')
    rest_length: float = _spread('lengths at rest')
    damping: float = _spread('dampings')
    dry_friction: float = _spread('dry frictions')
    quadratic_damping: float = _spread('quadratic dampings')
    non_reciprocity: float = _spread('non-reciprocities')
    on_site_torque: float = _spread('on-site torques')
    feedback: float = _spread('feedback gains')
    seed: int = quantity(0, 'seed of the random deviations', '', 0, LARGEST_SEED)

    def drawn(self, number_of_rotors: int, periodic: bool = False) -> Deviations:
        """Return random deviations; quantities with the standard deviation 0 do not deviate."""
        fractions = {name: getattr(self, name) for name in _NAMES if getattr(self, name)}
        return drawn_deviations(number_of_rotors, self.seed, periodic, **fractions)


def drawn_deviations(
    number_of_rotors: int, seed: int, periodic: bool = False, **fractions: float
) -> Deviations:
    """Return random deviations, which are independent normal random numbers with the mean 0.

    `fractions` contains the relative standard deviation of each quantity that deviates. For a
    given seed, the result for a quantity does not depend on which other quantities deviate. Raises
    ValueError for invalid arguments, and for results outside the range of `Deviations`.
    """
    for name, value, least in (('number_of_rotors', number_of_rotors, 2), ('seed', seed, 0)):
        if not isinstance(value, Integral) or value < least:
            raise ValueError(f'{name} = {value!r} must be a whole number >= {least}')
    springs = number_of_rotors if periodic else number_of_rotors - 1
    drawn = {}
    for name, fraction in fractions.items():
        if name not in _NAMES:
            raise ValueError(f'unknown quantity {name!r}; must be one of {", ".join(_NAMES)}')
        if not (math.isfinite(fraction) and fraction >= 0):
            raise ValueError(
                f'standard deviation of {name} = {fraction} must be a finite number >= 0'
            )
        generator = np.random.Generator(np.random.PCG64([seed, _NAMES.index(name)]))
        count = springs if name in OF_SPRINGS else number_of_rotors
        drawn[name] = tuple((fraction * generator.standard_normal(count)).tolist())
    return Deviations(**drawn)
