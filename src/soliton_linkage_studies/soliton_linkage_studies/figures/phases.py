# SPDX-License-Identifier: Apache-2.0
"""Phases of motion and configuration spaces of the unit cell (paper, Fig. 4)."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from soliton_linkage.linear.bands import couplings
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage_studies import drawing, palette, unit_cell
from soliton_linkage_studies.figure_report import FigureReport, chain_formula, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.settings import Section

_FINE = 40_000
"""Number of steps along a curve in the configuration space of a unit cell [1]. The slope of the
curve at the right-leaning state is compared with theory. With this number of steps, the slope has
an error of 1e-7."""
_SHAPE = 1.9
"""Width of a panel of the unit cells, divided by its height [1]."""
_REGIONS = {
    Motion.FLIPPER: (0.22, 0.85),
    Motion.WOBBLING_FLIPPER: (1.75, 0.55),
    Motion.SPINNER: (4.5, 1.1),
}
"""Position of the label of each phase: r/a [1] and rest angle [rad]."""
_RADIUS = 2.2
"""Major radius of the drawn torus, relative to its minor radius [1]."""
_ELEVATION, _AZIMUTH = math.radians(50), math.radians(-60)
"""Elevation and azimuth of the viewer of the torus [rad]."""
_CAPTION = """
The phases of motion and the configuration spaces of the unit cell (paper, Fig. 4).

(a) Phase diagram of the wall motion against the rotor length r/a and the rest angle θ̄. Flippers
(pale blue) have d = 2 r sin θ̄ / a < 1 (solid line). Spinners (pale green) have d > d_c = 2 / sin
θ̄ (dashed line). Wobbling flippers (pale orange) are between these lines. Dots mark the unit cells
of (b), (c) and (d), one column for each. (b) The four uniform states of a unit cell: two rotors
(black; the second is grey if they overlap), their pivots (crosses) and a rigid bar (red). Masses
are purple in right-leaning cells and orange in left-leaning cells. The lower row shows the states
of the upper row upside down.

(c) Configuration space of the unit cell over its staggered angles θ₁ and θ₂. Both angles are
periodic, so opposite sides of the square are identical. The first component is blue, the second
is pink. Triangles mark the four states of (b). (d) The same curves on a torus in space (grey): θ₁
runs around its axis and θ₂ around its tube. Hidden parts are dotted and pale. The single component
of a flipper bounds a disc; the two components of a spinner are linked.
"""


@FIGURES.add('figure_4')
def figure_4(section: Section, quick: bool) -> FigureReport:
    """Draw the phase diagram, and states, curves and torus of one unit cell per phase."""
    section.check_keys('chains', 'points')
    chains = list(section.chains().values())
    points = section.whole_number('points', 100, 100_000)
    report = new_report(_CAPTION, 11, 14)
    grid = report.figure.add_gridspec(4, 1, height_ratios=[1.0, 0.55, 0.95, 0.8])
    rows = [report.figure.add_subfigure(grid[row]) for row in range(4)]
    _draw_diagram(report, rows[0].subplots(), chains, 200)
    for number, chain in enumerate(chains, start=1):
        curves = unit_cell.configuration_curves(chain, points // 10 if quick else points)
        cells, torus = (row.add_subplot(1, len(chains), number) for row in rows[1:3])
        solid = rows[3].add_subplot(1, len(chains), number, projection='3d')
        letters = 'bcd' if number == 1 else ('', '', '')
        _draw_cells(cells, chain, letters[0])
        _draw_curves(report, torus, chain, curves, letters[1])
        _draw_solid_torus(solid, curves, letters[2])
        _compare(report, chain, unit_cell.configuration_curves(chain, 1000 if quick else _FINE))
    _compare_limits(report, chains[0])
    return report


def _draw_diagram(report: FigureReport, axes: Axes, chains: list[Chain], points: int) -> None:
    low, high = 0.1, 10.0
    rest_angles = np.linspace(0.02, math.pi / 2 - 0.02, points)
    limits = unit_cell.flipper_limit(rest_angles), unit_cell.spinner_limit(rest_angles)
    borders = np.clip([np.zeros(points), *limits, np.full(points, np.inf)], low, high)
    for (motion, position), (left, right) in zip(_REGIONS.items(), pairwise(borders), strict=True):
        colour = palette.tint(palette.MOTION_COLOURS[motion], 0.2)
        axes.fill_betweenx(rest_angles, left, right, color=colour, linewidth=0)
        axes.text(*position, f'{motion.value}s', ha='center', va='center', fontsize=13)
    names, labels = ('r/a [1]', 'theta_bar [rad]'), ('$d = 1$', r'$d = d_c = 2 / \sin\bar\theta$')
    for series, ratios, style, label in zip(
        ('d = 1', 'd = d_c'), limits, ('-', '--'), labels, strict=True
    ):
        look = {'color': palette.BLACK, 'label': label}
        report.plot(axes, ('a', series), names, ratios, rest_angles, style, **look)
    for chain in chains:
        position = chain.rotor_length / chain.spacing, chain.rest_angle
        axes.plot(*position, 'o', color=palette.BLACK)
    axes.plot([], [], 'o', color=palette.BLACK, label='cells of b, c and d')
    axes.set(xscale='log', xlim=(low, high), ylim=(0.02, math.pi / 2 - 0.02))
    axes.set(xlabel='length of the rotors r / a [1]', ylabel='rest angle θ̄ [rad]')
    axes.set_title('a  phases of motion', loc='left')
    axes.legend(loc='lower left')


def _draw_cells(axes: Axes, chain: Chain, letter: str) -> None:
    cell = Chain(2, chain.spacing, chain.rotor_length, chain.rest_angle)
    across = 2 * chain.rotor_length + 2 * chain.spacing
    down = 2.2 * chain.rotor_length * math.cos(chain.rest_angle) + 0.9 * chain.spacing
    for number, state in enumerate(unit_cell.ground_states(cell)):
        picture = drawing.ChainPicture(axes, cell, staggered(state), rigid=True)
        aside = np.array([across * (number % 2), -down * (number // 2)])
        for bars in (picture.springs, picture.rotors):
            bars.set_segments([np.asarray(segment) + aside for segment in bars.get_segments()])
        picture.pivots.set_data(*(drawing.pivot_points(cell) + aside).T)
        picture.masses.set_data(*(drawing.mass_points(cell, staggered(state)) + aside).T)
        picture.masses.set_color(palette.LEANS_LEFT if number % 2 else palette.LEANS_RIGHT)
    high = chain.rotor_length * math.cos(chain.rest_angle) + 0.4 * chain.spacing
    half = max(0.85 * across, _SHAPE * (down / 2 + high))
    middle = (across + chain.spacing) / 2
    axes.set(xlim=(middle - half, middle + half))
    axes.set(ylim=(-down / 2 - half / _SHAPE, -down / 2 + half / _SHAPE))
    ratio = chain.rotor_length / chain.spacing
    title = f'{letter}  {chain.motion.value}, r/a = {ratio:g}, θ̄ = {chain.rest_angle:g}'
    axes.set_title(title.lstrip(), loc='left', fontsize=10)


def _draw_curves(
    report: FigureReport, axes: Axes, chain: Chain, curves: tuple[Array, ...], letter: str
) -> None:
    drawing.draw_torus(axes, chain, curves)
    ratios = f'$d = {chain.lean_ratio:.2f}$, $d_c = {chain.critical_lean_ratio:.2f}$'
    axes.set_title(f'{letter}  configurations, {ratios}'.lstrip(), loc='left', fontsize=10)
    if letter:
        axes.legend(loc='upper left', title='b, c: states', fontsize=9, markerscale=0.8)
    for number, curve in enumerate(curves):
        names = ('theta_1 [rad]', 'theta_2 [rad]')
        series = f'component {number + 1} of {chain.motion.value}'
        report.add_points('c', series, names, curve[:, 0], curve[:, 1])


def _draw_solid_torus(axes: Axes3D, curves: tuple[Array, ...], letter: str) -> None:
    around, across = np.meshgrid(np.linspace(0, 2 * np.pi, 60), np.linspace(0, 2 * np.pi, 30))
    axes.computed_zorder = False
    look = {'color': palette.GREY, 'alpha': 0.12, 'linewidth': 0}
    axes.plot_surface(*on_torus(around, across), rasterized=True, **look)
    for curve, colour in zip(curves, palette.CURVE_COLOURS, strict=False):
        points = np.array(on_torus(curve[:, 0], curve[:, 1]))
        behind = hidden(points)
        for shown, style in (
            (behind, {'linestyle': ':', 'linewidth': 1.5, 'alpha': 0.6, 'zorder': 2}),
            (np.logical_not(behind), {'linestyle': '-', 'linewidth': 2.5, 'zorder': 3}),
        ):
            axes.plot(*np.where(shown, points, np.nan), color=colour, **style)
    title = f'{letter}  {len(curves)} component{"s" if len(curves) > 1 else ""} on the torus'
    axes.set_title(title.lstrip(), loc='left', fontsize=10)
    wide = _RADIUS + 1
    axes.set(xlim=(-wide, wide), ylim=(-wide, wide), zlim=(-1, 1))
    axes.set_box_aspect((wide, wide, 1), zoom=1.3)
    axes.set_proj_type('ortho')
    axes.view_init(elev=math.degrees(_ELEVATION), azim=math.degrees(_AZIMUTH))
    axes.set_axis_off()


def on_torus(around: Array, across: Array) -> tuple[Array, Array, Array]:
    """Return points on a torus of minor radius 1, given their angles about axis and tube [rad]."""
    radius = _RADIUS + np.cos(across)
    return radius * np.cos(around), radius * np.sin(around), np.sin(across)


def hidden(points: Array) -> NDArray[np.bool_]:
    """Return whether points of the torus, shape (3, K), are hidden from the viewer, shape (K,)."""
    eye = drawing.towards_camera(_AZIMUTH, _ELEVATION)
    steps = np.linspace(0.02, 2 * (_RADIUS + 1), 400)
    x, y, z = points[:, :, None] + eye[:, None, None] * steps
    inside = (np.hypot(x, y) - _RADIUS) ** 2 + z**2 < 1
    return np.asarray(inside.any(axis=-1), dtype=np.bool_)


def _compare(report: FigureReport, chain: Chain, curves: tuple[Array, ...]) -> None:
    spinner, name = chain.motion is Motion.SPINNER, chain.motion.value
    count = ('two', 'two beyond d_c', 2.0) if spinner else ('one', 'one below d_c', 1.0)
    quantity = f'components of the configuration space, {name}'
    report.add_comparison(quantity, *count[:2], float(len(curves)), count[2])
    laws = 'bounds a disc', 'none'
    if spinner:
        laws = 'linked rings', 'once about both, in opposite senses'
    for number, curve in enumerate(curves, start=1):
        expected = (1.0, -1.0) if spinner else (0.0, 0.0)
        for angle, turns, wanted in zip('₁₂', unit_cell.windings(curve), expected, strict=True):
            quantity = f'turns of θ{angle} along component {number}, {name}'
            report.add_comparison(quantity, *laws, float(turns), wanted)
    states = float(
        np.count_nonzero(unit_cell.component_of(chain, unit_cell.ground_states(chain)) == 0)
    )
    laws = ('a pair ±θ̄', 'θ̄ and π + θ̄') if spinner else ('all four', 'all four')
    quantity = f'uniform states on the first component, {name}'
    report.add_comparison(quantity, *laws, states, 2.0 if spinner else 4.0)
    nearest = int(np.argmin(np.linalg.norm(curves[0] - chain.rest_angle, axis=1)))
    step = curves[0][nearest + 1] - curves[0][nearest - 1]
    plus, minus = couplings(chain)
    report.add_comparison(
        f'slope dθ₂/dθ₁ at the right-leaning state, {name}',
        'changes sign at d = 1',
        chain_formula('−q₊ / q₋', -plus / minus, chain),
        float(step[1] / step[0]),
    )


def _compare_limits(report: FigureReport, chain: Chain) -> None:
    low, high = 0.1, 100.0
    while high - low > 1e-9 * high:
        ratio = (low + high) / 2
        cell = Chain(2, 1.0, ratio, chain.rest_angle)
        both = unit_cell.component_of(cell, unit_cell.ground_states(cell)).any()
        low, high = (low, ratio) if both else (ratio, high)
    report.add_comparison(
        f'r/a where flippers become spinners, θ̄ = {chain.rest_angle:g}',
        'd_c = 2 / sin θ̄, l̄ = 2r − a',
        chain_formula('1 / sin² θ̄', 1 / math.sin(chain.rest_angle) ** 2, chain),
        low,
    )
