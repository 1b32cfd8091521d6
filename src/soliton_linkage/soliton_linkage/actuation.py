# SPDX-License-Identifier: Apache-2.0
"""What an actuator at an edge of the chain can get hold of."""

from __future__ import annotations

import enum

from soliton_linkage.chain import Array, Chain
from soliton_linkage.rigidity import mode_centre, mode_towards_last, zero_mode


class Edge(enum.Enum):
    """An end of the chain, or the one that the zero mode is nearer to."""

    NEAREST = 'nearest'
    FIRST = 'first'
    LAST = 'last'

    def resolved(self, chain: Chain, angles: Array) -> Edge:
        """Return the end that is meant in a configuration."""
        if self is not Edge.NEAREST:
            return self
        centre = mode_centre(zero_mode(chain, angles))
        return Edge.FIRST if centre <= (chain.number_of_rotors - 1) / 2 else Edge.LAST


def edge_mode(chain: Chain, angles: Array, edge: Edge, anywhere: bool = False) -> Array:
    """Unit zero mode of a configuration that moves the wall away from an edge [1], shape (N,).

    Raises ValueError where the mode sits nearer the other edge, unless it may be anywhere.
    """
    mode = mode_towards_last(chain, angles)
    nearest = Edge.NEAREST.resolved(chain, angles)
    end = nearest if edge is Edge.NEAREST else edge
    if end is not nearest and not anywhere:
        raise ValueError(
            f'the zero mode sits at rotor {mode_centre(mode):.1f} of 0 to '
            f'{chain.number_of_rotors - 1}, nearer the {nearest.value} edge than the '
            f'{end.value}; name the {nearest.value} edge'
        )
    return mode if end is Edge.FIRST else -mode
