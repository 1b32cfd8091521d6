# SPDX-License-Identifier: Apache-2.0
"""Cells of cases that are known to be hard, each class where the case may be of any."""

from __future__ import annotations

import math
from dataclasses import replace

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage_studies.accuracy.cells.cells import AccuracyCell, chain_of

_LEANS = {'flipper': (33, 0.9, 0.7), 'wobbler': (33, 0.8, 1.6), 'spinner': (33, 1.1, 3.4)}
"""Rotors, rest angle [rad] and lean ratio d of a chain of each class."""
_OTHER = 1.3
"""Rotors of another chain, over those of this one [1]."""
_DISORDERS = (0.01, 0.03, 0.05, 0.1)
"""Standard deviations of r, a, k and M, relative."""


def hard_cells() -> list[AccuracyCell]:
    """All of them, by names that say what is hard."""
    chains = {name: chain_of(*lean) for name, lean in _LEANS.items()}
    each = [cell for name, chain in chains.items() for cell in _of_class(name, chain)]
    return each + _of_few()


def _of_class(name: str, chain: Chain) -> list[AccuracyCell]:
    plain = AccuracyCell(name, chain, 0.01, 0.15, 0.2, 150)
    other = chain_of(chain.number_of_rotors, chain.rest_angle, _OTHER * chain.lean_ratio)
    known = [
        replace(plain, name=f'{name}'),
        replace(plain, name=f'nudged_{name}', nudged=True, run=2000),
        replace(plain, name=f'outliers_1_{name}', outliers=0.01),
        replace(plain, name=f'outliers_5_{name}', outliers=0.05),
        replace(plain, name=f'wrong_reading_{name}', wrong=3.0, run=15),
        replace(plain, name=f'edges_unseen_{name}', unseen='edges'),
        replace(plain, name=f'three_seen_{name}', unseen='all but three'),
        replace(plain, name=f'one_seen_{name}', unseen='all but one'),
        replace(plain, name=f'noise_alone_{name}', nothing=True),
        replace(plain, name=f'degrees_{name}', degrees=True),
        replace(plain, name=f'other_chain_{name}', told_chain=other),
        replace(plain, name=f'pushed_{name}', pushes=50, run=600),
        replace(plain, name=f'pushes_told_{name}', pushes=50, run=600, told=True),
    ]
    return known + [
        replace(plain, name=f'disorder_{100 * share:g}_{name}', disorder=share)
        for share in _DISORDERS
    ]


def _of_few() -> list[AccuracyCell]:
    """Cases of one class."""
    flipper, wobbler, spinner = (chain_of(*lean) for lean in _LEANS.values())
    pair = chain_of(60, 0.9, 0.7)
    cells = [
        AccuracyCell('broken_flipper', flipper, 0.01, 0.15, 0.2, 150, kick=3.0),
        AccuracyCell('broken_spinner', spinner, 0.01, 0.15, 0.2, 150, kick=6.0),
        AccuracyCell('pair_flipper', pair, 0.01, 0.15, 0.2, 150, walls=2),
        AccuracyCell(
            'pair_wobbler', replace(wobbler, number_of_rotors=60), 0.01, 0.1, 0.2, 150, walls=2
        ),
    ]
    for number, (rotors, speed) in enumerate(((16, 0.14), (20, 0.18), (25, 0.23))):
        chain = chain_of(rotors, 1.1, (1.7 + 0.3 * number) * 2 / math.sin(1.1))
        name = f'short_spinner_{rotors}'
        cells.append(AccuracyCell(name, chain, 0.005, speed, 0.2, 150, nudged=True))
    for share, speed in ((0.89, 0.25), (0.96, 0.33)):
        chain = chain_of(30, 0.9, share * 2 / math.sin(0.9))
        sound = speed_of_sound(chain) / chain.spacing * chain.time_unit
        kick = speed * sound * site_arc(chain)
        cells.append(
            AccuracyCell(f'fast_wobbler_{share:g}', chain, 0.01, speed, 0.2, 150, kick=kick)
        )
    for rotors, lean, noise in ((17, 1.4, 0.05), (33, 1.87, 0.01), (33, 2.3, 0.01)):
        chain = chain_of(rotors, 0.77, lean)
        name = f'slow_wobbler_{rotors}_{lean:g}'
        cells.append(AccuracyCell(name, chain, noise, 0.03, 0.3, 400, nudged=True))
    return cells
