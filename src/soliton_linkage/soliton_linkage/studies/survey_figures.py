# SPDX-License-Identifier: Apache-2.0
"""What the paper leaves out: energies, disorder, the limit of rigid bars, and anti-kinks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.bands import penetration_depth, speed_of_sound
from soliton_linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.continuum import FlipperTheory, SpinnerTheory, WallTheory
from soliton_linkage.deviations import drawn_deviations
from soliton_linkage.elastic_simulation import simulate
from soliton_linkage.rigid_simulation import RigidSimulation
from soliton_linkage.statics import balanced
from soliton_linkage.studies.drawing import BLACK, BLUE, GREEN, RED
from soliton_linkage.studies.experiments import kick_rates, moving_wall, wall_places
from soliton_linkage.studies.measures import OUTCOMES, Trial, measure_survival
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from
from soliton_linkage.track import follow

_COLOURS = (BLUE, RED, GREEN)
_MARKERS = 'os^'
_MIDDLE = 0.3
_REACH = 8
_SLOW = 0.87


def energy_figure(section: Section, quick: bool) -> Plate:
    """Energy of a wall, how it divides, and what it leaves behind, against its speed."""
    section.allow('chains')
    plate = Plate(Figure(figsize=(13, 4.8), layout='constrained'))
    panels = plate.figure.subplots(1, 3)
    for (name, each), colour, marker in zip(
        section.section('chains').sections().items(), _COLOURS, _MARKERS, strict=False
    ):
        each.allow('chain', 'kicks')
        chain = chain_from(each.section('chain'))
        kicks = each.numbers('kicks', 1e-6, 100.0)
        label = f'{name}: {_name(chain)}'
        rows = [_energies(chain, kick) for kick in (kicks[::4] if quick else kicks)]
        speed, kinetic, elastic, wake = np.array(rows).T
        whole = (kinetic + elastic) / _theory(chain).energy_scale
        for axes, letter, values in (
            (panels[0], 'a', whole),
            (panels[1], 'b', elastic / kinetic),
            (panels[2], 'c', wake / (kinetic + elastic)),
        ):
            axes.plot(speed, values, marker + '-', color=colour, label=label, linewidth=0.6)
            plate.note(letter, label, speed, values)
        if chain.lean_ratio < 0.3:
            _compare_energies(plate, chain, speed, whole, elastic / kinetic)
    fine = np.linspace(0.01, 0.97, 300)
    boost = 1 / np.sqrt(1 - fine**2)
    panels[0].plot(fine, boost - 1, '--', color=BLACK, label='γ − 1')
    panels[1].plot(fine, (boost - 1) / (boost + 1), '--', color=BLACK, label='(γ − 1)/(γ + 1)')
    titles = ('a  whole energy / E_s', 'b  elastic / kinetic', 'c  share left behind the wall')
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, loc='left')
        axes.set(xlabel='v / c', yscale='log')
    panels[0].legend(fontsize=8)
    return plate


def disorder_figure(section: Section, quick: bool) -> Plate:
    """Share of chains that a wall crosses and returns through, against their deviations."""
    section.allow('chains', 'fractions', 'seeds')
    fractions = section.numbers('fractions', 0.0, 0.5)
    seeds = section.whole_number('seeds', 1, 10_000)
    plate = Plate(Figure(figsize=(10, 4.6), layout='constrained'))
    panels = plate.figure.subplots(1, 2, sharey=True)
    for (name, each), colour, marker in zip(
        section.section('chains').sections().items(), _COLOURS, _MARKERS, strict=False
    ):
        each.allow('chain', 'kick')
        chain = chain_from(each.section('chain'))
        kick = each.number('kick', 1e-6, 100.0)
        drawn = [
            [_deviating(chain, fraction, seed) for seed in range(1 if quick else seeds)]
            for fraction in (fractions[::2] if quick else fractions)
        ]
        shown = np.array(fractions[::2] if quick else fractions)
        label = f'{name}: {_name(chain)}, N = {chain.number_of_rotors}'
        for axes, mechanics in zip(panels, ('rigid', 'elastic'), strict=True):
            shares = [np.mean([_returns(one, kick, mechanics) for one in row]) for row in drawn]
            axes.plot(100 * shown, shares, marker + '-', color=colour, label=label)
            axes.set_title(f'{mechanics}: crosses and returns', loc='left')
            plate.note(mechanics, label, shown, shares)
    for axes in panels:
        axes.set(xlabel='deviation of r, a and kₑ [%]', ylim=(-0.05, 1.05))
    panels[0].set_ylabel(f'share of {seeds} chains')
    panels[0].legend(fontsize=8)
    return plate


def rigid_limit_figure(section: Section, quick: bool) -> Plate:
    """Springs that get stiffer move as rigid bars do: paths, and distance against k_e."""
    section.allow('chain', 'kick', 'duration', 'factors')
    chain = chain_from(section.section('chain'))
    factors = section.numbers('factors', 1.0, 1e9)
    duration = section.number('duration', 0.0, 1e6) * chain.time_unit
    rest = chain.uniform_state(1)
    rates = kick_rates(chain, rest, section.number('kick', 1e-6, 100.0))
    period = duration / 200
    rigid = RigidSimulation(chain, rest, rates, period).record(duration)
    plate = Plate(Figure(figsize=(11, 4.8), layout='constrained'))
    paths, distances = plate.figure.subplots(1, 2)
    apart = []
    shown = factors[:3] if quick else factors
    for factor in shown:
        stiff = replace(chain, stiffness=chain.stiffness * factor)
        elastic = simulate(stiff, rest, rates, duration, period)
        apart.append(float(np.abs(elastic.angles - rigid.angles).max()))
        times = elastic.times / chain.time_unit
        if factor in shown[:3]:
            track = follow(stiff, elastic)
            paths.plot(times, track.rotors, label=f'kₑ × {factor:g}', linewidth=1)
            plate.note('a', f'k_e times {factor:g}', times, track.rotors)
    track = follow(chain, rigid)
    times = rigid.times / chain.time_unit
    paths.plot(times, track.rotors, '--', color=BLACK, label='rigid bars')
    plate.note('a', 'rigid', times, track.rotors)
    paths.set(xlabel='time [√(M/kₑ)]', ylabel='wall at rotor')
    paths.legend()
    _draw_order(plate, distances, np.array(shown), np.array(apart))
    return plate


def anti_kink_figure(section: Section, quick: bool) -> Plate:
    """Energy of an anti-kink at rest, over that of the continuum, against d."""
    section.allow('rotor_length_ratio', 'lean_ratios')
    ratio = section.number('rotor_length_ratio', 1e-3, 1e3)
    wanted = section.numbers('lean_ratios', 1e-3, 1.0)
    plate = Plate(Figure(figsize=(7, 4.8), layout='constrained'))
    axes = plate.figure.subplots()
    shown = np.array(wanted[::3] if quick else wanted)
    chains = [_ring_of_lean(ratio, lean_ratio) for lean_ratio in shown]
    costs = np.array([_anti_kink_cost(chain) for chain in chains])
    shares = costs / np.array([_theory(chain).energy(0.0, charge=-1) for chain in chains])
    axes.plot(shown, shares, 'o-', color=BLUE)
    axes.axhline(1, color=BLACK, linestyle='--', label='continuum: (16/3) kₑ a ū³ / l̄²')
    axes.set(xlabel='d = 2 r sin θ̄ / a', ylabel='anti-kink cost / continuum', ylim=(0.6, 1.05))
    axes.legend()
    plate.note('', 'cost over continuum', shown, shares)
    for chain, cost in zip(chains, costs, strict=True):
        plate.compare(
            f'energy of an anti-kink at rest / (kₑ a²), d = {chain.lean_ratio:.3g}',
            'finite',
            '(16/3) a ū³ / l̄², for d ≪ 1',
            float(cost) / (chain.stiffness * chain.spacing**2),
            _theory(chain).energy(0.0, charge=-1) / (chain.stiffness * chain.spacing**2),
        )
    return plate


def _energies(chain: Chain, kick: float) -> tuple[float, float, float, float]:
    """Speed over that of sound, kinetic and elastic energy [J], and energy behind [J].

    Means over the frames with the wall in the middle of the chain.
    """
    recording, speed = moving_wall(chain, kick)
    places = wall_places(chain, recording)
    middle = (chain.number_of_rotors - 1) / 2
    inside = np.flatnonzero(np.abs(places - middle) < _MIDDLE * middle)
    angles, rates = recording.angles[inside], recording.rates[inside]
    stretched = 0.5 * chain.stiffnesses * chain.spring_extensions(angles) ** 2
    moving = 0.5 * chain.moments_of_inertia * rates**2
    reach = _REACH * penetration_depth(chain) / chain.spacing + 3
    behind = np.arange(chain.number_of_rotors) > places[inside, None] + reach
    wake = np.where(behind, moving, 0).sum() + np.where(behind[:, :-1], stretched, 0).sum()
    sums = np.array([moving.sum(), stretched.sum(), wake]) / len(inside)
    return speed * chain.spacing / speed_of_sound(chain), *sums.tolist()


def _compare_energies(
    plate: Plate, chain: Chain, speed: Array, whole: Array, share: Array
) -> None:
    slow = speed < _SLOW
    for v, energy, ratio in zip(speed[slow], whole[slow], share[slow], strict=True):
        boost = 1 / math.sqrt(1 - v**2)
        plate.compare(
            f'energy of a wall / E_s at v = {v:.3f} c, {_name(chain)}',
            'cost-free at rest; no energy given',
            'γ − 1',
            float(energy),
            boost - 1,
        )
        plate.compare(
            f'elastic over kinetic energy at v = {v:.3f} c, {_name(chain)}',
            'not given',
            '(γ − 1)/(γ + 1)',
            float(ratio),
            (boost - 1) / (boost + 1),
        )


def _deviating(chain: Chain, fraction: float, seed: int) -> Chain:
    drawn = drawn_deviations(
        chain.number_of_rotors, seed, rotor_length=fraction, spacing=fraction, stiffness=fraction
    )
    return replace(chain, deviations=drawn)


def _returns(chain: Chain, kick: float, mechanics: str) -> bool:
    """Whether the wall crosses a chain and comes back; it does not where there is no rest."""
    try:
        found = measure_survival(chain, Trial(kick=kick, mechanics=mechanics))
    except (ArithmeticError, ValueError):
        return False
    return found['outcome'] == OUTCOMES[0]


def _draw_order(plate: Plate, axes: Axes, factors: Array, apart: Array) -> None:
    """Largest distance of an angle against stiffness, with a line of order 1."""
    axes.loglog(factors, apart, 'o', color=BLUE, label='springs from bars')
    axes.loglog(factors, apart[-1] * factors[-1] / factors, '--', color=BLACK, label='∝ 1 / kₑ')
    axes.set(xlabel='kₑ, over that of the figure at the left', ylabel='largest distance [rad]')
    axes.legend()
    plate.note('b', 'distance', factors, apart)
    order = -float(np.polyfit(np.log(factors[-3:]), np.log(apart[-3:]), 1)[0])
    plate.compare(
        'order in 1/kₑ of the distance of springs from rigid bars',
        'the linkage is the limit kₑ → ∞',
        'first order at fixed speed',
        order,
        1.0,
    )


def _ring_of_lean(ratio: float, lean_ratio: float) -> Chain:
    """Chain with periodic ends, long enough for two walls that know nothing of each other."""
    rest_angle = math.asin(lean_ratio / (2 * ratio))
    depth = 1 / math.log((1 + lean_ratio) / (1 - lean_ratio))
    rotors = 4 * math.ceil(7 * depth + 5)
    return Chain(rotors, 1.0, ratio, rest_angle, 1.0, 1.0, periodic=True)


def _anti_kink_cost(ring: Chain) -> float:
    """Energy of the balanced ring with an anti-kink and, for nothing, a kink [J]."""
    rotors, theory = ring.number_of_rotors, FlipperTheory(ring)
    places = ring.spacing * np.arange(rotors)
    kink, anti_kink = (ring.spacing * (rotors * share - 0.5) for share in (0.25, 0.75))
    first = theory.displacements(places, kink, charge=1)
    second = theory.displacements(places, anti_kink, charge=-1)
    lean = np.where(np.arange(rotors) < rotors // 2, first, second)
    return float(
        ring.elastic_energy(balanced(ring, staggered(np.arcsin(lean / ring.rotor_length))))
    )


def _theory(chain: Chain) -> WallTheory:
    return SpinnerTheory(chain) if chain.motion is Motion.SPINNER else FlipperTheory(chain)


def _name(chain: Chain) -> str:
    return f'r/a = {chain.rotor_length / chain.spacing:g}, θ̄ = {chain.rest_angle:g}'
