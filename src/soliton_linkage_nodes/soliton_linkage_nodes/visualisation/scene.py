# SPDX-License-Identifier: Apache-2.0
"""Drawing of a chain in space with coloured lines, spheres and boxes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from soliton_linkage.colours import BLUE, DARK, GREEN, GREY, PURPLE, RED, shares
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.chain import Array, Chain

_LONGEST = 1.2
"""Length of the longest arrow, relative to the larger of rotor length and spacing [1]."""
_SHORTEST_ARROW = 0.02
"""Length below which an arrow is not drawn, relative to the longest arrow [1]."""
_HEAD = (0.3, 0.15)
"""Length and half width of the head of an arrow, relative to the length of the arrow [1]."""
_WALL_HEIGHT = 2.5
"""Height of the box around a wall, relative to the length of the longest rotor [1]. Above 2, the
box encloses rotors that point up or down."""
_LETTERS = 40
"""Ratio of the length of the chain to the height of the letters [1]."""
_AT_REST = 1e-4
"""The brightest colour of a spring shows the largest extension in the drawing, but at least this
extension, relative to the rest length [1]. Because of this limit, the springs of a chain at rest
are grey."""
_DECAY = 0.98
"""From one drawing to the next, the extension with the brightest colour decreases at most by this
factor [1]. The colours therefore change slowly when the extensions decrease."""


class Shape(NamedTuple):
    """Spheres at all points, or lines that connect points 0 and 1, points 2 and 3, and so on."""

    name: str
    points: Array
    """Positions of the points [m], shape (K, 3)."""
    colours: Array
    """Red, green, blue and opacity at each point [1], shape (K, 4)."""
    width: float
    """Width of the lines, or diameter of the spheres [m]."""
    spheres: bool = False


class WallBox(NamedTuple):
    """Box that shows a wall (a soliton) and the standard deviation of its position."""

    position: float
    """Position of the wall along the chain [m]."""
    length: float
    """Length along the chain [m]: four standard deviations, but at least the width of the lines
    that represent rotors."""
    height: float
    """Vertical size [m]."""


class ChainScene:
    """Drawing of a chain. The angles may be such that springs are stretched or compressed."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.width = min(chain.spacing, chain.rotor_length) / 12
        """Width of the lines that represent rotors [m]."""
        middle, length = float(chain.pivots[-1]) / 2, float(chain.pivots[-1]) + chain.spacing
        self.lettering = length / _LETTERS
        """Height of the letters [m]."""
        self._wall_height = _WALL_HEIGHT * float(chain.rotor_lengths.max())
        self.above = (middle, 0.0, self._wall_height + 2 * self.lettering)
        """Position of the text above the chain [m]."""
        self._size = _LONGEST * max(chain.rotor_length, chain.spacing)
        self._largest = 0.0

    def masses(self, angles: Array) -> Array:
        """Return the positions of the masses, shape (N, 3) [m], for `angles`, shape (N,) [rad]."""
        horizontal, vertical = self.chain.positions(angles)
        return np.array([self.chain.pivots + horizontal, np.zeros_like(vertical), vertical]).T

    def shapes(self, angles: Array) -> list[Shape]:
        """Return the shapes that show the chain.

        `angles` [rad] has shape (N,). Rotors with the angle NaN are omitted.
        """
        masses = self.masses(angles)
        known = np.isfinite(angles)
        return [
            self._rods(masses, known),
            Shape('masses', masses[known], _of(BLUE, int(known.sum())), 2 * self.width, True),
            self._springs(masses, angles),
            self._mode(masses, angles),
        ]

    def kick(self, angles: Array, impulses: Array) -> Shape:
        """Return arrows at the masses that show the impulses on the rotors [N m s], shape (N,)."""
        return self._arrows('last_kick', self.masses(angles), angles, impulses, PURPLE)

    def boxes(self, walls: Sequence[tuple[float, float]]) -> list[WallBox]:
        """Return the boxes that show the walls.

        `walls` contains the position and the standard deviation of each wall [m]. A wall with a
        NaN value is omitted.
        """
        return [
            WallBox(position, max(4 * deviation, self.width), self._wall_height)
            for position, deviation in walls
            if math.isfinite(position) and math.isfinite(deviation)
        ]

    def _rods(self, masses: Array, known: Array) -> Shape:
        pivots = np.zeros_like(masses)
        pivots[:, 0] = self.chain.pivots
        ends = np.stack([pivots, masses], axis=1)[known].reshape(-1, 3)
        colours = _of(DARK, len(masses))
        colours[1::2] = _of(GREY, 1)
        return Shape('rotors', ends, np.repeat(colours[known], 2, axis=0), self.width)

    def _springs(self, masses: Array, angles: Array) -> Shape:
        extensions = self.chain.spring_extensions(angles)
        known = np.isfinite(extensions)
        largest = float(np.abs(extensions[known]).max(initial=0.0))
        least = _AT_REST * self.chain.rest_length
        self._largest = max(largest, _DECAY * self._largest, least)
        share = (extensions / self._largest)[known, None]
        ends = np.where(share > 0, _of(RED, 1), _of(BLUE, 1))
        colours = np.abs(share) * ends + (1 - np.abs(share)) * _of(GREY, 1)
        to = np.roll(masses, -1, axis=0)
        to[-1, 0] += self.chain.pivots[-1] + float(self.chain.spacings[-1])
        lines = np.stack([masses, to], axis=1)[: len(extensions)][known].reshape(-1, 3)
        return Shape('springs', lines, np.repeat(colours, 2, axis=0), 0.7 * self.width)

    def _mode(self, masses: Array, angles: Array) -> Shape:
        mode = np.zeros(len(angles))
        if not self.chain.periodic and np.isfinite(angles).all():
            mode = resolved_edge_mode(self.chain, angles, Edge.NEAREST)[1]
        return self._arrows('zero_mode', masses, angles, mode, GREEN)

    def _arrows(self, name: str, masses: Array, angles: Array, sizes: Array, colour: str) -> Shape:
        """Return arrows from the masses in the directions in which the masses can move.

        The lengths are proportional to the absolute values of `sizes`, shape (N,). An arrow with a
        negative size points in the direction of decreasing angle.
        """
        largest = float(np.abs(sizes).max(initial=0.0))
        shown = np.isfinite(angles) & (np.abs(sizes) > _SHORTEST_ARROW * largest)
        ahead = np.array([np.cos(angles), np.zeros_like(angles), -np.sin(angles)]).T[shown]
        aside = ahead[:, [2, 1, 0]] * [1, 1, -1]
        scale = (self._size * sizes[shown] / (largest or 1.0))[:, None]
        tail, (length, half) = masses[shown], _HEAD
        tip = tail + scale * ahead
        left, right = (tip - scale * (length * ahead + side * half * aside) for side in (1, -1))
        lines = np.stack([tail, tip, tip, left, tip, right], axis=1).reshape(-1, 3)
        return Shape(name, lines, _of(colour, len(lines)), self.width)


def _of(colour: str, count: int) -> Array:
    return np.tile([*shares(colour), 1.0], (count, 1))
