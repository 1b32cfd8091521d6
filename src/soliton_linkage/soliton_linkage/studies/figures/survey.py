# SPDX-License-Identifier: Apache-2.0
"""What the paper leaves out: energies, disorder, the limit of rigid bars, and anti-kinks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.bands import largest_group_velocity, penetration_depth, speed_of_sound
from soliton_linkage.linear.statics import balanced
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.solitons.continuum import FlipperTheory, WallTheory, wall_theory
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.solitons.track import follow
from soliton_linkage.studies.drawing import BLACK, BLUE, GREEN, RED
from soliton_linkage.studies.experiments import kick_rates, moving_wall, wall_places
from soliton_linkage.studies.measures import OUTCOMES, SweepTrial, measure_survival
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.settings import Section, chain_from

_COLOURS = (BLUE, RED, GREEN)
_MARKERS = 'os^'
_MIDDLE = 0.3
_REACH = 8
_CONTINUUM = 0.3
_ENERGIES = {
    'a': 'whole energy / E_s [1]',
    'b': 'elastic / kinetic energy [1]',
    'c': 'energy behind the wall / whole energy [1]',
}
_SLOW = 0.87
_PATH = ('time [sqrt(M/k_e)]', 'wall at rotor [rotor spacings]')
_NORMAL = 1.959964
_ASIDE = 0.15


def energy_figure(section: Section, quick: bool) -> Plate:
    """Energy of a wall, how it divides, and what it leaves behind, against its speed."""
    section.allow('chains')
    plate = Plate(Figure(figsize=(13, 4.8), layout='constrained'))
    panels = plate.figure.subplots(1, 3)
    theories = []
    for (name, each), colour, marker in zip(
        section.section('chains').sections().items(), _COLOURS, _MARKERS, strict=False
    ):
        each.allow('chain', 'kicks')
        chain = chain_from(each.section('chain'))
        kicks = each.numbers('kicks', 1e-6, 100.0)
        label = f'{name}: {_name(chain)}'
        rows = [_energies(chain, kick) for kick in (kicks[::4] if quick else kicks)]
        speed, kinetic, elastic, wake, echo = np.array(rows).T
        whole = (kinetic + elastic) / wall_theory(chain).energy_scale
        shares = elastic / kinetic
        left = wake / (kinetic + elastic)
        for axes, letter, values in zip(panels, 'abc', (whole, shares, left), strict=True):
            plate.note(letter, label, ('v / c [1]', _ENERGIES[letter]), speed, values)
            known = (echo == 0) | (letter != 'c')
            axes.plot(
                speed[known],
                values[known],
                marker + '-',
                color=colour,
                label=label,
                linewidth=0.6,
            )
            axes.plot(speed[~known], values[~known], marker, color=colour, fillstyle='none')
        if chain.lean_ratio < _CONTINUUM:
            _compare_energies(plate, chain, speed, whole, shares)
            theories.append(wall_theory(chain))
    for theory in theories[:1]:
        _draw_theory(panels, theory)
    titles = ('a  whole energy / $E_s$', 'b  elastic / kinetic energy', 'c  share behind the wall')
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, loc='left')
        axes.set(xlabel='v / c', yscale='log')
    panels[2].plot(
        [],
        [],
        'o',
        color=BLACK,
        markerfacecolor='white',
        label='may hold reflected phonons of the kick',
    )
    panels[0].legend(fontsize=8)
    panels[1].legend(handles=panels[1].lines[-1:], fontsize=8, loc='lower right')
    panels[2].legend(handles=panels[2].lines[-1:], fontsize=8, loc='lower right')
    return plate


def _draw_theory(panels: Sequence[Axes], theory: WallTheory) -> None:
    fine = np.linspace(0.05, 0.97, 300)
    velocities = (fine * theory.speed_of_sound).tolist()
    energies = np.array([theory.energy(velocity) for velocity in velocities])
    shares = [theory.elastic_energy(each) / theory.kinetic_energy(each) for each in velocities]
    whole = energies / theory.energy_scale
    panels[0].plot(fine, whole, '--', color=BLACK, label=r'$(\gamma - 1)\,M_{eff}\,c^2 / E_s$')
    panels[1].plot(fine, shares, '--', color=BLACK, label=r'$(\gamma - 1)/(\gamma + 1)$')


def disorder_figure(section: Section, quick: bool) -> Plate:
    """Share of chains that a wall crosses and returns through, against their deviations."""
    section.allow('chains', 'fractions', 'seeds')
    fractions = section.numbers('fractions', 0.0, 0.5)
    seeds = section.whole_number('seeds', 1, 10_000)
    plate = Plate(Figure(figsize=(10, 4.6), layout='constrained'))
    panels = plate.figure.subplots(1, 2, sharey=True)
    shown = np.array(fractions[::2] if quick else fractions)
    count = 1 if quick else seeds
    rigid: list[tuple[Array, Array]] = []
    for number, ((name, each), colour, marker) in enumerate(
        zip(section.section('chains').sections().items(), _COLOURS, _MARKERS, strict=False)
    ):
        each.allow('chain', 'kick')
        chain = chain_from(each.section('chain'))
        kick = each.number('kick', 1e-6, 100.0)
        drawn = [
            [_deviating(chain, fraction, seed) for seed in range(count)] for fraction in shown
        ]
        open_ = np.array([[not blocked_bonds(one).any() for one in row] for row in drawn])
        label = f'{name}: {_name(chain)}, N = {chain.number_of_rotors}'
        for axes, mechanics in zip(panels, ('rigid', 'elastic'), strict=True):
            passed = np.array([[_returns(one, kick, mechanics) for one in row] for row in drawn])
            shares = passed.mean(axis=1)
            ends = np.array([wilson_interval(int(row.sum()), count) for row in passed]).T
            axes.errorbar(
                100 * shown + _ASIDE * (number - 1),
                shares,
                np.abs(ends - shares),
                fmt=marker + '-',
                color=colour,
                label=label,
                capsize=3,
                linewidth=1,
            )
            axes.set_title(f'{mechanics}: crosses and returns', loc='left')
            names = ('standard deviation of r, a and k_e, relative [1]', 'share that pass [1]')
            plate.note(mechanics, label, names, shown, shares)
            for series, end in zip(('lower', 'upper'), ends, strict=True):
                plate.note(mechanics, f'{label}, {series} end of 95 %', names, shown, end)
            if mechanics == 'rigid':
                rigid.append((open_, passed))
    for axes in panels:
        axes.set(xlabel=r'standard deviation of $r$, $a$ and $k_e$ [%]', ylim=(-0.05, 1.05))
    panels[0].set_ylabel(f'share of {count} chains, 95 % intervals')
    panels[0].legend(fontsize=7, handlelength=1.2, loc='lower left')
    _compare_passage(plate, shown, *np.concatenate(rigid, axis=2))
    return plate


def wilson_interval(passed: int, count: int) -> tuple[float, float]:
    """Ends of the interval of Wilson for a share of a count, at 95 %.

    They are the p of which the share s is as far off as s - p = +-1.96 sqrt(p (1 - p) / count).
    """
    share, pull = passed / count, _NORMAL**2 / count
    middle = share + pull / 2
    half = math.sqrt(pull * (share * (1 - share) + pull / 4))
    low, high = (middle - half) / (1 + pull), (middle + half) / (1 + pull)
    return min(max(low, 0.0), share), max(min(high, 1.0), share)


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
    for number, factor in enumerate(shown):
        stiff = replace(chain, stiffness=chain.stiffness * factor)
        elastic = simulate(stiff, rest, rates, duration, period)
        apart.append(float(np.abs(elastic.angles - rigid.angles).max()))
        times = elastic.times / chain.time_unit
        if number < len(_COLOURS):
            track = follow(stiff, elastic)
            label, colour = f'$k_e \\times {factor:g}$', _COLOURS[number]
            paths.plot(times, track.rotors, color=colour, label=label, linewidth=1.5)
            plate.note('a', f'k_e times {factor:g}', _PATH, times, track.rotors)
    track = follow(chain, rigid)
    times = rigid.times / chain.time_unit
    paths.plot(times, track.rotors, '--', color=BLACK, label='rigid bars')
    plate.note('a', 'rigid bars', _PATH, times, track.rotors)
    paths.set(xlabel=r'time [$\sqrt{M/k_e}$]', ylabel='wall at rotor')
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
    shares = costs / np.array([wall_theory(chain).energy(0.0, charge=-1) for chain in chains])
    axes.plot(shown, shares, 'o-', color=BLUE)
    axes.axhline(
        1, color=BLACK, linestyle='--', label=r'continuum: $(16/3)\,k_e\,a\,\bar u^3 / \bar l^2$'
    )
    axes.set(xlabel='d = 2 r sin θ̄ / a', ylabel='anti-kink cost / continuum', ylim=(0.6, 1.05))
    axes.legend()
    names = ('d = 2 r sin(theta_bar) / a [1]', 'energy / energy of the continuum [1]')
    plate.note('', 'anti-kink', names, shown, shares)
    for chain, cost in zip(chains, costs, strict=True):
        plate.compare(
            f'energy of an anti-kink at rest / (kₑ a²), d = {chain.lean_ratio:.3g}',
            'finite',
            '(16/3) a ū³ / l̄², for d ≪ 1',
            float(cost) / (chain.stiffness * chain.spacing**2),
            wall_theory(chain).energy(0.0, charge=-1) / (chain.stiffness * chain.spacing**2),
        )
    return plate


def _energies(chain: Chain, kick: float) -> tuple[float, float, float, float, float]:
    """Speed over that of sound, kinetic and elastic energy [J], and energy behind [J].

    Means over the frames with the wall first in the middle of the chain. The kick is sudden and
    makes phonons of its own, which overtake a slow wall, come back from the first rotor and are
    then behind it: where the fastest can be there in a frame, the last value is 1, else 0.
    """
    recording, speed = moving_wall(chain, kick)
    places = wall_places(chain, recording)
    middle = (chain.number_of_rotors - 1) / 2
    inside = np.flatnonzero(np.abs(places - middle) < _MIDDLE * middle)
    # A fast wall is reflected and comes through once more.
    inside = inside[: np.append(np.diff(inside) > 1, True).argmax() + 1]
    angles, rates = recording.angles[inside], recording.rates[inside]
    stretched = 0.5 * chain.stiffnesses * chain.spring_extensions(angles) ** 2
    moving = 0.5 * chain.moments_of_inertia * rates**2
    reach = _REACH * penetration_depth(chain) / chain.spacing + 3
    behind = np.arange(chain.number_of_rotors) > places[inside, None] + reach
    wake = np.where(behind, moving, 0).sum() + np.where(behind[:, :-1], stretched, 0).sum()
    fastest = largest_group_velocity(chain) / chain.spacing
    back = 2 * (chain.number_of_rotors - 1) / (fastest + speed)
    sums = np.array([moving.sum(), stretched.sum(), wake]) / len(inside)
    echo = float(recording.times[inside[-1]] > back)
    return speed * chain.spacing / speed_of_sound(chain), *sums.tolist(), echo


def _compare_energies(
    plate: Plate, chain: Chain, speed: Array, whole: Array, share: Array
) -> None:
    slow, theory = speed < _SLOW, wall_theory(chain)
    for v, energy, ratio in zip(speed[slow], whole[slow], share[slow], strict=True):
        velocity = float(v) * theory.speed_of_sound
        plate.compare(
            f'energy of a wall / E_s at v = {v:.3f} c, {_name(chain)}',
            'cost-free at rest; no energy given',
            '(γ − 1) M_eff c² / E_s with the exact c (limit γ − 1)',
            float(energy),
            theory.energy(velocity) / theory.energy_scale,
        )
        plate.compare(
            f'elastic over kinetic energy at v = {v:.3f} c, {_name(chain)}',
            'not given',
            '(γ − 1)/(γ + 1)',
            float(ratio),
            theory.elastic_energy(velocity) / theory.kinetic_energy(velocity),
        )


def _deviating(chain: Chain, fraction: float, seed: int) -> Chain:
    drawn = drawn_deviations(
        chain.number_of_rotors, seed, rotor_length=fraction, spacing=fraction, stiffness=fraction
    )
    return replace(chain, deviations=drawn)


def _compare_passage(plate: Plate, fractions: Array, free: Array, passed: Array) -> None:
    """Share of rigid chains that a wall passes, shape (F, K) each: all, and those it must."""
    for fraction, sufficient, passes in zip(fractions, free, passed, strict=True):
        name = f'deviations of {100 * fraction:g} %, rigid'
        met, count = int(sufficient.sum()), len(passes)
        plate.compare(
            f'share of all {count} chains that pass, {name}',
            'robust against disorder',
            'falls with the share of chains that have a blocked bond',
            float(passes.mean()),
        )
        if met:
            plate.compare(
                f'share that pass of the {met} chains without a blocked bond, {name}',
                'not given',
                'all: l̄ₙ > aₙ + |rₙ − rₙ₊₁| on every bond suffices',
                float(passes[sufficient].mean()),
                1.0,
            )


def _returns(chain: Chain, kick: float, mechanics: str) -> bool:
    """Whether the wall crosses a chain and comes back; it does not where there is no rest."""
    try:
        found = measure_survival(chain, SweepTrial(kick=kick, mechanics=mechanics))
    except (ArithmeticError, ValueError):
        return False
    return found['outcome'] == OUTCOMES[0]


def _draw_order(plate: Plate, axes: Axes, factors: Array, apart: Array) -> None:
    """Largest distance of an angle against stiffness, with a line of order 1."""
    axes.loglog(factors, apart, 'o', color=BLUE, label='springs from bars')
    axes.loglog(
        factors, apart[-1] * factors[-1] / factors, '--', color=BLACK, label=r'$\propto 1 / k_e$'
    )
    axes.set(xlabel='stiffness, times that of the chain', ylabel='largest distance [rad]')
    axes.legend()
    names = ('stiffness, times that of the chain [1]', 'largest distance of an angle [rad]')
    plate.note('b', 'springs from bars', names, factors, apart)
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


def _name(chain: Chain) -> str:
    return f'r/a = {chain.rotor_length / chain.spacing:g}, θ̄ = {chain.rest_angle:g}'
