# SPDX-License-Identifier: Apache-2.0
"""Colours are defined in one module and are distinguishable with colour blindness."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
from chains import EXAMPLES, FLIPPER, SPINNER, chain_of
from matplotlib.colors import to_rgb

from soliton_linkage_studies import palette

STUDIES = Path(palette.__file__).parent
# Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB.
DEUTERANOPIA = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
PROTANOPIA = np.array(
    [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]
)


def test_no_colour_is_named_outside_the_palette():
    literal = re.compile(r"""'#[0-9a-fA-F]{3,6}'|colou?rs?=?'(?!none)(?:[a-z]+|0\.\d+)'""")
    found = {
        f'{path.name}: {match}'
        for path in STUDIES.rglob('*.py')
        if path.name != 'palette.py'
        for match in literal.findall(path.read_text(encoding='utf-8'))
    }
    assert not found


def test_adjacent_colours_are_distinguishable():
    for colours in [
        palette.COLOURS,
        tuple(palette.MOTION_COLOURS.values()),
        tuple(palette.MECHANICS_COLOURS.values()),
        tuple(palette.OUTCOME_COLOURS.values()),
        (palette.MEASURED, palette.PAPER, palette.THEORY),
        (palette.LEANS_RIGHT, palette.LEANS_LEFT),
        palette.CURVE_COLOURS,
    ]:
        for blindness in [np.eye(3), DEUTERANOPIA, PROTANOPIA]:
            seen = [blindness @ np.array(to_rgb(colour)) ** 2.2 for colour in colours]
            for one, other in combinations(seen, 2):
                assert np.linalg.norm(one - other) > 0.15


def test_a_class_has_its_colour_and_chains_of_one_class_have_shades():
    chains = [chain_of(example, 6) for example in EXAMPLES]
    expected = [palette.MOTION_COLOURS[chain.motion] for chain in chains]
    assert palette.chain_colours(chains)[-1] == expected[-1]
    flippers = [chain_of((0.5, angle), 6) for angle in (0.1, 0.97, 0.5)]
    spinner = chain_of(SPINNER, 6)
    colours = palette.chain_colours([*flippers, spinner])
    assert len(set(colours)) == 4
    assert colours[1] == palette.chain_colours([chain_of(FLIPPER, 6)])[0]
    assert colours[3] == palette.MOTION_COLOURS[spinner.motion]


def test_scale_colours_get_lighter_in_order():
    lightness = [sum(to_rgb(colour)) for colour in palette.scale_colours(5)]
    assert lightness == sorted(lightness)
