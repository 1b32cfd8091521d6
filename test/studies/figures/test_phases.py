# SPDX-License-Identifier: Apache-2.0
"""The phase diagram has the boundaries of the classes, and the torus hides points behind it."""

import math
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex

from soliton_linkage.linkage.chain import Motion
from soliton_linkage_studies.figures import FIGURES
from soliton_linkage_studies.figures.phases import hidden, on_torus
from soliton_linkage_studies.palette import MOTION_COLOURS, tint
from soliton_linkage_studies.settings import load_settings
from soliton_linkage_studies.unit_cell import flipper_limit, spinner_limit

CONFIG = Path(__file__).parents[3] / 'config/studies/figures.yaml'


def test_each_point_of_the_diagram_has_the_colour_of_its_class():
    report = FIGURES['figure_4'](load_settings(CONFIG).section('figure_4'), True)
    axes = report.figure.subfigs[0].axes[0]
    regions = {to_hex(each.get_facecolor()[0]): each.get_paths()[0] for each in axes.collections}
    generator = np.random.default_rng(3)
    ratios = 10 ** generator.uniform(-1, 1, 300)
    angles = generator.uniform(0.03, math.pi / 2 - 0.03, 300)
    classes = (ratios > flipper_limit(angles)).astype(int) + (ratios > spinner_limit(angles))
    for number, motion in enumerate(Motion):
        (region,) = (
            path
            for colour, path in regions.items()
            if colour == min(regions, key=lambda one: distance(one, MOTION_COLOURS[motion]))
        )
        inside = region.contains_points(np.column_stack([ratios, angles]))
        assert (inside == (classes == number)).mean() > 0.99  # Boundaries are polygons.


def distance(colour: str, full: str) -> float:
    parts = ((int(one[i : i + 2], 16) for i in (1, 3, 5)) for one in (colour, tint(full, 0.2)))
    return math.dist(*map(list, parts))


def test_the_torus_hides_points_behind_it():
    for around, across, behind in [
        (-math.pi / 3, 0.0, False),  # Outside, towards the eye.
        (-math.pi / 3, math.pi / 2, False),  # On top.
        (0.0, -math.pi / 2, True),  # At the bottom.
        (2 * math.pi / 3, 0.0, True),  # Outside, away from the eye.
        (-math.pi / 3, math.pi, True),  # In the hole, away from the eye.
    ]:
        point = np.array(on_torus(np.array([around]), np.array([across])))
        assert hidden(point).tolist() == [behind]
