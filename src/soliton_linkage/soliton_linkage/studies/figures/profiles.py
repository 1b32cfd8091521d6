# SPDX-License-Identifier: Apache-2.0
"""Profiles of moving walls against the continuum, and their widths (paper, Figs. 5 and 6)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.linear.bands import penetration_depth, speed_of_sound
from soliton_linkage.linkage.chain import Chain, Motion, staggered
from soliton_linkage.solitons.continuum import wall_theory
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage.studies.captions import shape
from soliton_linkage.studies.drawing import BLACK, BLUE, COLOURS, GREEN, GREY, RED
from soliton_linkage.studies.experiments import (
    PLACE,
    SNAPSHOTS,
    Snapshots,
    arctanh_width,
    moving_wall,
    snapshots,
    static_snapshots,
)
from soliton_linkage.studies.figures.registry import FIGURES
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from

_FAR = 5
"""Rotors at the far edge of a chain, whose angles a wall in the middle does not reach."""
_PROFILES = 4
"""Walls whose profiles are drawn, the slowest ones: more hide each other."""


@dataclass(frozen=True)
class WallAtSpeed:
    """A wall at one speed: ten snapshots of one chain, its speed over that of sound, its width."""

    kick: float
    snapshots: Snapshots
    relative_speed: float
    width: float
    """By the slope of arctanh, over that of a wall at rest in the continuum [1]."""
    fitted_width: float
    """By fits of tanh to each snapshot, over the same [1]."""


Inset = Callable[[Plate, Axes, Chain, WallAtSpeed], None]
"""Takes the chain and its slowest wall."""


@FIGURES.add('figure_5')
def figure_5(section: Section, quick: bool) -> Plate:
    """Profiles of flippers at several speeds, their widths, and a wobbler (paper, Fig. 5)."""
    section.allow('chain', 'kicks', 'wobbler')
    wobbler = chain_from(section.section('wobbler'))

    def draw_inset(plate: Plate, axes: Axes, _chain: Chain, _slowest: WallAtSpeed) -> None:
        _draw_wobbler(plate, axes, wobbler)

    return _profile_figure(section, quick, 'u / ū', (-45, 75), draw_inset)


@FIGURES.add('figure_6')
def figure_6(section: Section, quick: bool) -> Plate:
    """Profiles of spinners at several speeds, their widths, and the angles (paper, Fig. 6)."""
    section.allow('chain', 'kicks')
    return _profile_figure(section, quick, 'cos(θ − θ̄)', (-15, 25), _draw_offset)


def _profile_figure(
    section: Section, quick: bool, field: str, shown: tuple[float, float], draw_inset: Inset
) -> Plate:
    """Profiles with the name of their field in a range of places, an inset, and the widths."""
    chain = chain_from(section.section('chain'))
    walls = _moving_walls(chain, section, quick)
    plate = Plate(Figure(figsize=(12, 6.5), layout='constrained'))
    main, above, below = _panels(plate.figure)
    _draw_profiles(plate, main, chain, walls[:: 1 if quick else 2])
    main.set(ylabel=field, title=_title(chain), xlim=shown)
    draw_inset(plate, above, chain, walls[0])
    _draw_widths(plate, below, chain, walls)
    _compare_walls(plate, chain, walls)
    return plate


def _panels(figure: Figure) -> tuple[Axes, Axes, Axes]:
    """A wide panel, and beside it the two that the paper has as insets."""
    grid = figure.add_gridspec(2, 3)
    main = figure.add_subplot(grid[:, :2])
    main.set(xlabel='n − X(t) [rotors from the wall]')
    return main, figure.add_subplot(grid[0, 2]), figure.add_subplot(grid[1, 2])


def _moving_walls(chain: Chain, section: Section, quick: bool) -> list[WallAtSpeed]:
    kicks = section.numbers('kicks', 1e-6, 100.0)
    return [_moving_wall(chain, kick) for kick in (kicks[::3] if quick else kicks)]


def _moving_wall(chain: Chain, kick: float) -> WallAtSpeed:
    recording, _ = moving_wall(chain, kick)
    seen = snapshots(chain, recording, SNAPSHOTS)
    unit = chain.wall_width / chain.spacing
    width = arctanh_width(seen.places[:, 1:-1], seen.fields[:, 1:-1]) / unit
    fits = [find_solitons(chain, angles)[0].width / chain.wall_width for angles in seen.angles]
    speed = seen.speed * chain.spacing / speed_of_sound(chain)
    return WallAtSpeed(kick, seen, speed, width, float(np.mean(fits)))


def _draw_profiles(plate: Plate, axes: Axes, chain: Chain, walls: list[WallAtSpeed]) -> None:
    """Snapshots of each wall over the boosted profile of the continuum."""
    fine = np.linspace(-80, 80, 1601)
    for colour, wall in zip(COLOURS, walls[:_PROFILES], strict=False):
        label = f'v = {wall.relative_speed:.2f} c'
        seen = wall.snapshots
        axes.plot(
            seen.places.ravel(), seen.fields.ravel(), '.', color=colour, markersize=3, label=label
        )
        series = f'v0 = {wall.kick:g}, v = {wall.relative_speed:.4g} c'
        plate.note('main', series, (PLACE, 'order field [1]'), seen.places, seen.fields)
        if wall.relative_speed < 1:
            width = chain.wall_width / chain.spacing * math.sqrt(1 - wall.relative_speed**2)
            axes.plot(fine, -np.tanh(fine / width), '--', color=BLACK, linewidth=0.8, zorder=3)
    axes.plot([], [], '--', color=BLACK, linewidth=0.8, label='continuum')
    axes.legend(loc='upper right', title='chain, dots', markerscale=4)


def _draw_widths(plate: Plate, axes: Axes, chain: Chain, walls: list[WallAtSpeed]) -> None:
    """Width against speed, beside the contraction of Lorentz, also from the width at rest."""
    at_rest = _width_at_rest(chain)
    speeds = np.array([wall.relative_speed for wall in walls])
    widths = np.array([wall.width for wall in walls])
    fine = np.linspace(0, 1, 200)
    contraction = np.sqrt(1 - fine**2)
    axes.plot(fine, contraction, '-', color=RED, label=r'$\sqrt{1 - v^2/c^2}$')
    label = rf'${at_rest:.3f}\,\sqrt{{1 - v^2/c^2}}$, chain at rest'
    axes.plot(fine, at_rest * contraction, '--', color=BLACK, linewidth=1, label=label)
    axes.plot(0, at_rest, 'o', color=BLUE, markerfacecolor='white', markersize=5, clip_on=False)
    axes.plot(speeds, widths, 'o', color=BLUE, markersize=4, label='chain')
    axes.set(xlabel='v / c', ylabel='$w / w_0$', xlim=(0, 1.02), ylim=(0, 1.1))
    axes.legend(loc='lower left', fontsize=9)
    names = ('v / c [1]', 'w / w0 of the continuum at rest [1]')
    plate.note('width', 'chain, slope of arctanh', names, speeds, widths)
    plate.note('width', 'chain, fit of tanh', names, speeds, [wall.fitted_width for wall in walls])
    plate.note('width', 'chain at rest, slope of arctanh', names, 0.0, at_rest)


def _compare_walls(plate: Plate, chain: Chain, walls: list[WallAtSpeed]) -> None:
    """Speed of each wall by its kick, and its width by two estimators."""
    arc = site_arc(chain) * chain.rotor_length / chain.spacing
    theory = wall_theory(chain)
    for wall in walls:
        kick = wall.kick * chain.spacing / chain.time_unit
        plate.compare(
            f'v / c after a kick of v₀ = {wall.kick:g}',
            'not given',
            'c √(1 − 1 / (1 + v₀² / 2Λ²c²)²), exact Λ',
            wall.relative_speed,
            theory.speed_after_kick(kick, arc) / theory.speed_of_sound,
        )
    for wall in walls:
        if wall.relative_speed < 1:
            contraction = math.sqrt(1 - wall.relative_speed**2)
            name = f'at v = {wall.relative_speed:.3f} c (v₀ = {wall.kick:g})'
            for estimator, width in (
                ("slope of arctanh, the paper's estimator", wall.width),
                ('fit of tanh with a free width', wall.fitted_width),
            ):
                plate.compare(
                    f'w / w₀ {name}, {estimator}',
                    '√(1 − v²/c²)',
                    'the same, near d ≪ 1 and d ≫ 1 only',
                    width,
                    contraction,
                )
    plate.compare(
        'w / w₀ of the wall of the chain at rest, slope of arctanh',
        '1',
        '1 for d ≪ 1 and d ≫ 1',
        _width_at_rest(chain),
        1.0,
    )


def _draw_wobbler(plate: Plate, axes: Axes, chain: Chain) -> None:
    """A wobbling wall at rest, tanh with the width of flippers, and the envelopes."""
    middle = (chain.number_of_rotors - 1) / 2
    places, fields = static_snapshots(chain, middle)
    near = np.abs(places) < 7
    fine = np.linspace(-7, 7, 400)
    axes.plot(places[near], fields[near], '.', color=GREY, markersize=4, label='chain')
    axes.plot(fine, -np.tanh(fine * chain.lean_ratio), '-', color=BLUE, label='tanh')
    beyond = fine < -1
    overshoot = float(fields.max() - 1)
    for lengths, style, colour, label in (
        (penetration_depth(chain) / chain.spacing, '-', RED, 'exact ℓ'),
        (chain.lean_ratio / 2, '--', GREEN, 'paper: r sin θ̄'),
    ):
        envelope = overshoot * np.exp(-(-fine[beyond] - 1) / lengths)
        axes.plot(fine[beyond], 1 + envelope, style, color=colour, linewidth=1.5, label=label)
        axes.plot(-fine[beyond], -1 - envelope, style, color=colour, linewidth=1.5)
    axes.set(xlabel='n − X', ylabel='u / ū', ylim=(-1.5, 1.5))
    axes.set_title(shape(chain))
    axes.legend(fontsize=9, loc='lower left')
    plate.note('wobbler', 'chain', (PLACE, 'u / ub [1]'), places[near], fields[near])


def _draw_offset(plate: Plate, axes: Axes, chain: Chain, wall: WallAtSpeed) -> None:
    """Staggered angles of even and odd rotors in one snapshot, which a constant sets apart."""
    places = wall.snapshots.places[len(wall.snapshots.places) // 2]
    angles = wall.snapshots.angles[len(wall.snapshots.places) // 2]
    theta = staggered(angles)
    even, odd = theta[::2], np.pi - theta[1::2]
    axes.plot(places[::2], even, 'o', color=BLUE, markersize=3, label='φ even')
    axes.plot(places[1::2], odd, 's', color=RED, markersize=3, label='φ odd')
    axes.set(xlabel='n − X', ylabel='φ [rad]')
    axes.legend()
    names = (PLACE, 'phi [rad]')
    plate.note('angles', 'even rotors', names, places[::2], even)
    plate.note('angles', 'odd rotors', names, places[1::2], odd)
    long_side = slice(-_FAR, None) if places[-1] > -places[0] else slice(_FAR)
    offset = float(np.abs(np.median(odd[long_side]) - np.median(even[long_side])))
    plate.compare(
        'angle between neighbours far from the wall [rad]',
        'π − 2θ̄, everywhere',
        'π − 2θ̄ in the ground states',
        offset,
        math.pi - 2 * chain.rest_angle,
    )
    rest = static_wall(chain, (chain.number_of_rotors - 1) / 2)
    apart = np.abs(np.diff(rest))
    plate.compare(
        'largest departure from it in a wall at rest [rad]',
        '0',
        'about 1.4 a / r',
        float(np.abs(apart - (math.pi - 2 * chain.rest_angle)).max()),
        1.4 * chain.spacing / chain.rotor_length,
    )


def _width_at_rest(chain: Chain) -> float:
    """Width of a wall of the chain at rest over that of the continuum, by arctanh [1]."""
    found = arctanh_width(*static_snapshots(chain, (chain.number_of_rotors - 1) / 2))
    return found * chain.spacing / chain.wall_width


def _title(chain: Chain) -> str:
    kind = 'spinners' if chain.motion is Motion.SPINNER else 'flippers'
    return f'{kind}, {chain.number_of_rotors} rotors, {shape(chain)}'
