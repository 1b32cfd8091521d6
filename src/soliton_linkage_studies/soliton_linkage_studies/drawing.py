# SPDX-License-Identifier: Apache-2.0
"""Pictures of a chain, its zero mode and its configuration space, with captions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import FuncNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.quiver import Quiver
from numpy.typing import ArrayLike

from soliton_linkage.linkage.chain import Array, Chain, displacement
from soliton_linkage_studies import palette

LINKAGE = (
    'Black crosses are the pivots, black bars the rotors and blue dots the masses at their ends. '
    'Where rotors overlap their neighbours, every other rotor is grey. r is the rotor length, a '
    'the rotor spacing, θ̄ the rest angle, and d = 2 r sin θ̄ / a.'
)
MODE = 'green arrows are the velocities of the masses in this mode, all drawn to the same scale'
"""Clause of a caption that explains the zero-mode arrows."""
PROJECTIONS = (
    'Arrows below the pivots are the horizontal displacements u = r sin φ of the masses, in '
    'several rows if they would overlap. Arrows to the right are purple, arrows to the left are '
    'orange, and short arrows are paler.'
)


def parameters(chain: Chain) -> str:
    """Return a text with r/a and the rest angle [rad]."""
    return f'r/a = {chain.rotor_length / chain.spacing:g}, θ̄ = {chain.rest_angle:g}'


def shape(chain: Chain) -> str:
    """Return a text with r/a, the rest angle [rad] and the lean ratio d."""
    return f'{parameters(chain)}, d = {chain.lean_ratio:.2f}'


def class_and_shape(chain: Chain) -> str:
    """Return the motion class, followed by r/a and the rest angle [rad] in parentheses."""
    ratio = chain.rotor_length / chain.spacing
    return f'{chain.motion.value} ({ratio:g}, {chain.rest_angle:g})'


def description(chain: Chain) -> str:
    """Return a one-line description: class, r/a, rest angle, lean ratio and rotor count."""
    return (
        f'{chain.motion.value}: r/a = {chain.rotor_length / chain.spacing:g}, '
        f'rest angle {chain.rest_angle:g} rad, d = {chain.lean_ratio:.2f}, '
        f'{chain.number_of_rotors} rotors'
    )


_OUTSIDE = matplotlib.__version_info__ >= (3, 7)
"""Whether matplotlib can put a legend outside the panels; otherwise the legend covers a panel."""
LEGEND_ABOVE: Literal['outside upper center', 'upper center'] = (
    'outside upper center' if _OUTSIDE else 'upper center'
)
LEGEND_BELOW: Literal['outside lower center', 'lower center'] = (
    'outside lower center' if _OUTSIDE else 'lower center'
)
PIXELS: Any = {
    'cmap': palette.LEAN_COLOURS,
    'origin': 'lower',
    'aspect': 'auto',
    'interpolation': 'nearest',
}
"""Keywords of `Axes.imshow` for images of displacements or order fields."""
_MARGIN = 0.35
"""Width of the margin around the area that the rotors can reach [rotor spacings]."""


def pivot_points(chain: Chain) -> Array:
    """Return the (x, z) coordinates of the pivots [m], shape (N, 2)."""
    return np.column_stack([chain.pivots, np.zeros_like(chain.pivots)])


def show_leans(
    axes: Axes, chain: Chain, leans: Array, extent: tuple[float, float, float, float]
) -> AxesImage:
    """Draw displacements u [m], shape (rows, columns), as an image; return the image."""
    return axes.imshow(leans, norm=lean_norm(chain), extent=extent, **PIXELS)


def mass_points(chain: Chain, angles: Array) -> Array:
    """Return the mass coordinates (x_n + r sin(phi_n), r cos(phi_n)) [m], shape (N, 2)."""
    return pivot_points(chain) + np.column_stack(chain.positions(angles))


def mode_arrows(chain: Chain, angles: Array, mode: Array) -> Array:
    """Return mass displacements r t_n (cos(phi_n), -sin(phi_n)) [m] of a mode t, shape (N, 2)."""
    horizontal, vertical = chain.positions(angles)
    return np.column_stack([mode * vertical, -mode * horizontal])


def limits(
    chain: Chain, projections: bool = False, lowered: float = 0.0
) -> tuple[float, float, float, float]:
    """Return the limits left, right, bottom and top [m] of a picture of a chain.

    If `projections` is true, the picture includes the displacement arrows below the chain. Odd
    rotors are drawn `lowered` [m] below even ones.
    """
    margin = _MARGIN * chain.spacing
    reach = float(chain.rotor_lengths.max()) + margin
    bottom = float(_rows(chain).min()) - margin / 2 if projections else -reach
    return -reach, float(chain.spacings.sum()) + reach, bottom - lowered, reach


def lean_norm(chain: Chain) -> FuncNorm:
    """Return the matplotlib norm that maps displacements u [m] to positions in the colour map."""
    positions, shares = palette.lean_colour_scale(chain)
    return FuncNorm(
        (partial(_between, positions, shares), partial(_between, shares, positions)),
        vmin=float(positions[0]),
        vmax=float(positions[-1]),
    )


class ChainPicture:
    """Matplotlib artists of one chain, which `update` moves; the axis limits fit the chain."""

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
        """Draw a chain at angles [rad] with an optional mode [1], each of shape (N,).

        A mode component of 1 is drawn as an arrow of `arrow_length` [m]; if this is None, the
        length is 1.2 times the larger of rotor length and spacing. If `rigid` is true, springs are
        drawn as solid lines, otherwise as dashed lines. If `projections` is true, the
        displacements u = r sin(phi) are drawn as arrows below the chain. Odd rotors are drawn
        `lowered` [m] below even ones, so that rotors do not overlap.
        """
        self.chain = chain
        self.axes = axes
        self._lowering = np.where(np.arange(chain.number_of_rotors) % 2, lowered, 0.0)
        self._arrow_length = arrow_length
        self.springs, self.rotors = _bars(axes, chain, rigid)
        self.pivots, self.masses = _points(axes, chain)
        self.arrows = None
        if mode is not None:
            vectors = _stretched(chain, angles, mode, arrow_length)
            self.arrows = _quiver(axes, mass_points(chain, angles), vectors, chain, palette.GREEN)
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
        """Artists that `update` moves, from back to front."""
        arrows = (each for each in (self.arrows, self.projections) if each is not None)
        return [self.springs, self.rotors, self.pivots, *arrows, self.masses]

    def update(self, angles: Array, mode: Array | None = None, tilt: float = 0.0) -> None:
        """Move the artists to angles [rad] and a mode [1], each of shape (N,).

        If `mode` is None, the mode arrows are hidden. A positive tilt [rad] rotates the chain
        about its middle, so that its last rotor is lower.
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
    """Set the same axis limits for all pictures; return their width and height [m].

    The limits include all visible mode arrows.
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
    """Add a legend of the symbols in one row below the panels."""
    right, left = (f'u leans {side}' for side in ('right', 'left'))
    styles: list[tuple[str, str, str, Literal['', '-', '--']]] = [
        ('pivot', palette.BLACK, 'x', ''),
        ('rotor', palette.BLACK, '', '-'),
        ('mass', palette.BLUE, 'o', ''),
        ('spring', palette.RED, '', '--'),
        ('velocity in the zero mode', palette.GREEN, r'$\rightarrow$', ''),
        (right, palette.LEANS_RIGHT, r'$\rightarrow$', ''),
        (left, palette.LEANS_LEFT, r'$\leftarrow$', ''),
    ]
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle=line, label=name, markersize=8)
        for name, colour, marker, line in styles
    ]
    figure.legend(handles=handles, loc=LEGEND_BELOW, ncols=len(handles), fontsize=8, frameon=False)


def projection_quiver(axes: Axes, chain: Chain, angles: Array, lowered: float = 0.0) -> Quiver:
    """Draw the displacements u_n = r sin(phi_n) [m] as arrows below the pivots; return the arrows.

    If r > a, the arrows of neighbouring rotors are in different rows, so that they do not overlap.
    """
    along = displacement(chain, angles)
    positions = np.column_stack([chain.pivots, _rows(chain) - lowered])
    vectors = np.column_stack([along, np.zeros_like(along)])
    arrows = _quiver(axes, positions, vectors, chain, None)
    arrows.set_cmap(palette.LEAN_COLOURS)
    arrows.set_norm(lean_norm(chain))
    arrows.set_array(along)
    return arrows


def move_projections(arrows: Quiver, chain: Chain, angles: Array) -> None:
    """Move the arrows of `projection_quiver` to angles [rad], shape (N,)."""
    along = displacement(chain, angles)
    arrows.set_UVC(along, np.zeros_like(along), along)


def draw_torus(axes: Axes, chain: Chain, curves: Sequence[Array]) -> None:
    """Draw the configuration space of a unit cell as curves on a torus (paper, Fig. 4c).

    Each curve contains the staggered angles theta (`staggered`) of an even and an odd rotor [rad],
    shape (K, 2). Opposite sides of the square plot are the same line on the torus. Triangles mark
    the four uniform states.
    """
    for number, curve in enumerate(curves):
        colour = palette.CURVE_COLOURS[number % len(palette.CURVE_COLOURS)]
        axes.plot(*split_at_wraps(curve).T, color=colour, linewidth=2.5, zorder=2)
    rest = chain.rest_angle
    for states, marker, colour, label in (
        ((rest, math.pi - rest), '>', palette.LEANS_RIGHT, 'leans right'),
        ((-rest, rest - math.pi), '<', palette.LEANS_LEFT, 'leans left'),
    ):
        look: Any = {'color': colour, 'markersize': 13, 'markeredgecolor': palette.WHITE}
        axes.plot(states, states, marker, label=label, zorder=4, **look)
    ends, names = (-math.pi, math.pi), ['−π', '−π/2', '0', 'π/2', 'π']
    axes.set(xlim=ends, ylim=ends, aspect='equal', xlabel='θ₁ [rad]', ylabel='θ₂ [rad]')
    for set_ticks in (axes.set_xticks, axes.set_yticks):
        set_ticks(np.linspace(*ends, 5), names)


def split_at_wraps(curve: Array) -> Array:
    """Wrap a curve, shape (K, 2), to +-pi [rad]; insert a row of NaN at each wrap."""
    wrapped = np.asarray(np.mod(curve + np.pi, 2 * np.pi) - np.pi)
    jumps = np.flatnonzero((np.abs(np.diff(wrapped, axis=0)) > np.pi).any(axis=1)) + 1
    return np.insert(wrapped, jumps, np.nan, axis=0)


def towards_camera(azimuth: float, elevation: float) -> Array:
    """Return the unit vector to a camera, given its azimuth and elevation [rad], shape (3,)."""
    flat = math.cos(elevation)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])


def _bars(axes: Axes, chain: Chain, rigid: bool) -> tuple[LineCollection, LineCollection]:
    thickness, dashes = _thickness(chain), 'solid' if rigid else [(0, (2.5, 1.2))]
    springs = LineCollection(
        [], colors=palette.RED, linestyles=dashes, linewidths=0.75 * thickness
    )
    colours = (
        [palette.BLACK, palette.GREY] if chain.rotor_length > chain.spacing else palette.BLACK
    )
    border = [withStroke(linewidth=thickness + 1.6, foreground=palette.WHITE)]
    rotors = LineCollection([], colors=colours, linewidths=thickness, path_effects=border)
    rotors.set_capstyle('round')
    for order, bars in enumerate((springs, rotors), start=2):
        bars.set_zorder(order)
        axes.add_collection(bars, autolim=False)
    return springs, rotors


def _points(axes: Axes, chain: Chain) -> tuple[Line2D, Line2D]:
    size: Any = {'markersize': 3 * _thickness(chain)}
    width = 0.6 * _thickness(chain)
    (pivots,) = axes.plot(
        [], [], 'x', color=palette.BLACK, markeredgewidth=width, zorder=4, **size
    )
    (masses,) = axes.plot(
        [], [], 'o', color=palette.BLUE, markeredgecolor=palette.WHITE, zorder=6, **size
    )
    return pivots, masses


def _quiver(
    axes: Axes, positions: Array, vectors: Array, chain: Chain, colour: str | None
) -> Quiver:
    units: Any = {'angles': 'xy', 'scale_units': 'xy', 'scale': 1, 'units': 'inches'}
    head: Any = {'headwidth': 3.5, 'headlength': 4, 'headaxislength': 3.6}
    look: Any = {'color': colour, 'clip_on': False, 'in_layout': False, 'zorder': 5}
    width = 0.9 * _thickness(chain) / 72
    return axes.quiver(*positions.T, *vectors.T, width=width, **units, **head, **look)


def _stretched(chain: Chain, angles: Array, mode: Array, arrow_length: float | None) -> Array:
    longest = arrow_length or 1.2 * max(chain.rotor_length, chain.spacing)
    return longest / chain.rotor_length * mode_arrows(chain, angles, mode)


def _thickness(chain: Chain) -> float:
    return min(max(50 / chain.number_of_rotors, 0.8), 5.0)


def _rows(chain: Chain) -> Array:
    rows = math.ceil(chain.rotor_length / chain.spacing)
    row = np.arange(chain.number_of_rotors) % rows
    reach = float(chain.rotor_lengths.max()) + _MARGIN * chain.spacing
    return np.asarray(-reach - 0.3 * chain.spacing * (row + 0.5))


def _turned(tilt: float) -> Array:
    """Return T so that `points @ T` are tilted; a positive tilt [rad] lowers points with x > 0."""
    sine, cosine = math.sin(tilt), math.cos(tilt)
    return np.array([[cosine, -sine], [sine, cosine]])


def _between(positions: Array, values: Array, wanted: ArrayLike) -> Array:
    at = np.asarray(np.ma.filled(wanted, np.nan), dtype=np.float64)
    slopes = np.diff(values)[[0, -1]] / np.diff(positions)[[0, -1]]
    below, above = np.minimum(at - positions[0], 0), np.maximum(at - positions[-1], 0)
    return np.asarray(np.interp(at, positions, values) + below * slopes[0] + above * slopes[1])
