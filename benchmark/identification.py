# SPDX-License-Identifier: Apache-2.0
"""How near identified chains come to the Cramer-Rao bound, and what is stated of them.

Chains of 40 rotors with 5 % in every length, one passage of rigid bars at 250 Hz, noise of
0.01 rad and offsets of 0.05 rad: errors over the bound with the tolerance known, over that of
the angles alone, and over what was stated; then the place of the wall by the nearest point on the
chain that was identified.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.estimation.nearest_point import fit_near
from soliton_linkage.identification.adjustment import adjusted, bound
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.lengths import lengths_of, split
from soliton_linkage.identification.start import equal_rotors
from soliton_linkage.identification.tolerances import Tolerances, unknowns_of
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.passage import blocked_bonds

CHAINS = {
    'flipper': (Chain(40, 0.1, 0.05, 0.97), 9.7),
    'wobbler': (Chain(40, 0.1, 0.1, 0.77), 3.4),
    'spinner': (Chain(40, 0.1, 0.2, 1.18), 6.9),
}
"""Chains and the speeds of their walls [rotor spacings / s]."""
KICKS = {'flipper': 10.0, 'wobbler': 4.0, 'spinner': 12.5}
"""Of springs [rad/s], those of config/*.yaml."""
PLURALS = {
    'rotor_length': 'rotor_lengths',
    'spacing': 'spacings',
    'rest_length': 'rest_lengths',
    'stiffness': 'stiffnesses',
    'mass': 'masses',
}
RATE = 250.0
"""Of frames [Hz]."""
NOISE = 0.01
"""Of a reading [rad]."""
OFFSET = 0.05
"""Standard deviation of an encoder's zero [rad]."""
SPREAD = 0.05
"""Of lengths of one kind [1]."""
PLACES = 200
"""Frames on which the place is measured [1]."""


def chains(nominal: Chain, draws: int) -> Iterator[Chain]:
    """Chains with lengths of their own that let walls pass."""
    seed = 0
    for _ in range(draws):
        while True:
            drawn = drawn_deviations(
                nominal.number_of_rotors,
                seed,
                spacing=SPREAD,
                rotor_length=SPREAD,
                rest_length=SPREAD,
            )
            seed += 1
            made = replace(nominal, deviations=drawn)
            if not blocked_bonds(made).any():
                break
        yield made


def place_error(true: Orbit, used: Orbit, offsets: Array, random: np.random.Generator) -> float:
    """Root mean square error of the place over its bound, on a chain used for the true one.

    Offsets are what is left of the encoders' zeros [rad], shape (N,).
    """
    rotors = true.chain.number_of_rotors
    squares = []
    for place in random.uniform(4, rotors - 5, PLACES):
        arc = true.arc_at(float(place), 0)
        noise = NOISE * random.standard_normal(rotors)
        found = fit_near(used, true.configuration(arc) + offsets + noise, used.arc_at(place, 0))
        least = NOISE / true.site_arc_at(arc)
        squares.append(((used.place(found.arc) - place) / least) ** 2)
    return math.sqrt(float(np.mean(squares)))


def measure(name: str, draws: int) -> None:
    """Print the table of one kind of chain."""
    nominal, speed = CHAINS[name]
    over: list[Array] = []
    over_alone: list[Array] = []
    over_stated: list[Array] = []
    places = []
    for number, made in enumerate(chains(nominal, draws)):
        random = np.random.default_rng([number, 7])
        orbit = orbit_of(made)
        begin, end = orbit.leg_arcs(0)
        frames = round((end - begin) / orbit.site_arc / speed * RATE)
        angles = np.array([orbit.configuration(s) for s in np.linspace(begin, end, frames)])
        offsets = OFFSET * random.standard_normal(nominal.number_of_rotors)
        readings = angles + offsets + NOISE * random.standard_normal(angles.shape)
        found = adjusted(readings, equal_rotors(readings))
        errors = unknowns_of(found.lengths) - unknowns_of(
            replace(lengths_of(made).scaled(1.0), offsets=offsets)
        )
        known = bound(made, angles, NOISE, Tolerances(SPREAD, OFFSET))
        over.append(errors / np.sqrt(np.diag(known)))
        over_alone.append(errors / np.sqrt(np.diag(bound(made, angles, NOISE))))
        over_stated.append(errors / found.deviations)
        used = orbit_of(found.lengths.scaled(float(made.spacings.mean())).chain(nominal))
        places.append(place_error(orbit, used, offsets - found.lengths.offsets, random))
    print(f'{name}: {draws} chains, {frames} frames; rms over the bound, over that of the angles')
    print('alone, over what was stated; mean error over the bound, largest of one unknown')
    parts = zip(
        ('rotor_length', 'offset', 'spacing', 'rest_length'),
        split(np.array(over)),
        split(np.array(over_alone)),
        split(np.array(over_stated)),
        strict=True,
    )
    for part, first, alone, stated in parts:
        numbers = [math.sqrt(float(np.mean(each**2))) for each in (first, alone, stated)]
        mean, largest = first.mean(), np.abs(first.mean(axis=0)).max()
        print(
            f'  {part:12}',
            *(f'{each:.3f}' for each in numbers),
            f'{mean:+.3f}',
            f'{largest:.2f} (chance {2.5 / math.sqrt(draws):.2f})',
        )
    print(f'  place        {np.mean(places):.3f} of its bound, at most {max(places):.3f}')


def measure_springs(name: str, draws: int, rotors: int) -> None:
    """Print what the motion of kicked springs shows, with 5 % in masses and stiffnesses too."""
    nominal, speed = CHAINS[name]
    nominal = replace(nominal, number_of_rotors=rotors)
    errors: dict[str, list[Array]] = {}
    for number, made in enumerate(chains(nominal, draws)):
        random = np.random.default_rng([number, 8])
        drawn = drawn_deviations(rotors, number, mass=SPREAD, stiffness=SPREAD)
        chain = replace(made, deviations=made.deviations.joined(drawn))
        start = leaning(chain, -1).angles
        rates = KICKS[name] * edge_mode(chain, start, Edge.FIRST)
        record = simulate(chain, start, rates, 1.3 * rotors / speed, 1 / RATE)
        offsets = OFFSET * random.standard_normal(rotors)
        readings = record.angles + offsets + NOISE * random.standard_normal(record.angles.shape)
        found = identify(record.times, readings, Chain())
        for part, spreads in found.deviations.items():
            shown, true = (np.array(getattr(each, PLURALS[part])) for each in (found.chain, chain))
            logarithms = np.log(shown) - np.log(true)
            if part == 'stiffness':
                logarithms += np.log(chain.masses.mean()) - np.log(found.chain.masses.mean())
            elif part == 'mass':
                logarithms -= logarithms.mean()
            else:
                logarithms += np.log(chain.spacings.mean()) - np.log(found.chain.spacings.mean())
            errors.setdefault(part, []).extend([logarithms, logarithms / spreads])
        print(f'{name} {number}: noise {found.noise:.5f} rad, rigid {found.rigid}', flush=True)
    for part, pairs in errors.items():
        plain, stated = (
            math.sqrt(float(np.mean(np.square(each))))
            for each in (np.concatenate(pairs[::2]), np.concatenate(pairs[1::2]))
        )
        print(f'  {part:12} rms {plain:.2%}, over what was stated {stated:.2f}')


def main() -> None:
    """Measure the chains that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        'names', nargs='*', default=list(CHAINS), help='of flipper, wobbler, spinner'
    )
    parser.add_argument('--draws', type=int, default=20, help='chains of each (%(default)s)')
    parser.add_argument(
        '--springs', type=int, metavar='ROTORS', help='kicked springs of so many rotors instead'
    )
    options = parser.parse_args()
    for name in options.names:
        if options.springs:
            measure_springs(name, options.draws, options.springs)
        else:
            measure(name, options.draws)


if __name__ == '__main__':
    main()
