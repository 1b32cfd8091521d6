# SPDX-License-Identifier: Apache-2.0
"""Profiles of moving walls against the continuum, and the oscillations of wobbling ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.bands import penetration_depth, speed_of_sound
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.solitons.continuum import wall_theory
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons, order_field
from soliton_linkage.studies.drawing import BLACK, BLUE, GREEN, GREY, PURPLE, RED
from soliton_linkage.studies.experiments import (
    Snapshots,
    arctanh_width,
    moving_wall,
    snapshots,
    zero_crossing,
)
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from

_SNAPSHOTS = 10
_MARKERS = 'os^'
_COLOURS = (BLUE, RED, GREEN, PURPLE)
_PLACE = 'n - X [rotor spacings]'
_FAR = 5
_BEYOND = 'rotors from the wall [rotor spacings]'
_BESIDE = 10
_NEAR = 1.5


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


def figure_5(section: Section, quick: bool) -> Plate:
    """Profiles of flippers at several speeds, their widths, and a wobbler (paper, Fig. 5)."""
    section.allow('chain', 'kicks', 'wobbler')
    chain = chain_from(section.section('chain'))
    walls = _moving_walls(chain, section, quick)
    plate = Plate(Figure(figsize=(12, 6.5), layout='constrained'))
    main, above, below = _panels(plate.figure)
    _draw_profiles(plate, main, chain, walls[:: 1 if quick else 2])
    main.set(ylabel='u / ū', title=_title(chain), xlim=(-45, 75))
    _draw_wobbler(plate, above, chain_from(section.section('wobbler')))
    _draw_widths(plate, below, chain, walls)
    _compare_walls(plate, chain, walls)
    return plate


def figure_6(section: Section, quick: bool) -> Plate:
    """Profiles of spinners at several speeds, their widths, and the angles (paper, Fig. 6)."""
    section.allow('chain', 'kicks')
    chain = chain_from(section.section('chain'))
    walls = _moving_walls(chain, section, quick)
    plate = Plate(Figure(figsize=(12, 6.5), layout='constrained'))
    main, above, below = _panels(plate.figure)
    _draw_profiles(plate, main, chain, walls[:: 1 if quick else 2])
    main.set(ylabel='cos(θ − θ̄)', title=_title(chain), xlim=(-15, 25))
    _draw_offset(plate, above, chain, walls[0])
    _draw_widths(plate, below, chain, walls)
    _compare_walls(plate, chain, walls)
    return plate


def figure_s1(section: Section, quick: bool) -> Plate:
    """Profiles of wobbling flippers, from snapshots of a slow motion (paper, Fig. S1)."""
    section.allow('chains')
    chains = [chain_from(each) for each in section.section('chains').sections().values()]
    plate = Plate(Figure(figsize=(9, 5.5), layout='constrained'))
    axes = plate.figure.subplots()
    for chain, colour, marker in zip(chains, (BLUE, RED, GREEN), _MARKERS, strict=False):
        seen = _slow_snapshots(chain, 4 if quick else _SNAPSHOTS)
        near = np.abs(seen.places) < 9
        name = _short_name(chain)
        axes.plot(
            seen.places[near], seen.fields[near], marker, color=colour, markersize=4, label=name
        )
        plate.note('', name, (_PLACE, 'u / ub [1]'), seen.places[near], seen.fields[near])
        _compare_overshoot(plate, chain)
    axes.axhline(1, color=GREY, linewidth=0.8)
    axes.axhline(-1, color=GREY, linewidth=0.8)
    axes.set(
        xlabel='n − X [rotors from the wall]',
        ylabel='u / ū',
        title='wobbling flippers overshoot: ten snapshots each',
    )
    axes.legend()
    return plate


def figure_s2(section: Section, quick: bool) -> Plate:
    """Oscillations beside wobbling walls, over the decay of theory (paper, Fig. S2)."""
    section.allow('chains')
    chains = [chain_from(each) for each in section.section('chains').sections().values()]
    plate = Plate(Figure(figsize=(12, 3 * len(chains)), layout='constrained'))
    panels = plate.figure.subplots(len(chains), 2, sharex=True, squeeze=False)
    for (linear, logarithmic), chain, colour in zip(
        panels, chains, (BLUE, RED, GREEN), strict=False
    ):
        seen = _slow_snapshots(chain, 4 if quick else _SNAPSHOTS)
        beyond = (seen.places < 0) & (seen.places > -_BESIDE)
        places = -seen.places[beyond]
        lean = chain.lean_ratio / 2
        from_tanh = lean * (seen.fields[beyond] - np.tanh(places * 2 * lean))
        from_rest = lean * (seen.fields[beyond] - 1)
        linear.plot(places, from_tanh, 'o', color=colour, markersize=4, label='chain')
        logarithmic.plot(places, np.abs(from_rest), 'o', color=colour, markersize=4, label='chain')
        _draw_decays(plate, linear, logarithmic, chain, places, from_rest)
        name = _short_name(chain)
        plate.note(name, 'chain', (_BEYOND, '(u - u_tanh) / a [1]'), places, from_tanh)
        plate.note(name, 'chain', (_BEYOND, '(u - ub) / a [1]'), places, from_rest)
        linear.set(ylabel=r'$(u - u_{\tanh}) / a$', title=name)
        logarithmic.set(ylabel=r'$|u - \bar u| / a$', yscale='log', ylim=(1e-9, 3))
        logarithmic.legend()
        _compare_tail(plate, chain)
    for axes in panels[-1]:
        axes.set(xlabel='rotors from the wall')
    panels[0, 0].legend()
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
    seen = snapshots(chain, recording, _SNAPSHOTS)
    unit = chain.wall_width / chain.spacing
    width = arctanh_width(seen.places[:, 1:-1], seen.fields[:, 1:-1]) / unit
    fits = [find_solitons(chain, angles)[0].width / chain.wall_width for angles in seen.angles]
    speed = seen.speed * chain.spacing / speed_of_sound(chain)
    return WallAtSpeed(kick, seen, speed, width, float(np.mean(fits)))


def _draw_profiles(plate: Plate, axes: Axes, chain: Chain, walls: list[WallAtSpeed]) -> None:
    """Snapshots of each wall over the boosted profile of the continuum."""
    fine = np.linspace(-80, 80, 1601)
    for colour, wall in zip(_COLOURS, walls, strict=False):
        label = f'v = {wall.relative_speed:.2f} c'
        seen = wall.snapshots
        axes.plot(
            seen.places.ravel(), seen.fields.ravel(), '.', color=colour, markersize=3, label=label
        )
        series = f'v0 = {wall.kick:g}, v = {wall.relative_speed:.4g} c'
        plate.note('main', series, (_PLACE, 'order field [1]'), seen.places, seen.fields)
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
    places, fields = _static_snapshots(chain, middle)
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
    axes.set_title(_short_name(chain))
    axes.legend(fontsize=9, loc='lower left')
    plate.note('wobbler', 'chain', (_PLACE, 'u / ub [1]'), places[near], fields[near])


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
    names = (_PLACE, 'phi [rad]')
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


def _slow_snapshots(chain: Chain, count: int) -> Snapshots:
    """Frames of the rigid chain with its wall in the middle of the chain."""
    start = static_wall(chain, chain.number_of_rotors // 2 - 0.5)
    period = site_arc(chain) / count
    simulation = RigidSimulation(chain, start, mode_towards_last(chain, start), period)
    return snapshots(chain, simulation.record(1.5 * count * period), count)


def _static_snapshots(chain: Chain, middle: float) -> tuple[Array, Array]:
    """Rotors from the wall and order field of walls at rest at ten places a spacing, (K,) each.

    Without edge rotors, which rest at one of two angles.
    """
    places, fields = [], []
    for beyond in np.arange(_SNAPSHOTS) / _SNAPSHOTS:
        angles = static_wall(chain, middle + beyond)
        field, _ = order_field(chain, angles)
        rotors = np.arange(chain.number_of_rotors)
        places.append((rotors - zero_crossing(field))[1:-1])
        fields.append(field[1:-1])
    return np.ravel(places), np.ravel(fields)


def _width_at_rest(chain: Chain) -> float:
    """Width of a wall of the chain at rest over that of the continuum, by arctanh [1]."""
    found = arctanh_width(*_static_snapshots(chain, (chain.number_of_rotors - 1) / 2))
    return found * chain.spacing / chain.wall_width


def _draw_decays(
    plate: Plate, linear: Axes, logarithmic: Axes, chain: Chain, places: Array, from_rest: Array
) -> None:
    """U = ub + e^(-x / depth) (A cos(pi x / a) + B sin(pi x / a)) with two depths.

    A and B are fitted beyond one and a half spacings from the wall, each point by its size.
    """
    fine = np.linspace(1.0, _BESIDE, 400)
    far = places > _NEAR
    beside_tanh = chain.lean_ratio / 2 * (1 - np.tanh(fine * chain.lean_ratio))
    for depth, style, colour, label in (
        (penetration_depth(chain) / chain.spacing, '-', BLACK, 'exact decay ℓ'),
        (chain.lean_ratio / 2, '--', GREY, 'paper: decay r sin θ̄'),
    ):
        waves = np.stack([np.cos(np.pi * places[far]), np.sin(np.pi * places[far])], axis=1)
        strengths = np.linalg.lstsq(waves, from_rest[far] * np.exp(places[far] / depth))[0]
        wave = strengths @ np.stack([np.cos(np.pi * fine), np.sin(np.pi * fine)])
        decay = np.exp(-fine / depth)
        linear.plot(fine, wave * decay + beside_tanh, style, color=colour, label=label)
        logarithmic.plot(
            fine, np.hypot(*strengths) * decay, style, color=colour, label=f'{label}, envelope'
        )
        plate.note(_short_name(chain), label, (_BEYOND, '(u - ub) / a [1]'), fine, wave * decay)


def _compare_overshoot(plate: Plate, chain: Chain) -> None:
    places, fields = _static_snapshots(chain, (chain.number_of_rotors - 1) / 2)
    lean_ratio = chain.lean_ratio
    from_tanh = lean_ratio / 2 * (fields + np.tanh(places * lean_ratio))
    plate.compare(
        f'max |u − u_tanh| / (a d³), {_short_name(chain)}',
        'a constant: the deviation is ∝ d³',
        'no closed form',
        float(np.abs(from_tanh).max()) / lean_ratio**3,
    )
    plate.compare(
        f'overshoot of u above ū, in units of ū, {_short_name(chain)}',
        '∝ d³',
        'no closed form; 0 for d ≤ 1',
        float(fields.max() - 1),
    )


def _compare_tail(plate: Plate, chain: Chain) -> None:
    """Decay length and wave number of a wall at rest, from successive rotors far from it."""
    depth = penetration_depth(chain) / chain.spacing
    middle = chain.number_of_rotors // 2
    tail = np.sin(static_wall(chain, middle + 0.5))[middle - int(12 * depth) - 6 : middle - 5]
    deviation = tail - math.sin(chain.rest_angle)
    ratios = deviation[:-1] / deviation[1:]
    name = _short_name(chain)
    plate.compare(
        f'decay length of the oscillation / a, {name}',
        f'r sin θ̄ / a = {chain.lean_ratio / 2:.4g}',
        '1 / ln((d + 1)/(d − 1))',
        -1 / math.log(abs(ratios[0])),
        depth,
    )
    plate.compare(
        f'wavelength of the oscillation / a, {name}',
        '2π / √8 = 2.2 (linearised), 2 (seen)',
        '2, a change of sign at every rotor',
        2.0 if (ratios < 0).all() else math.inf,
        2.0,
    )


def _title(chain: Chain) -> str:
    kind = 'spinners' if chain.motion is Motion.SPINNER else 'flippers'
    return f'{kind}, {chain.number_of_rotors} rotors, {_short_name(chain)}'


def _short_name(chain: Chain) -> str:
    ratio = chain.rotor_length / chain.spacing
    return f'r/a = {ratio:g}, θ̄ = {chain.rest_angle:g}, d = {chain.lean_ratio:.2f}'
