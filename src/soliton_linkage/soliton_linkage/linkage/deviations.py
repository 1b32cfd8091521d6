# SPDX-License-Identifier: Apache-2.0
"""How single rotors and springs differ from the parameters of their chain."""

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
"""Largest relative deviation of a rotor or spring [1]; larger ones would overflow products."""
_LOWEST_FRACTIONS = {
    'dry_friction': -1.0,
    'quadratic_damping': -1.0,
    'non_reciprocity': -_LARGEST_FRACTION,
    'on_site_torque': -_LARGEST_FRACTION,
}
"""Lowest relative deviation where a single rotor or bond may have a value of 0 or below [1]."""


@document_fields
@dataclass(frozen=True)
class Deviations:
    """Relative deviations of rotors and springs from the parameters of the chain; empty for none.

    A rotor whose fraction of rotor_length is 0.02 is 1.02 times as long as the chain's
    parameter. Raises ValueError for a fraction of -1 or less, except that frictions may vanish
    and that non-reciprocities and on-site torques may have either sign.
    """

    spacing: tuple[float, ...] = quantity(
        (), 'fractions of the distance from each rotor to the next, one a spring'
    )
    rotor_length: tuple[float, ...] = quantity(
        (), 'fractions of the length of each rotor, one a rotor'
    )
    mass: tuple[float, ...] = quantity((), 'fractions of the mass of each rotor, one a rotor')
    stiffness: tuple[float, ...] = quantity(
        (), 'fractions of the stiffness of each spring, one a spring'
    )
    rest_length: tuple[float, ...] = quantity(
        (), 'fractions of the length of each spring at rest, one a spring'
    )
    damping: tuple[float, ...] = quantity(
        (), 'fractions of the damping of each rotor, one a rotor'
    )
    dry_friction: tuple[float, ...] = quantity(
        (), 'fractions of the dry friction of each rotor, one a rotor'
    )
    quadratic_damping: tuple[float, ...] = quantity(
        (), 'fractions of the quadratic damping of each rotor, one a rotor'
    )
    non_reciprocity: tuple[float, ...] = quantity(
        (), 'fractions of the non-reciprocity of each bond, one a spring'
    )
    on_site_torque: tuple[float, ...] = quantity(
        (), 'fractions of the on-site torque of each rotor, one a rotor'
    )

    def __post_init__(self) -> None:
        """Refuse fractions that are not finite or leave nothing."""
        for name in _NAMES:
            for place, fraction in enumerate(getattr(self, name)):
                lowest = _LOWEST_FRACTIONS.get(name, -1.0)
                allowed = fraction > -1 or (name in _LOWEST_FRACTIONS and fraction >= lowest)
                if not (allowed and fraction <= _LARGEST_FRACTION):
                    bound = f'{lowest:g} or more' if name in _LOWEST_FRACTIONS else 'above -1'
                    raise ValueError(
                        f'deviation {place} of {name} = {fraction:g} must be a finite number '
                        f'{bound}, {_LARGEST_FRACTION:g} or less; give fractions of the '
                        'parameter of the chain'
                    )

    def check_fit(self, number_of_rotors: int, number_of_springs: int) -> None:
        """Raise ValueError where there are fractions, but not one a rotor or spring."""
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
        """These and others; raises ValueError where both have fractions of one quantity."""
        for name in _NAMES:
            if getattr(self, name) and getattr(others, name):
                raise ValueError(
                    f'deviations of {name} are both given and drawn; give the fractions, or the '
                    'standard deviation to draw them with'
                )
        return Deviations(
            **{name: getattr(self, name) or getattr(others, name) for name in _NAMES}
        )


_NAMES = tuple(f.name for f in fields(Deviations))
_OF_SPRINGS = ('spacing', 'stiffness', 'rest_length', 'non_reciprocity')
NO_DEVIATIONS = Deviations()
_LARGEST_SPREAD = 0.5
"""Largest standard deviation [1]: one rotor in forty would have a negative value."""


def _spread(of: str) -> Any:
    description = f'standard deviation of the {of}, as a fraction'
    return quantity(0.0, description, '', 0.0, _LARGEST_SPREAD)


@document_fields
@dataclass(frozen=True)
class Disorder:
    """Standard deviations of the fractions by which rotors and springs differ, and their seed.

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
    seed: int = quantity(0, 'seed of the fractions that are drawn', '', 0, LARGEST_SEED)

    def __post_init__(self) -> None:
        """Refuse values out of their range."""
        check_quantities(self)

    def drawn(self, number_of_rotors: int, periodic: bool = False) -> Deviations:
        """Draw the deviations of a chain; none of a quantity whose standard deviation is 0."""
        fractions = {name: getattr(self, name) for name in _NAMES if getattr(self, name)}
        return drawn_deviations(number_of_rotors, self.seed, periodic, **fractions)


def drawn_deviations(
    number_of_rotors: int, seed: int, periodic: bool = False, **fractions: float
) -> Deviations:
    """Draw independent normal deviations, given the standard deviation of each by name.

    The draw of one quantity does not depend on which others are drawn, and that for a given
    seed scales with the fraction. Raises ValueError for fewer than 2 rotors, a seed that is not a
    whole number of 0 or more, a name that is none of `Deviations`, and a fraction that is
    negative or so large that something is left with nothing.
    """
    _check_whole('number_of_rotors', number_of_rotors, 2)
    _check_whole('seed', seed, 0)
    springs = number_of_rotors if periodic else number_of_rotors - 1
    drawn = {}
    for name, fraction in fractions.items():
        if name not in _NAMES:
            raise ValueError(f'deviation of {name!r} must be of one of {", ".join(_NAMES)}')
        if not (math.isfinite(fraction) and fraction >= 0):
            raise ValueError(
                f'fraction of {name} = {fraction} must be a finite number of 0 or more'
            )
        generator = np.random.Generator(np.random.PCG64([seed, _NAMES.index(name)]))
        count = springs if name in _OF_SPRINGS else number_of_rotors
        drawn[name] = tuple((fraction * generator.standard_normal(count)).tolist())
    return Deviations(**drawn)


def _check_whole(name: str, value: object, least: int) -> None:
    if not isinstance(value, Integral) or value < least:
        raise ValueError(f'{name} = {value!r} must be a whole number; give one of {least} or more')
