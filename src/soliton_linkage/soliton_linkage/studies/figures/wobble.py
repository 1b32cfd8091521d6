# SPDX-License-Identifier: Apache-2.0
"""Overshoot and oscillations beside wobbling walls (paper, Figs. S1 and S2)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.studies.captions import shape
from soliton_linkage.studies.drawing import BLACK, COLOURS, GREY, MARKERS
from soliton_linkage.studies.experiments import (
    PLACE,
    SNAPSHOTS,
    Snapshots,
    snapshots,
    static_snapshots,
)
from soliton_linkage.studies.figures.registry import FIGURES
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from

_BEYOND = 'rotors from the wall [rotor spacings]'
_BESIDE = 10
"""How far from a wall its oscillation is drawn [rotor spacings]."""
_NEAR = 1.5
"""Within which a wall is no oscillation about the state at rest [rotor spacings]."""


@FIGURES.add('figure_s1')
def figure_s1(section: Section, quick: bool) -> Plate:
    """Profiles of wobbling flippers, from snapshots of a slow motion (paper, Fig. S1)."""
    section.allow('chains')
    chains = [chain_from(each) for each in section.section('chains').sections().values()]
    plate = Plate(Figure(figsize=(9, 5.5), layout='constrained'))
    axes = plate.figure.subplots()
    for chain, colour, marker in zip(chains, COLOURS, MARKERS, strict=False):
        seen = _slow_snapshots(chain, 4 if quick else SNAPSHOTS)
        near = np.abs(seen.places) < 9
        name = shape(chain)
        axes.plot(
            seen.places[near], seen.fields[near], marker, color=colour, markersize=4, label=name
        )
        plate.note('', name, (PLACE, 'u / ub [1]'), seen.places[near], seen.fields[near])
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


@FIGURES.add('figure_s2')
def figure_s2(section: Section, quick: bool) -> Plate:
    """Oscillations beside wobbling walls, over the decay of theory (paper, Fig. S2)."""
    section.allow('chains')
    chains = [chain_from(each) for each in section.section('chains').sections().values()]
    plate = Plate(Figure(figsize=(12, 3 * len(chains)), layout='constrained'))
    panels = plate.figure.subplots(len(chains), 2, sharex=True, squeeze=False)
    for (linear, logarithmic), chain, colour in zip(panels, chains, COLOURS, strict=False):
        seen = _slow_snapshots(chain, 4 if quick else SNAPSHOTS)
        beyond = (seen.places < 0) & (seen.places > -_BESIDE)
        places = -seen.places[beyond]
        lean = chain.lean_ratio / 2
        from_tanh = lean * (seen.fields[beyond] - np.tanh(places * 2 * lean))
        from_rest = lean * (seen.fields[beyond] - 1)
        linear.plot(places, from_tanh, 'o', color=colour, markersize=4, label='chain')
        logarithmic.plot(places, np.abs(from_rest), 'o', color=colour, markersize=4, label='chain')
        _draw_decays(plate, linear, logarithmic, chain, places, from_rest)
        name = shape(chain)
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


def _slow_snapshots(chain: Chain, count: int) -> Snapshots:
    """Frames of the rigid chain with its wall in the middle of the chain."""
    start = static_wall(chain, chain.number_of_rotors // 2 - 0.5)
    period = site_arc(chain) / count
    simulation = RigidSimulation(chain, start, mode_towards_last(chain, start), period)
    return snapshots(chain, simulation.record(1.5 * count * period), count)


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
        plate.note(shape(chain), label, (_BEYOND, '(u - ub) / a [1]'), fine, wave * decay)


def _compare_overshoot(plate: Plate, chain: Chain) -> None:
    places, fields = static_snapshots(chain, (chain.number_of_rotors - 1) / 2)
    lean_ratio = chain.lean_ratio
    from_tanh = lean_ratio / 2 * (fields + np.tanh(places * lean_ratio))
    plate.compare(
        f'max |u − u_tanh| / (a d³), {shape(chain)}',
        'a constant: the deviation is ∝ d³',
        'no closed form',
        float(np.abs(from_tanh).max()) / lean_ratio**3,
    )
    plate.compare(
        f'overshoot of u above ū, in units of ū, {shape(chain)}',
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
    name = shape(chain)
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
