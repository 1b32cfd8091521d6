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
        return self if self is not Edge.NEAREST else _nearest(zero_mode(chain, angles))


def edge_mode(chain: Chain, angles: Array, edge: Edge, anywhere: bool = False) -> Array:
    """Unit zero mode of a configuration that moves the wall away from an edge [1], shape (N,).

    Raises ValueError where the mode sits nearer the other edge, unless it may be anywhere.
    """
    return resolved_edge_mode(chain, angles, edge, anywhere)[1]


def resolved_edge_mode(
    chain: Chain, angles: Array, edge: Edge, anywhere: bool = False
) -> tuple[Edge, Array]:
    """Return the end that is meant, and the mode as `edge_mode` does."""
    mode = mode_towards_last(chain, angles)
    nearest = _nearest(mode)
    end = nearest if edge is Edge.NEAREST else edge
    if end is not nearest and not anywhere:
        raise ValueError(
            f'the zero mode sits at rotor {mode_centre(mode):.1f} of 0 to '
            f'{chain.number_of_rotors - 1}, nearer the {nearest.value} edge than the '
            f'{end.value}; name the {nearest.value} edge'
        )
    return end, mode if end is Edge.FIRST else -mode


def _nearest(mode: Array) -> Edge:
    return Edge.FIRST if mode_centre(mode) <= (len(mode) - 1) / 2 else Edge.LAST
