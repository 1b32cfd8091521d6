# SPDX-License-Identifier: Apache-2.0
"""Which combinations of the unknowns readings leave open, in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soliton_linkage.linkage.chain import Array

_OF_SCALE = {'rotor_length', 'spacing', 'rest_length'}
_MOST_SAID = 4
"""Combinations that are named [1]."""
_LEAST_TOLD = 1e-4
"""Information below which a combination is not told at all [1]: to 100 times its size."""
_OPEN = 0.1
"""Standard deviation of a combination of lengths, by the angles alone, beyond which it is called
open [1]: more than workshops miss."""


def open_combinations(
    information: Array, basis: Array, parts: Callable[[Array], dict[str, Array]]
) -> tuple[str, ...]:
    """What readings alone tell less well than workshops make it, the least first.

    For what readings say of all unknowns, (P, P), and an orthonormal basis of the changes that
    they may tell, whose parts have names.
    """
    values, vectors = np.linalg.eigh(basis.T @ information @ basis)
    loose = [
        _in_words(max(float(value), _LEAST_TOLD) ** -0.5, parts(basis @ vector))
        for value, vector in zip(values, vectors.T, strict=True)
        if value < _OPEN**-2
    ]
    more = (f'{len(loose) - _MOST_SAID} more',) if len(loose) > _MOST_SAID else ()
    return (*loose[:_MOST_SAID], *more)


def _in_words(spread: float, parts: dict[str, Array]) -> str:
    """Say which rotors and lengths a combination is of, and by how much it is open."""
    size = max(float(np.abs(part).max()) for part in parts.values())
    kinds = [name for name, part in parts.items() if np.abs(part).max() > 0.5 * size]
    sides = [
        np.concatenate([np.flatnonzero(sign * part > 0.5 * size) for part in parts.values()])
        for sign in (1, -1)
    ]
    large = min((side for side in sides if len(side)), key=np.ptp)
    what = 'scale' if set(kinds) == _OF_SCALE else ' and '.join(kinds)
    much = 'not at all' if spread >= _LEAST_TOLD**-0.5 else f'to {spread:.0%}'
    return f'{what} of rotors {large.min()} to {large.max()} against the others: {much}'
