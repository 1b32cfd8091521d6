# SPDX-License-Identifier: Apache-2.0
"""Colours of all pictures; a quantity has the same colour in every figure and film."""

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
"""Names of the colours in captions."""

MEASURED, PAPER, THEORY = BLUE, RED, BLACK
"""Colours of simulated results, of results from the paper, and of the corrected theory."""
COLOURS = (BLUE, RED, GREEN, PURPLE, BLACK)
"""Colours of series without a fixed colour."""
MARKERS = 'os^Dv'
CURVE_COLOURS = (BLUE, PURPLE)
"""Colours of the components of a configuration space."""
MECHANICS_COLOURS = {'elastic': BLUE, 'rigid': RED}
OUTCOME_COLOURS = {'returns': GREEN, 'crosses': SKY, 'lost': DARK}

LEAN_COLOURS = 'PuOr'
"""Colour map of the displacement u: orange if a rotor leans left, purple if it leans right."""
_REST = 0.30
"""Distance between the middle of the colour map and the colour of a rest state [map lengths]."""
_NEAR_REST = ((0.95, 0.24), (1.0, _REST), (1.02, 0.36), (1.05, 0.41), (1.2, 0.46))
"""Nodes of the colour scale: displacement / rest displacement [1], and distance between the colour
of this displacement and the middle of the map [map lengths]. Near the rest state the colour
changes so fast that oscillations of a few per cent are visible."""
LEANS_RIGHT, LEANS_LEFT = (to_hex(colormaps[LEAN_COLOURS](0.5 + side * _REST)) for side in (1, -1))
"""Colours of the right-leaning and of the left-leaning uniform state."""

_SHADES = {
    Motion.FLIPPER: (BLUE, SKY, '#003a5c'),
    Motion.WOBBLING_FLIPPER: (ORANGE, '#a06a00', '#5c3d00'),
    Motion.SPINNER: (GREEN, '#66c5ab', '#00523c'),
}
MOTION_COLOURS = {motion: shades[0] for motion, shades in _SHADES.items()}
"""Colours of chains by their class of motion."""


def chain_colours(chains: Sequence[Chain]) -> list[str]:
    """Return for each chain a shade of the colour of its motion class.

    In each class, the chain with the largest lean ratio has the pure class colour.
    """
    order = sorted(range(len(chains)), key=lambda number: -chains[number].lean_ratio)
    found: dict[int, str] = {}
    for number in order:
        shades = _SHADES[chains[number].motion]
        before = sum(chains[other].motion is chains[number].motion for other in found)
        found[number] = shades[before % len(shades)]
    return [found[number] for number in range(len(chains))]


def scale_colours(count: int) -> list[str]:
    """Return colours for `count` ordered values, from dark to light."""
    return [to_hex(colour) for colour in colormaps['viridis'](np.linspace(0.0, 0.82, count))]


def tint(colour: str, share: float) -> str:
    """Mix a colour with white. `share` is the fraction of `colour` in the mixture [1]."""
    red, green, blue = (share * part + 1 - share for part in to_rgb(colour))
    return to_hex((red, green, blue))


def lean_colour_scale(chain: Chain) -> tuple[Array, Array]:
    """Return nodes of the colour scale: displacements u [m], positions in the colour map [1]."""
    rest, largest = float(lean_ticks(chain)[3]), float(lean_ticks(chain)[4])
    near = [
        (share * rest, offset) for share, offset in _NEAR_REST if share * rest < 0.99 * largest
    ]
    positions, offsets = np.array([*near, (largest, 0.5)]).T
    return (
        np.concatenate([-positions[::-1], [0.0], positions]),
        np.concatenate([0.5 - offsets[::-1], [0.5], 0.5 + offsets]),
    )


def lean_colour_table(chain: Chain, levels: int) -> NDArray[np.uint8]:
    """Return the RGB colours of evenly spaced displacements from -r to r, shape (levels, 3)."""
    positions, shares = lean_colour_scale(chain)
    largest = float(lean_ticks(chain)[4])
    map_positions = np.interp(np.linspace(-largest, largest, levels), positions, shares)
    return np.asarray(colormaps[LEAN_COLOURS](map_positions, bytes=True)[:, :3], dtype=np.uint8)


def lean_ticks(chain: Chain) -> Array:
    """Return displacements u [m] for ticks: -r, -r sin(theta_bar), 0, r sin(theta_bar) and r."""
    rest = chain.rotor_length * float(np.sin(chain.rest_angle))
    largest = float(chain.rotor_lengths.max())
    return np.array([-largest, -rest, 0.0, rest, largest])
