# SPDX-License-Identifier: Apache-2.0
"""Pictures of one chain, its zero mode and its configuration space on matplotlib axes.

Pivots are crosses, rotors black bars, masses blue dots, springs dashed red lines (solid where
they are rigid bars), and the zero mode is green arrows at the masses (paper, Fig. 1). Where
rotors reach over their neighbours every other one is grey, and each has a white border.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Literal

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import FuncNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.quiver import Quiver
from numpy.typing import ArrayLike

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.palette import (
    BLACK,
    BLUE,
    CURVE_COLOURS,
    GREEN,
    GREY,
    LEAN_COLOURS,
    LEANS_LEFT,
    LEANS_RIGHT,
    RED,
    WHITE,
    lean_colour_scale,
)

_OUTSIDE = matplotlib.__version_info__ >= (3, 7)
"""Whether a legend may be beyond the panels: before, it is drawn over them [1]."""
LEGEND_ABOVE: Literal['outside upper center', 'upper center'] = (
    'outside upper center' if _OUTSIDE else 'upper center'
)
"""Place of a legend of a figure: above its panels, where matplotlib can do so."""
LEGEND_BELOW: Literal['outside lower center', 'lower center'] = (
    'outside lower center' if _OUTSIDE else 'lower center'
)
"""The same beneath them."""
_MARGIN = 0.35
"""Room around what a chain can reach [rotor spacings]."""
_ROW = 0.3
"""Height of a row of projections [rotor spacings]."""
_ARROW = 1.2
"""Length of an arrow of a component 1 of a mode, over the longer of a and r."""


def displacement(chain: Chain, angles: Array) -> Array:
    """Horizontal displacements u_n = r sin(phi_n) of the masses [m], shape of the angles."""
    return chain.positions(angles)[0]


def pivot_points(chain: Chain) -> Array:
    """Places of the pivots [m], (x, z) of each, shape (N, 2)."""
    offsets = np.cumsum(chain.spacings[: chain.number_of_rotors - 1])
    along = np.concatenate([[0.0], offsets])
    return np.column_stack([along, np.zeros_like(along)])


def mass_points(chain: Chain, angles: Array) -> Array:
    """Places of the masses [m], (x_n + r sin(phi_n), r cos(phi_n)), shape (N, 2)."""
    return pivot_points(chain) + np.column_stack(chain.positions(angles))


def mode_arrows(chain: Chain, angles: Array, mode: Array) -> Array:
    """Velocities of the masses in a mode, r t_n (cos(phi_n), -sin(phi_n)), shape (N, 2).

    In [m] for a mode in [rad], perpendicular to the rotors.
    """
    horizontal, vertical = chain.positions(angles)
    return np.column_stack([mode * vertical, -mode * horizontal])


def limits(
    chain: Chain, projections: bool = False, lowered: float = 0.0
) -> tuple[float, float, float, float]:
    """Left, right, bottom and top [m] of what a chain can reach, and a margin."""
    margin = _MARGIN * chain.spacing
    reach = float(chain.rotor_lengths.max()) + margin
    bottom = float(_rows(chain).min()) - margin / 2 if projections else -reach
    return -reach, float(chain.spacings.sum()) + reach, bottom - lowered, reach


def lean_norm(chain: Chain) -> FuncNorm:
    """Where displacements u [m] are in `LEAN_COLOURS`, by `lean_colour_scale`."""
    places, shares = lean_colour_scale(chain)
    return FuncNorm(
        (partial(_between, places, shares), partial(_between, shares, places)),
        vmin=float(places[0]),
        vmax=float(places[-1]),
    )


class ChainPicture:
    """The artists of one chain on axes, which `update` moves; the limits of the axes fit it."""

    def __init__(
        self,
        axes: Axes,
        chain: Chain,
        angles: Array,
        mode: Array | None = None,
        *,
        rigid: bool = False,
        projections: bool = False,
        arrow_length: float | None = None,
        lowered: float = 0.0,
    ) -> None:
        """Draw a chain at angles [rad] with its mode [1], if one is given, shape (N,) each.

        A component 1 of the mode is an arrow of `arrow_length` [m], for all rotors and times.
        Odd rotors are drawn lower than they are [m], where rotors would hide each other.
        """
        self.chain = chain
        self.axes = axes
        self._lowering = np.where(np.arange(chain.number_of_rotors) % 2, lowered, 0.0)
        self._arrow_length = arrow_length
        self.springs, self.rotors = _bars(axes, chain, rigid)
        self.pivots, self.masses = _points(axes, chain)
        self.arrows = None
        if mode is not None:
            self.arrows = mode_quiver(axes, chain, angles, mode, arrow_length)
        self.projections = None
        if projections:
            self.projections = projection_quiver(axes, chain, angles, lowered)
        self.update(angles, mode)
        left, right, bottom, top = limits(chain, projections, lowered)
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_aspect('equal', adjustable='box')
        axes.set_axis_off()

    @property
    def artists(self) -> list[Artist]:
        """Everything that `update` may move, from back to front."""
        moving = (
            self.springs,
            self.rotors,
            self.pivots,
            self.arrows,
            self.projections,
            self.masses,
        )
        return [artist for artist in moving if artist is not None]

    def update(self, angles: Array, mode: Array | None = None, tilt: float = 0.0) -> None:
        """Move to angles [rad] and a mode [1], shape (N,); arrows hide where none is given.

        A tilt [rad] turns the chain about its middle and lowers its last rotor.
        """
        chain = self.chain
        pivots, masses = pivot_points(chain), mass_points(chain, angles)
        turned, centre = _turned(tilt), (pivots[0] + pivots[-1]) / 2
        pivots, masses = ((points - centre) @ turned + centre for points in (pivots, masses))
        for points in (pivots, masses):
            points[:, 1] -= self._lowering
        beyond = masses[:1] + [float(chain.spacings.sum()), 0.0] @ turned
        joined = np.concatenate([masses, beyond])
        springs = chain.number_of_springs
        self.pivots.set_data(*pivots.T)
        self.masses.set_data(*masses.T)
        self.rotors.set_segments(list(np.stack([pivots, masses], axis=1)))
        ends = np.stack([joined[:springs], joined[1 : springs + 1]], axis=1)
        self.springs.set_segments(list(ends))
        if self.arrows is not None:
            self.arrows.set_visible(mode is not None)
        if self.arrows is not None and mode is not None:
            vectors = _stretched(chain, angles, mode, self._arrow_length) @ turned
            self.arrows.set_offsets(masses)
            self.arrows.set_UVC(*vectors.T)
        if self.projections is not None:
            move_projections(self.projections, chain, angles)


def expand_limits(pictures: Sequence[ChainPicture]) -> tuple[float, float]:
    """Widen the limits of pictures alike until the arrows of their modes lie within.

    Returns the width and the height of what they show [m].
    """
    shown = [picture.axes for picture in pictures]
    corners = [np.transpose([axes.get_xlim(), axes.get_ylim()]) for axes in shown]
    for picture in pictures:
        if picture.arrows is not None and picture.arrows.get_visible():
            vectors = np.column_stack([picture.arrows.U, picture.arrows.V])
            tips = np.asarray(picture.arrows.get_offsets()) + vectors
            margin = _MARGIN * picture.chain.spacing
            corners += [tips - margin, tips + margin]
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    for axes in shown:
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    width, height = (high - low).tolist()
    return width, height


def add_legend(figure: Figure) -> None:
    """Name the parts of pictures of chains beneath them, all in one row."""
    right, left = (f'u leans {side}' for side in ('right', 'left'))
    looks: list[tuple[str, str, str, Literal['', '-', '--']]] = [
        ('pivot', BLACK, 'x', ''),
        ('rotor', BLACK, '', '-'),
        ('mass', BLUE, 'o', ''),
        ('spring', RED, '', '--'),
        ('velocity in the zero mode', GREEN, r'$\rightarrow$', ''),
        (right, LEANS_RIGHT, r'$\rightarrow$', ''),
        (left, LEANS_LEFT, r'$\leftarrow$', ''),
    ]
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle=line, label=name, markersize=8)
        for name, colour, marker, line in looks
    ]
    figure.legend(
        handles=handles,
        loc=LEGEND_BELOW,
        ncols=len(handles),
        fontsize=8,
        frameon=False,
    )


def mode_quiver(
    axes: Axes, chain: Chain, angles: Array, mode: Array, arrow_length: float | None = None
) -> Quiver:
    """Arrows of a mode [1], shape (N,), at the masses, for `ChainPicture` to move.

    They are the velocities of the masses times one factor, which makes an arrow of
    `arrow_length` [m] of a component 1; by itself 1.2 times the longer of a and r.
    """
    vectors = _stretched(chain, angles, mode, arrow_length)
    return _quiver(axes, mass_points(chain, angles), vectors, 0.9 * _thickness(chain), GREEN)


def projection_quiver(axes: Axes, chain: Chain, angles: Array, lowered: float = 0.0) -> Quiver:
    """Arrows u_n = r sin(phi_n) [m] beneath the rotors, which `move_projections` moves.

    Purple arrows lean right, orange ones left. Where rotors are longer than the spacing, their
    arrows take turns in several rows.
    """
    along = displacement(chain, angles)
    places = pivot_points(chain) + np.column_stack([np.zeros_like(along), _rows(chain) - lowered])
    vectors = np.column_stack([along, np.zeros_like(along)])
    arrows = _quiver(axes, places, vectors, 0.9 * _thickness(chain), None)
    arrows.set_cmap(LEAN_COLOURS)
    arrows.set_norm(lean_norm(chain))
    arrows.set_array(along)
    return arrows


def move_projections(arrows: Quiver, chain: Chain, angles: Array) -> None:
    """Move the arrows of `projection_quiver` to angles [rad], shape (N,)."""
    along = displacement(chain, angles)
    arrows.set_UVC(along, np.zeros_like(along), along)


def draw_torus(axes: Axes, chain: Chain, curves: Sequence[Array]) -> Axes:
    """Draw configurations of a unit cell, staggered angles [rad] of shape (K, 2) a curve.

    The square is the torus of both angles, its opposite sides one; triangles are the ground
    states, purple ones lean right and orange ones left (paper, Fig. 4c).
    """
    for number, curve in enumerate(curves):
        colour = CURVE_COLOURS[number % len(CURVE_COLOURS)]
        axes.plot(*split_at_wraps(curve).T, color=colour, linewidth=2.5, zorder=2)
    rest = chain.rest_angle
    for states, marker, colour, label in (
        ((rest, math.pi - rest), '>', LEANS_RIGHT, 'leans right'),
        ((-rest, rest - math.pi), '<', LEANS_LEFT, 'leans left'),
    ):
        axes.plot(
            states,
            states,
            marker,
            color=colour,
            markersize=13,
            markeredgecolor=WHITE,
            label=label,
            zorder=4,
        )
    ticks = [-math.pi, -math.pi / 2, 0, math.pi / 2, math.pi]
    names = ['−π', '−π/2', '0', 'π/2', 'π']
    axes.set(xlim=(-math.pi, math.pi), ylim=(-math.pi, math.pi), aspect='equal')
    axes.set_xticks(ticks, names)
    axes.set_yticks(ticks, names)
    axes.set(xlabel='θ₁ [rad]', ylabel='θ₂ [rad]')
    return axes


def split_at_wraps(curve: Array) -> Array:
    """Angles within -pi to pi [rad], shape (K + breaks, 2), a NaN where a curve leaves them."""
    wrapped = np.asarray(np.mod(curve + np.pi, 2 * np.pi) - np.pi)
    jumps = np.flatnonzero((np.abs(np.diff(wrapped, axis=0)) > np.pi).any(axis=1)) + 1
    return np.insert(wrapped, jumps, np.nan, axis=0)


def _bars(axes: Axes, chain: Chain, rigid: bool) -> tuple[LineCollection, LineCollection]:
    """Springs and rotors without a place."""
    thickness = _thickness(chain)
    springs = LineCollection(
        [],
        colors=RED,
        linewidths=0.75 * thickness,
        linestyles='solid' if rigid else [(0, (2.5, 1.2))],
        zorder=2,
    )
    overlapping = chain.rotor_length > chain.spacing
    rotors = LineCollection(
        [],
        colors=[BLACK, GREY] if overlapping else BLACK,
        linewidths=thickness,
        capstyle='round',
        path_effects=[withStroke(linewidth=thickness + 1.6, foreground=WHITE)],
        zorder=3,
    )
    axes.add_collection(springs, autolim=False)
    axes.add_collection(rotors, autolim=False)
    return springs, rotors


def _points(axes: Axes, chain: Chain) -> tuple[Line2D, Line2D]:
    """Pivots and masses without a place."""
    thickness = _thickness(chain)
    size = 3 * thickness
    (pivots,) = axes.plot(
        [], [], 'x', color=BLACK, markersize=size, markeredgewidth=0.6 * thickness, zorder=4
    )
    (masses,) = axes.plot(
        [], [], 'o', color=BLUE, markersize=size, markeredgecolor=WHITE, zorder=6
    )
    return pivots, masses


def _quiver(
    axes: Axes, places: Array, vectors: Array, thickness: float, colour: str | None
) -> Quiver:
    return axes.quiver(
        *places.T,
        *vectors.T,
        angles='xy',
        units='inches',
        scale_units='xy',
        scale=1,
        width=thickness / 72,
        headwidth=3.5,
        headlength=4,
        headaxislength=3.6,
        color=colour,
        clip_on=False,
        zorder=5,
    )


def _stretched(chain: Chain, angles: Array, mode: Array, arrow_length: float | None) -> Array:
    longest = arrow_length or _ARROW * max(chain.rotor_length, chain.spacing)
    return longest / chain.rotor_length * mode_arrows(chain, angles, mode)


def _thickness(chain: Chain) -> float:
    """Of a rotor [points]."""
    return min(max(50 / chain.number_of_rotors, 0.8), 5.0)


def _rows(chain: Chain) -> Array:
    """Height of the projection of each rotor [m], beneath all that the rotors reach, (N,)."""
    rows = math.ceil(chain.rotor_length / chain.spacing)
    row = np.arange(chain.number_of_rotors) % rows
    reach = float(chain.rotor_lengths.max()) + _MARGIN * chain.spacing
    return np.asarray(-reach - _ROW * chain.spacing * (row + 0.5))


def _turned(tilt: float) -> Array:
    """Matrix that points (x, z) are multiplied by to lower the end at x > 0, (2, 2)."""
    sine, cosine = math.sin(tilt), math.cos(tilt)
    return np.array([[cosine, -sine], [sine, cosine]])


def _between(places: Array, values: Array, wanted: ArrayLike) -> Array:
    """Values at places in between, straight on beyond the first and the last."""
    at = np.asarray(np.ma.filled(wanted, np.nan), dtype=np.float64)
    inside = np.interp(at, places, values)
    slopes = np.diff(values)[[0, -1]] / np.diff(places)[[0, -1]]
    beyond = np.minimum(at - places[0], 0) * slopes[0] + np.maximum(at - places[-1], 0) * slopes[1]
    return np.asarray(inside + beyond)
