# SPDX-License-Identifier: Apache-2.0
"""Errors of identified chains, compared with the Cramer-Rao bound and the stated deviations.

Chains have 40 rotors with 5 % deviation in every length. Each is identified from one passage of a
wall through rigid bars, at 250 Hz, with a noise of 0.01 rad and offsets of 0.05 rad. Identified
chains are stored in files, so that an interrupted run continues. The first-order error of each
chain is known. Its expected value is 0, and its variance is the bound. It serves as a control
variate for means and variances, so that few chains are enough.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from comparison import Figure, Part, parser, tracked, write
from identification_draws import CHAINS, Draw, draw_of
from identification_use import figures_of_springs, figures_of_use

from soliton_linkage.identification.lengths import split
from soliton_linkage.linkage.chain import Array

KINDS = ('rotor_length', 'offset', 'spacing', 'rest_length')
"""Names of the unknowns, in their order."""
DRAWS = 20
"""Number of chains of each class [1]; they need about a minute of processor time."""
QUICK = 2
"""Number of chains of each class with --quick [1]."""


def figures_of_lengths(name: str, draws: list[Draw]) -> list[Figure]:
    """Return and print biases, and errors divided by the bound and by the stated deviation."""
    errors, linear, stated, alone = (
        np.array([getattr(draw, part) / draw.bound for draw in draws])
        for part in ('errors', 'linear', 'stated', 'alone')
    )
    beside = errors - linear
    over = 1 + np.mean(errors**2 - linear**2, axis=0)
    over_stated = np.mean((1 + errors**2 - linear**2) / stated**2, axis=0)
    bias = beside.mean(axis=0)
    chance = beside.std(axis=0) / math.sqrt(len(draws))
    print(
        f'{name}, {len(draws)} chains: rms error / bound, the same without chance, rms error / '
        'bound of the angles, rms error / stated deviation without chance; rms bias / bound'
    )
    for number, kind in enumerate(KINDS):
        own, larger, angles_alone, larger_stated, unbiased = (
            split(each)[number]
            for each in (errors, over, errors / alone, over_stated, bias**2 - chance**2)
        )
        numbers = _rms(own), _root(larger.mean()), _rms(angles_alone), _root(larger_stated.mean())
        shown = (f'{each:.3f}' for each in (*numbers, _root(unbiased.mean())))
        print(f'  {kind:12}', *shown, flush=True)
    worst = int(np.argmax(over))
    positions, stated_ratio = [draw.position for draw in draws], _root(over_stated.mean())
    return [
        Figure(f'{name}: error / bound', '', [math.sqrt(over.mean())], '1.1'),
        Figure(f'{name}: the same of the worst unknown', '', [math.sqrt(over[worst])], '1.1'),
        Figure(f'{name}: rms bias / bound', '', [_root(np.mean(bias**2 - chance**2))], '0.1'),
        Figure(f'{name}: the same of the worst unknown', '', [float(np.abs(bias).max())], '0.1'),
        Figure(f'{name}: error / stated deviation', '', [stated_ratio], '0.95 to 1.05'),
        Figure(f'{name}: position error / bound', '', [_rms(np.array(positions))], '1.05'),
    ]


def main() -> None:
    """Measure the requested chains."""
    options = parser(__doc__)
    # Python 3.11 rejects an empty list of names if `choices` are given.
    options.add_argument('names', nargs='*', help=f'of {", ".join(CHAINS)} (all)')
    for name, meaning in (
        ('--draws', f'number of chains of each class ({DRAWS}; {QUICK} with --quick)'),
        ('--springs', 'number of spring chains of each class (0)'),
        ('--use', 'number of chains of each class to analyse and steer (0)'),
    ):
        options.add_argument(name, type=_count, metavar='CHAINS', help=meaning)
    chosen = options.parse_args()
    if unknown := set(chosen.names) - set(CHAINS):
        options.error(f'{sorted(unknown)[0]} is not one of {", ".join(CHAINS)}')
    count = chosen.draws
    if count is None:
        count = QUICK if chosen.quick else DRAWS
    folder = chosen.output.parent / 'identification_draws'
    figures: list[Figure] = []
    for name in chosen.names or CHAINS:
        numbers = tracked(range(count), name, '{} chains')
        draws = [draw_of(name, number, folder) for number in numbers]
        figures += figures_of_lengths(name, draws) if draws else []
        figures += figures_of_springs(name, chosen.springs) if chosen.springs else []
        figures += figures_of_use(name, chosen.use) if chosen.use else []
    write(Part('identification', figures=figures), chosen.output)


def _count(text: str) -> int:
    """Parse a number of chains."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number of 0 or more')
    return int(text)


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _root(square: float) -> float:
    """Return the root of `|square|` with the sign of `square`, a difference of squares."""
    return math.copysign(math.sqrt(abs(square)), square)


if __name__ == '__main__':
    main()
