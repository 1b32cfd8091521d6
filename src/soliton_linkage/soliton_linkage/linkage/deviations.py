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
    check_quantities,
    document_fields,
    quantity,
)

_LARGEST_FRACTION = 1e3
"""Largest allowed relative deviation of a rotor or spring [1]. Products of larger values could
overflow."""
_LOWEST_FRACTIONS = {
    'dry_friction': -1.0,
    'quadratic_damping': -1.0,
    'non_reciprocity': -_LARGEST_FRACTION,
    'on_site_torque': -_LARGEST_FRACTION,
    'feedback': -_LARGEST_FRACTION,
}
"""Lowest allowed relative deviation [1] of the quantities that may become 0 or negative."""


@document_fields
@dataclass(frozen=True)
class Deviations:
    """Relative deviations of single rotors and springs from the parameters of the chain.

    For example, a rotor with the value 0.02 in `rotor_length` is 1.02 times as long as the
    parameter rotor_length of the chain. An empty tuple means that all rotors or springs have the
    deviation 0. Raises ValueError for deviations of -1 or less, with two exceptions: deviations of
    frictions may be -1, and those of non-reciprocities, on-site torques and feedback gains may be
    lower.
    """

    spacing: tuple[float, ...] = quantity(
        (), 'relative deviations of the distances between rotors, one per spring'
    )
    rotor_length: tuple[float, ...] = quantity(
        (), 'relative deviations of the rotor lengths, one per rotor'
    )
    mass: tuple[float, ...] = quantity((), 'relative deviations of the masses, one per rotor')
    stiffness: tuple[float, ...] = quantity(
        (), 'relative deviations of the stiffnesses, one per spring'
    )
    rest_length: tuple[float, ...] = quantity(
        (), 'relative deviations of the rest lengths, one per spring'
    )
    damping: tuple[float, ...] = quantity((), 'relative deviations of the dampings, one per rotor')
    dry_friction: tuple[float, ...] = quantity(
        (), 'relative deviations of the dry frictions, one per rotor'
    )
    quadratic_damping: tuple[float, ...] = quantity(
        (), 'relative deviations of the quadratic dampings, one per rotor'
    )
    non_reciprocity: tuple[float, ...] = quantity(
        (), 'relative deviations of the non-reciprocities, one per spring'
    )
    on_site_torque: tuple[float, ...] = quantity(
        (), 'relative deviations of the on-site torques, one per rotor'
    )
    feedback: tuple[float, ...] = quantity(
        (), 'relative deviations of the feedback gains, one per rotor'
    )

    def __post_init__(self) -> None:
        """Raise ValueError for deviations that are not finite or out of range."""
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
            of_springs = name in _OF_SPRINGS
            wanted = number_of_springs if of_springs else number_of_rotors
            given = len(getattr(self, name))
            if given not in (0, wanted):
                raise ValueError(
                    f'{given} deviations of {name} do not fit a chain of {wanted} '
                    f'{"springs" if of_springs else "rotors"}; give one for each, or none'
                )

    def joined(self, others: Deviations) -> Deviations:
        """Return the combination of two sets of deviations.

        Raises ValueError if both sets contain deviations of the same quantity.
        """
        for name in _NAMES:
            if getattr(self, name) and getattr(others, name):
                raise ValueError(
                    f'deviations of {name} are given twice, as values and as a standard deviation '
                    'of random values; remove one of them'
                )
        return Deviations(
            **{name: getattr(self, name) or getattr(others, name) for name in _NAMES}
        )


_NAMES = tuple(f.name for f in fields(Deviations))
_OF_SPRINGS = ('spacing', 'stiffness', 'rest_length', 'non_reciprocity')
NO_DEVIATIONS = Deviations()
_LARGEST_SPREAD = 0.5
"""Largest allowed relative standard deviation [1]. With this value, one random parameter in forty
would be negative."""


def _spread(of: str) -> Any:
    description = f'relative standard deviation of the {of}'
    return quantity(0.0, description, '', 0.0, _LARGEST_SPREAD)


@document_fields
@dataclass(frozen=True)
class Disorder:
    """Disorder of a chain: relative standard deviations of its rotors and springs, and a seed.

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

    def __post_init__(self) -> None:
        """Raise ValueError for values out of their range."""
        check_quantities(self)

    def drawn(self, number_of_rotors: int, periodic: bool = False) -> Deviations:
        """Return random deviations; quantities with the standard deviation 0 do not deviate."""
        fractions = {name: getattr(self, name) for name in _NAMES if getattr(self, name)}
        return drawn_deviations(number_of_rotors, self.seed, periodic, **fractions)


def drawn_deviations(
    number_of_rotors: int, seed: int, periodic: bool = False, **fractions: float
) -> Deviations:
    """Return random deviations: independent normal numbers of given standard deviations.

    `fractions` are the relative standard deviations by the name of the quantity. The deviations of
    one quantity depend only on the seed and are proportional to the standard deviation. Raises
    ValueError for fewer than 2 rotors, a seed that is not a whole number of 0 or more, an unknown
    name, a negative standard deviation, and a random deviation that `Deviations` does not allow.
    """
    _check_whole('number_of_rotors', number_of_rotors, 2)
    _check_whole('seed', seed, 0)
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
        count = springs if name in _OF_SPRINGS else number_of_rotors
        drawn[name] = tuple((fraction * generator.standard_normal(count)).tolist())
    return Deviations(**drawn)


def _check_whole(name: str, value: object, least: int) -> None:
    if not isinstance(value, Integral) or value < least:
        raise ValueError(f'{name} = {value!r} must be a whole number >= {least}')
