# SPDX-License-Identifier: Apache-2.0
"""Profiles and widths of moving walls (paper, Figs. 5 and 6)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from soliton_linkage.linear.bands import penetration_depth, speed_of_sound
from soliton_linkage.linkage.chain import Chain, Motion, staggered
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage_studies import experiments
from soliton_linkage_studies.drawing import shape
from soliton_linkage_studies.figure_report import FigureReport, Formula, chain_formula, new_report
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.palette import (
    BLACK,
    GREY,
    MEASURED,
    PAPER,
    THEORY,
    WHITE,
    scale_colours,
)
from soliton_linkage_studies.settings import Section

_CAPTION = """
Profiles of {kind} in a chain of springs, N = {rotors}, {shape} (paper, Fig. {number}).

(a) Order field {field} of the rotors against their distance from the wall. Each of the {profiles}
relative speeds v / c has its own colour and {count} snapshots from the middle of the chain; c is
the speed of sound. Dashed lines: continuum theory −tanh(x γ / w₀), γ = 1 / √(1 − v²/c²), with w₀
the width at rest.

(b) {inset}

(c) Wall width, relative to the continuum width at rest, against relative speed. Dots: walls of the
chain, with the width from the slope of arctanh of the order field. Hollow dot: wall at rest. Red
line: Lorentz contraction √(1 − v²/c²) of the paper. Dashed line: the same contraction of the
measured width at rest.
"""
_WOBBLER_INSET = """
A wall at rest in a chain of wobbling flippers, {shape}, at ten positions per rotor spacing (blue
dots). Solid grey line: tanh profile of flippers with the same d. The other lines are envelopes of
the oscillation next to the wall. Red: decay length r sin θ̄ of the paper. Dashed black: exact
penetration depth ℓ of the zero mode. For this chain both agree to a few per cent.
"""
_ANGLE_INSET = """
Angles φ of the rotors in one snapshot of the slowest wall. Far from the wall, even rotors (filled
blue) and odd rotors (hollow blue) differ by the constant π − 2 θ̄.
"""
_FAR = 5
"""Number of even rotors, and of odd ones, from which the angle between neighbours far from the
wall is measured [1]. They are at the edge that is farther from the wall."""
_PROFILES = 4
"""Largest number of drawn profiles [1]. The slowest walls are drawn; more profiles would
overlap."""


@dataclass(frozen=True)
class WallAtSpeed:
    """Snapshots of one wall, with its speed and its width."""

    kick: float
    snapshots: experiments.Snapshots
    relative_speed: float
    """Wall speed [speed of sound]."""
    width: float
    """Width from `arctanh_width`, divided by the continuum width at rest [1]."""
    fitted_width: float
    """Mean width from tanh fits to the snapshots, divided by the continuum width at rest [1]."""


Inset = Callable[[FigureReport, Axes, Chain, WallAtSpeed], None]
"""Function that draws panel b of Fig. 5 or 6, given the report, axes, chain and slowest wall."""


@FIGURES.add('figure_5')
def figure_5(section: Section, quick: bool) -> FigureReport:
    """Draw profiles and widths of flippers at several speeds, and of a wobbler (paper, Fig. 5)."""
    section.check_keys('chain', 'kicks', 'wobbler')
    wobbler = section.chain('wobbler')

    def inset(report: FigureReport, axes: Axes, _chain: Chain, _slowest: WallAtSpeed) -> None:
        _draw_wobbler(report, axes, wobbler)

    caption = _WOBBLER_INSET.format(shape=shape(wobbler))
    return _profile_figure(section, quick, 'u / ū', (-45, 75), caption, inset)


@FIGURES.add('figure_6')
def figure_6(section: Section, quick: bool) -> FigureReport:
    """Draw profiles, widths and angles of spinners at several speeds (paper, Fig. 6)."""
    section.check_keys('chain', 'kicks')
    field, shown = 'cos(θ − θ̄)', (-15, 25)
    return _profile_figure(section, quick, field, shown, _ANGLE_INSET, _draw_offset)


def _profile_figure(
    section: Section,
    quick: bool,
    field: str,
    shown: tuple[float, float],
    inset_caption: str,
    inset: Inset,
) -> FigureReport:
    chain = section.chain()
    kicks = section.numbers('kicks', 1e-6, 100.0)
    walls = [_moving_wall(chain, kick) for kick in (kicks[::3] if quick else kicks)]
    kind = 'spinners' if chain.motion is Motion.SPINNER else 'flippers'
    profiles = walls[:: 1 if quick else 2][:_PROFILES]
    caption = _CAPTION.format(
        kind=kind,
        rotors=chain.number_of_rotors,
        shape=shape(chain),
        number=section.name[-1],
        field=field,
        count=experiments.SNAPSHOTS,
        profiles=len(profiles),
        inset=inset_caption.strip(),
    )
    report = new_report(caption, 12, 6.5)
    grid = report.figure.add_gridspec(2, 3)
    places = (grid[:, :2], grid[0, 2], grid[1, 2])
    main, above, below = (report.figure.add_subplot(place) for place in places)
    _draw_profiles(report, main, chain, profiles)
    main.set(xlabel='distance from the wall n − X(t) [rotor spacings]')
    main.set(ylabel=f'{field} [1]', xlim=shown)
    main.set_title(f'a  {kind}, {chain.number_of_rotors} rotors, {shape(chain)}', loc='left')
    inset(report, above, chain, walls[0])
    _draw_widths(report, below, chain, walls)
    _compare_walls(report, chain, walls)
    return report


def _moving_wall(chain: Chain, kick: float) -> WallAtSpeed:
    recording, _ = experiments.record_moving_wall(chain, kick)
    seen = experiments.snapshots(chain, recording, experiments.SNAPSHOTS)
    unit = chain.wall_width / chain.spacing
    width = experiments.arctanh_width(seen.distances[:, 1:-1], seen.fields[:, 1:-1]) / unit
    fits = [find_solitons(chain, angles)[0].width / chain.wall_width for angles in seen.angles]
    speed = seen.speed * chain.spacing / speed_of_sound(chain)
    return WallAtSpeed(kick, seen, speed, width, float(np.mean(fits)))


def _draw_profiles(
    report: FigureReport, axes: Axes, chain: Chain, walls: list[WallAtSpeed]
) -> None:
    fine = np.linspace(-80, 80, 1601)
    names = (experiments.DISTANCE_LABEL, 'order field [1]')
    for colour, wall in zip(scale_colours(len(walls)), walls, strict=True):
        look: Any = {'color': colour, 'label': f'v = {wall.relative_speed:.2f} c', 'markersize': 3}
        points = wall.snapshots.distances.ravel(), wall.snapshots.fields.ravel()
        series = f'v0 = {wall.kick:g}, v = {wall.relative_speed:.4g} c'
        report.plot(axes, ('main', series), names, *points, '.', **look)
        if wall.relative_speed < 1:
            width = chain.wall_width / chain.spacing * math.sqrt(1 - wall.relative_speed**2)
            axes.plot(fine, -np.tanh(fine / width), '--', color=BLACK, linewidth=0.8, zorder=3)
    axes.plot([], [], '--', color=BLACK, linewidth=0.8, label='continuum, theory')
    axes.legend(loc='upper right', title='chain of springs, dots', markerscale=4)


def _draw_widths(report: FigureReport, axes: Axes, chain: Chain, walls: list[WallAtSpeed]) -> None:
    at_rest = _width_at_rest(chain)
    speeds = np.array([wall.relative_speed for wall in walls])
    widths = np.array([wall.width for wall in walls])
    fine = np.linspace(0, 1, 200)
    contraction = np.sqrt(1 - fine**2)
    axes.plot(fine, contraction, '-', color=PAPER, label=r'$\sqrt{1 - v^2/c^2}$ (paper)')
    label = rf'${at_rest:.3f}\,\sqrt{{1 - v^2/c^2}}$, from the chain at rest'
    axes.plot(fine, at_rest * contraction, '--', color=THEORY, linewidth=1, label=label)
    names = ('v / c [1]', 'w / w0 of the continuum at rest [1]')
    hollow: Any = {'color': MEASURED, 'markerfacecolor': WHITE, 'markersize': 5, 'clip_on': False}
    axes.plot(0, at_rest, 'o', label='chain at rest', **hollow)
    look = {'color': MEASURED, 'markersize': 4, 'label': 'chain'}
    report.plot(axes, ('width', 'chain, slope of arctanh'), names, speeds, widths, 'o', **look)
    axes.set(xlabel='v / c [1]', ylabel='$w / w_0$ [1]', xlim=(0, 1.02), ylim=(0, 1.1))
    axes.set_title('c  width against speed', loc='left')
    axes.legend(loc='lower left', fontsize=9)
    fitted = [wall.fitted_width for wall in walls]
    report.add_points('width', 'chain, fit of tanh', names, speeds, fitted)
    report.add_points('width', 'chain at rest, slope of arctanh', names, 0.0, at_rest)


def _compare_walls(report: FigureReport, chain: Chain, walls: list[WallAtSpeed]) -> None:
    sound = speed_of_sound(chain) * chain.time_unit / chain.spacing
    way = site_arc(chain) * chain.rotor_length / chain.spacing
    text = '√(1 − 1 / (1 + (v₀ a / (Λ r c))² / 2)²)'
    for wall in walls:
        speed = math.sqrt(1 - 1 / (1 + (wall.kick / (way * sound)) ** 2 / 2) ** 2)
        symbols = {'v₀': wall.kick, 'Λ': site_arc(chain), 'c': sound}
        report.add_comparison(
            f'v / c after a kick of v₀ = {wall.kick:g}',
            'not given',
            chain_formula(text, speed, chain, 'exact Λ', **symbols),
            wall.relative_speed,
        )
    for wall in walls:
        if wall.relative_speed < 1:
            symbols, remark = {'v/c': wall.relative_speed}, 'near d ≪ 1 and d ≫ 1 only'
            width = math.sqrt(1 - wall.relative_speed**2)
            law = Formula('√(1 − (v/c)²)', width, symbols, remark)
            name = f'at v = {wall.relative_speed:.3f} c (v₀ = {wall.kick:g})'
            for estimator, width in (
                ("slope of arctanh, the paper's estimator", wall.width),
                ('fit of tanh with a free width', wall.fitted_width),
            ):
                report.add_comparison(f'w / w₀ {name}, {estimator}', '√(1 − v²/c²)', law, width)
    quantity = 'w / w₀ of the wall of the chain at rest, slope of arctanh'
    report.add_comparison(quantity, '1', '1 for d ≪ 1 and d ≫ 1', _width_at_rest(chain), 1.0)


def _draw_wobbler(report: FigureReport, axes: Axes, chain: Chain) -> None:
    middle = (chain.number_of_rotors - 1) / 2
    positions, fields = experiments.static_profile(chain, middle)
    near = np.abs(positions) < 7
    fine = np.linspace(-7, 7, 400)
    names, look = (experiments.DISTANCE_LABEL, 'u / ub [1]'), {'color': MEASURED, 'label': 'chain'}
    where = ('wobbler', 'chain')
    report.plot(axes, where, names, positions[near], fields[near], '.', markersize=4, **look)
    axes.plot(fine, -np.tanh(fine * chain.lean_ratio), '-', color=GREY, label='tanh')
    beyond = fine < -1
    overshoot = float(fields.max() - 1)
    for lengths, style, colour, label in (
        (chain.lean_ratio / 2, '-', PAPER, 'envelope: r sin θ̄ (paper)'),
        (penetration_depth(chain) / chain.spacing, '--', THEORY, 'envelope: exact ℓ'),
    ):
        envelope = overshoot * np.exp(-(-fine[beyond] - 1) / lengths)
        axes.plot(fine[beyond], 1 + envelope, style, color=colour, linewidth=1.5, label=label)
        axes.plot(-fine[beyond], -1 - envelope, style, color=colour, linewidth=1.5)
    axes.set(xlabel='n − X [rotor spacings]', ylabel='u / ū [1]', ylim=(-1.9, 1.5))
    axes.set_title(f'b  wobbler at rest, {shape(chain)}', loc='left', fontsize=10)
    axes.legend(fontsize=8, loc='lower left')


def _draw_offset(report: FigureReport, axes: Axes, chain: Chain, wall: WallAtSpeed) -> None:
    middle = len(wall.snapshots.distances) // 2
    positions, theta = wall.snapshots.distances[middle], staggered(wall.snapshots.angles[middle])
    even, odd = theta[::2], np.pi - theta[1::2]
    for rotors, x, y, face in (
        ('even rotors', positions[::2], even, MEASURED),
        ('odd rotors', positions[1::2], odd, WHITE),
    ):
        look = {'color': MEASURED, 'markerfacecolor': face, 'label': f'φ, {rotors}'}
        where, names = ('angles', rotors), (experiments.DISTANCE_LABEL, 'phi [rad]')
        report.plot(axes, where, names, x, y, 'o', markersize=4, **look)
    axes.set(xlabel='n − X [rotor spacings]', ylabel='actual angle φ [rad]')
    axes.set_title('b  angles of the rotors in one snapshot', loc='left', fontsize=10)
    axes.legend()
    long_side = slice(-_FAR, None) if positions[-1] > -positions[0] else slice(_FAR)
    offset = float(np.abs(np.median(odd[long_side]) - np.median(even[long_side])))
    report.add_comparison(
        'angle between neighbours far from the wall [rad]',
        'π − 2θ̄, everywhere',
        chain_formula('π − 2 θ̄', math.pi - 2 * chain.rest_angle, chain, 'in the ground states'),
        offset,
    )
    rest = static_wall(chain, (chain.number_of_rotors - 1) / 2)
    apart = np.abs(np.diff(rest))
    report.add_comparison(
        'largest deviation from this angle in a wall at rest [rad]',
        '0',
        chain_formula('1.4 a / r', 1.4 * chain.spacing / chain.rotor_length, chain, 'about'),
        float(np.abs(apart - (math.pi - 2 * chain.rest_angle)).max()),
    )


def _width_at_rest(chain: Chain) -> float:
    found = experiments.arctanh_width(
        *experiments.static_profile(chain, (chain.number_of_rotors - 1) / 2)
    )
    return found * chain.spacing / chain.wall_width
