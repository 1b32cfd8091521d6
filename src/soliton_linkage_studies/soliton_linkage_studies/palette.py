# SPDX-License-Identifier: Apache-2.0
"""Colours of all pictures: one thing has one of them in every figure and film."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex, to_rgb
from numpy.typing import NDArray

from soliton_linkage.colours import BLACK as BLACK
from soliton_linkage.colours import BLUE as BLUE
from soliton_linkage.colours import DARK as DARK
from soliton_linkage.colours import GREEN as GREEN
from soliton_linkage.colours import GREY as GREY
from soliton_linkage.colours import ORANGE as ORANGE
from soliton_linkage.colours import PALE as PALE
from soliton_linkage.colours import PURPLE as PURPLE
from soliton_linkage.colours import RED as RED
from soliton_linkage.colours import SKY as SKY
from soliton_linkage.colours import WHITE as WHITE
from soliton_linkage.linkage.chain import Array, Chain, Motion

NAMES = {
    BLACK: 'black',
    GREY: 'grey',
    PALE: 'pale grey',
    DARK: 'dark grey',
    BLUE: 'blue',
    SKY: 'sky blue',
    RED: 'red',
    ORANGE: 'orange',
    GREEN: 'green',
    PURPLE: 'pink',
    WHITE: 'white',
}
"""What captions call them."""

MEASURED, PAPER, THEORY = BLUE, RED, BLACK
"""Of what simulated chains do, of what the paper says, and of what corrected theory says."""
COLOURS = (BLUE, RED, GREEN, PURPLE, BLACK)
"""Of things beside each other that have no colour of their own."""
MARKERS = 'os^Dv'
"""Of points beside each other."""
CURVE_COLOURS = (BLUE, PURPLE)
"""Of the components of a configuration space."""
MECHANICS_COLOURS = {'elastic': BLUE, 'rigid': RED}
"""Of chains of springs and of rigid bars."""
OUTCOME_COLOURS = {'returns': GREEN, 'crosses': SKY, 'lost': DARK}
"""Of what becomes of a wall."""

LEAN_COLOURS = 'PuOr'
"""Colour map of u: orange where the rotors lean left, purple where they lean right."""
_REST = 0.30
"""Of the map, from its middle to a uniform state at rest [1]: what overshoots it is darker."""
_NEAR_REST = ((0.95, 0.24), (1.0, _REST), (1.02, 0.36), (1.05, 0.41), (1.2, 0.46))
"""Displacements over that at rest, and how far from the middle of the map: swings of a few per
cent about rest are seen [1]."""
LEANS_RIGHT, LEANS_LEFT = (to_hex(colormaps[LEAN_COLOURS](0.5 + side * _REST)) for side in (1, -1))
"""Of the uniform states that lean right and left."""

_SHADES = {
    Motion.FLIPPER: (BLUE, SKY, '#003a5c'),
    Motion.WOBBLING_FLIPPER: (ORANGE, '#a06a00', '#5c3d00'),
    Motion.SPINNER: (GREEN, '#66c5ab', '#00523c'),
}
MOTION_COLOURS = {motion: shades[0] for motion, shades in _SHADES.items()}
"""Of chains by the way in which their walls move."""


def chain_colours(chains: Sequence[Chain]) -> list[str]:
    """Return the colour of the class of each chain, in shades where several are of one.

    The one of the largest lean ratio d has the colour of the class itself.
    """
    order = sorted(range(len(chains)), key=lambda number: -chains[number].lean_ratio)
    found: dict[int, str] = {}
    for number in order:
        shades = _SHADES[chains[number].motion]
        before = sum(chains[other].motion is chains[number].motion for other in found)
        found[number] = shades[before % len(shades)]
    return [found[number] for number in range(len(chains))]


def scale_colours(count: int) -> list[str]:
    """Return colours of values in their order, from dark to light."""
    return [to_hex(colour) for colour in colormaps['viridis'](np.linspace(0.0, 0.82, count))]


def tint(colour: str, share: float) -> str:
    """Return a colour that is a share of another one, the rest white."""
    red, green, blue = (share * part + 1 - share for part in to_rgb(colour))
    return to_hex((red, green, blue))


def lean_colour_scale(chain: Chain) -> tuple[Array, Array]:
    """Displacements u [m] and where the colour map has them [1], both (K,), lines in between.

    A uniform state has the same colours in all chains; swings about it are stretched, and not
    even the length of a rotor is clipped.
    """
    rest, largest = float(lean_ticks(chain)[3]), float(lean_ticks(chain)[4])
    near = [(share * rest, off) for share, off in _NEAR_REST if share * rest < 0.99 * largest]
    places, offs = np.array([*near, (largest, 0.5)]).T
    return (
        np.concatenate([-places[::-1], [0.0], places]),
        np.concatenate([0.5 - offs[::-1], [0.5], 0.5 + offs]),
    )


def lean_colour_table(chain: Chain, levels: int) -> NDArray[np.uint8]:
    """Red, green and blue of displacements from -r to r, evenly spaced, shape (levels, 3)."""
    places, shares = lean_colour_scale(chain)
    largest = float(lean_ticks(chain)[4])
    offs = np.interp(np.linspace(-largest, largest, levels), places, shares)
    return np.asarray(colormaps[LEAN_COLOURS](offs, bytes=True)[:, :3], dtype=np.uint8)


def lean_ticks(chain: Chain) -> Array:
    """Displacements u [m] furthest and at rest to the left, none, at rest and furthest right."""
    rest = chain.rotor_length * float(np.sin(chain.rest_angle))
    largest = float(chain.rotor_lengths.max())
    return np.array([-largest, -rest, 0.0, rest, largest])
