# SPDX-License-Identifier: Apache-2.0
"""Films of a unit cell and its configuration space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage_studies.captions import LINKAGE, description
from soliton_linkage_studies.drawing import ChainPicture, draw_torus, pivot_points, split_at_wraps
from soliton_linkage_studies.films.scenes import BOTTOM, FILM_KINDS, TOP, Format, Scene
from soliton_linkage_studies.palette import BLACK, DARK, GREY, PALE
from soliton_linkage_studies.settings import Section, setting
from soliton_linkage_studies.unit_cell import configuration_curves

_SMOOTH = 800
"""Number of steps of a drawn curve [1]; no step is longer than a pixel."""


@dataclass(frozen=True)
class Cell:
    """Settings of a unit cell in motion."""

    chain: Chain
    kick: float = setting('norm of the velocities r phi_dot', 'a sqrt(k_e / M)', 1e-6, 100.0)

    @staticmethod
    def read(section: Section) -> Cell:
        """Read the settings. Raises ValueError if the chain does not have two rotors."""
        chain = section.chain()
        if chain.number_of_rotors != 2:
            wanted = 'must be 2 for a unit cell; use the kind cycle for more rotors'
            raise section.section('chain').error('number_of_rotors', wanted)
        return Cell(chain, **section.values_of(Cell, 'chain'))


@FILM_KINDS.add('unit_cell')
class CellScene(Scene):
    """Scene of a cycle of a unit cell, as a linkage and as a point in configuration space."""

    caption = f"""
    {LINKAGE} The red line is a rigid bar; pale circles are the paths of the masses.

    Right: configuration space of the unit cell over both staggered angles, for a constant length
    of the bar. Both angles are periodic, so opposite sides of the square are identical. The
    component that contains the motion is blue. If a second component exists, it is pink. Triangles
    mark the uniform states. The black dot is the configuration on the left; the wide grey line
    is its past path.
    """
    settings = Cell

    def __init__(self, title: str, motion: Cell, shape: Format) -> None:
        chain = motion.chain
        curves = configuration_curves(chain, _SMOOTH)
        arc = float(np.linalg.norm(np.diff(curves[0], axis=0), axis=1).sum())
        rate = motion.kick * chain.spacing / (chain.rotor_length * chain.time_unit)
        subtitle = f'{description(chain)}, rigid bar, v₀ = {motion.kick:g} a√(kₑ/M)'
        super().__init__(title, subtitle, shape, arc / rate, chain.time_unit)
        shares, steps = np.linspace(0, _SMOOTH, shape.frames), np.arange(_SMOOTH + 1)
        self.cell = np.column_stack([np.interp(shares, steps, angles) for angles in curves[0].T])
        high = TOP - BOTTOM - 0.02
        left = self.figure.add_axes((0.03, BOTTOM, 0.44, high))
        right = self.figure.add_axes((0.53, BOTTOM, 0.45, high - 0.02))
        self._picture = _cell_picture(left, chain, staggered(self.cell[0]))
        draw_torus(right, chain, curves)
        right.set(xlabel='θ₁ = φ₁ [rad]', ylabel='θ₂ = π − φ₂ [rad]')
        self.figure.legend(loc='lower center', bbox_to_anchor=(0.25, 0.05), ncols=2, frameon=False)
        right.set_title('configurations that keep the length of the bar')
        (self._trail,) = right.plot([], [], color=GREY, linewidth=7, alpha=0.45, zorder=1)
        look: Any = {'color': BLACK, 'markersize': 14, 'clip_on': False}
        (self._point,) = right.plot([], [], 'o', zorder=6, **look)
        self.add_moving([*self._picture.artists, self._trail, self._point])
        self.show(0)

    def _move(self, frame: int) -> None:
        angles = self.cell[frame]
        self._picture.update(staggered(angles))
        self._trail.set_data(*split_at_wraps(self.cell[: frame + 1]).T)
        self._point.set_data(*split_at_wraps(angles[None]).T)


def _cell_picture(axes: Axes, chain: Chain, angles: Array) -> ChainPicture:
    for number, (x, _) in enumerate(pivot_points(chain), start=1):
        circle = Circle((x, 0), chain.rotor_length, fill=False, edgecolor=PALE, linewidth=1.5)
        axes.add_patch(circle)
        below = -chain.rotor_length - 0.06 * chain.spacing
        axes.text(x, below, f'rotor {number}', ha='center', va='top', color=DARK)
    return ChainPicture(axes, chain, angles, rigid=True)
