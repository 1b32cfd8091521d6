# SPDX-License-Identifier: Apache-2.0
"""Films of a unit cell beside its configuration space, and of rotors one behind the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.solitons.unit_cell import configuration_curves
from soliton_linkage.studies.drawing import (
    BLACK,
    BLUE,
    GREY,
    RED,
    ChainPicture,
    broken_at_turns,
    draw_torus,
    limits,
    mass_points,
    pivot_points,
)
from soliton_linkage.studies.experiments import kick_rates
from soliton_linkage.studies.films.chain import KickedWall
from soliton_linkage.studies.films.scenes import (
    BOTTOM,
    LEFT,
    TOP,
    WIDTH,
    Format,
    Scene,
    SpaceTime,
    describe,
)
from soliton_linkage.studies.settings import Section, chain_from

_TOLERANCE = 1e-9
_SMOOTH = 800
_AZIMUTH = math.radians(-75)
_ELEVATION = math.radians(22)
_ZOOM = 1.9
_BODIES = (
    ('rotors', BLACK, 6.0),
    ('axles on the frame', GREY, 5.0),
    ('pins, the masses', BLUE, 8.0),
    ('bars', RED, 4.0),
)
"""Names, colours and line widths [points] of what `layered` returns."""


@dataclass(frozen=True)
class Cell:
    """Two rotors and the bar between them, in motion along their configuration space."""

    chain: Chain
    kick: float
    """Speed r |phi_dot| in units of a sqrt(k_e / M)."""

    @staticmethod
    def read(section: Section) -> Cell:
        """Read the settings; the chain must have two rotors."""
        section.allow('chain', 'kick')
        chain = chain_from(section.section('chain'))
        if chain.number_of_rotors != 2:
            raise section.section('chain').complaint(
                'number_of_rotors', 'must be 2, those of a unit cell; film a cycle for more'
            )
        return Cell(chain, section.number('kick', 1e-6, 100.0))


class CellScene(Scene):
    """One cycle of a unit cell of a rigid bar, beside its place on the torus of both angles."""

    def __init__(self, title: str, motion: Cell, shape: Format) -> None:
        """Trace the configuration space and draw the first frame."""
        chain = motion.chain
        curves = configuration_curves(chain, _SMOOTH)
        arc = float(np.linalg.norm(np.diff(curves[0], axis=0), axis=1).sum())
        rate = motion.kick * chain.spacing / (chain.rotor_length * chain.time_unit)
        subtitle = f'{describe(chain)}, rigid bar, v₀ = {motion.kick:g} a√(kₑ/M)'
        super().__init__(title, subtitle, shape, arc / rate, chain.time_unit)
        shares = np.linspace(0, _SMOOTH, shape.frames)
        self.cell = np.column_stack(
            [np.interp(shares, np.arange(_SMOOTH + 1), angles) for angles in curves[0].T]
        )
        high = TOP - BOTTOM - 0.02
        left = self.figure.add_axes((0.03, BOTTOM, 0.44, high))
        right = self.figure.add_axes((0.53, BOTTOM, 0.45, high - 0.02))
        self._picture = _cell_picture(left, chain, staggered(self.cell[0]))
        draw_torus(right, chain, curves)
        right.set(xlabel='θ₁ = φ₁ [rad]', ylabel='θ₂ = π − φ₂ [rad]')
        self.figure.legend(loc='lower center', bbox_to_anchor=(0.25, 0.05), ncols=2, frameon=False)
        right.set_title('configurations that keep the length of the bar')
        (self._trail,) = right.plot([], [], color=GREY, linewidth=7, alpha=0.45, zorder=1)
        (self._point,) = right.plot(
            [], [], 'o', color=BLACK, markersize=14, clip_on=False, zorder=6
        )
        self.add_moving([*self._picture.artists, self._trail, self._point])
        self.show(0)

    def _move(self, frame: int) -> None:
        angles = self.cell[frame]
        self._picture.update(staggered(angles))
        self._trail.set_data(*broken_at_turns(self.cell[: frame + 1]).T)
        self._point.set_data(*broken_at_turns(angles[None]).T)


def _cell_picture(axes: Axes, chain: Chain, angles: Array) -> ChainPicture:
    """Draw two rotors, a rigid bar and the circles that the masses keep to."""
    for number, (x, _) in enumerate(pivot_points(chain), start=1):
        circle = Circle((x, 0), chain.rotor_length, fill=False, edgecolor='0.85', linewidth=1.5)
        axes.add_patch(circle)
        below = -chain.rotor_length - 0.06 * chain.spacing
        axes.text(x, below, f'rotor {number}', ha='center', va='top', color='0.35')
    return ChainPicture(axes, chain, angles, rigid=True)


@dataclass(frozen=True)
class Staggering:
    """A kicked linkage whose rotors lie in planes one behind the other."""

    motion: KickedWall
    depth: float
    """From each rotor to the bar behind it, in units of a."""
    turn: float
    """Of the camera during the film [rad]."""

    @staticmethod
    def read(section: Section) -> Staggering:
        """Read the settings, the duration in time units sqrt(M / k_e)."""
        section.allow('chain', 'kick', 'duration', 'depth', 'turn')
        depth = section.number('depth', 0.01, 10.0)
        turn = section.number('turn', -10.0, 10.0)
        rest = {key: section.values[key] for key in section.values if key not in ('depth', 'turn')}
        return Staggering(KickedWall.read(replace(section, values=rest)), depth, turn)


class StaggeredScene(Scene):
    """Rigid bars and rotors that turn past each other, seen by a camera that turns as well.

    Beneath them is their space-time picture.
    """

    def __init__(self, title: str, settings: Staggering, shape: Format) -> None:
        """Simulate the motion and draw its first frame."""
        motion = settings.motion
        chain = motion.chain
        subtitle = f'{motion.describe()}, rigid bars'
        super().__init__(title, subtitle, shape, motion.duration, chain.time_unit)
        rest = chain.uniform_state(1)
        rates = kick_rates(chain, rest, motion.kick)
        simulation = RigidSimulation(chain, rest, rates, self.period, _TOLERANCE)
        self.angles = simulation.record(motion.duration).angles
        self._chain, self._layer = chain, settings.depth * chain.spacing
        self._azimuths = _AZIMUTH + np.linspace(0, settings.turn, shape.frames)
        self._axes = self._add_axes()
        self._add_legend()
        self._bodies = LineCollection([[(0, 0), (0, 0)]], capstyle='round')
        self._bodies.set_clip_on(False)
        self._axes.add_collection3d(self._bodies)
        below = self.figure.add_axes((LEFT, BOTTOM, WIDTH, 0.19))
        self._space_time = SpaceTime(below, chain, self.angles, motion.duration)
        self.add_moving([self._axes, *self._space_time.moving])
        self.show(0)

    def _move(self, frame: int) -> None:
        azimuth = float(self._azimuths[frame])
        bodies = layered(self._chain, self.angles[frame], self._layer)
        order = from_behind(bodies, azimuth, _ELEVATION)
        widths, colours = self._looks()
        # A white border beneath each body shows which of two that cross is nearer.
        self._bodies.set_segments(list(np.repeat(bodies[order], 2, axis=0)))
        thicknesses = np.column_stack([widths[order] + 3, widths[order]])
        self._bodies.set_linewidth(thicknesses.ravel().tolist())
        shown = [shade for body in order for shade in ('white', colours[body])]
        self._bodies.set_color(shown)
        self._axes.view_init(elev=math.degrees(_ELEVATION), azim=math.degrees(azimuth))
        self._space_time.show(frame)

    def _looks(self) -> tuple[Array, list[str]]:
        """Line widths [points] and colours of the bodies, in the order of `layered`."""
        rotors, bars = self._chain.number_of_rotors, self._chain.number_of_springs
        counts = [rotors, rotors, rotors, bars]
        widths = np.repeat([width for _, _, width in _BODIES], counts)
        colours = [
            colour
            for (_, colour, _), count in zip(_BODIES, counts, strict=True)
            for _ in range(count)
        ]
        return widths, colours

    def _add_legend(self) -> None:
        lines = [Line2D([], [], color=colour, linewidth=width) for _, colour, width in _BODIES]
        names = [name for name, _, _ in _BODIES]
        self.figure.legend(
            lines,
            names,
            loc='upper right',
            bbox_to_anchor=(0.99, 0.905),
            ncols=len(names),
            frameon=False,
        )

    def _add_axes(self) -> Any:
        axes: Any = self.figure.add_axes((0.0, 0.17, 1.0, 0.9), projection='3d')
        left, right, bottom, top = limits(self._chain)
        deep = 2 * self._layer * self._chain.number_of_rotors
        axes.set(xlim=(left, right), ylim=(-self._layer, deep), zlim=(bottom, top))
        axes.set_box_aspect((right - left, deep + self._layer, top - bottom), zoom=_ZOOM)
        axes.set_proj_type('ortho')
        axes.set_axis_off()
        axes.patch.set_visible(False)
        return axes


def layered(chain: Chain, angles: Array, layer: float) -> Array:
    """Ends of rotors, axles, pins and bars [m], shape (3 N + springs, 2, 3), in that order.

    Rotor n is in the plane y = 2 n layer, and the bar from it to the next in that half way
    between both; the pins reach from plane to plane. No two bodies share a plane but where they
    are joined, so that no angles make them collide.
    """
    pivots, masses = pivot_points(chain), mass_points(chain, angles)
    planes: Array = np.linspace(0.0, 2 * layer * chain.number_of_springs, len(pivots))

    def points(flat: Array, depths: Array) -> Array:
        return np.column_stack([flat[:, 0], depths, flat[:, 1]])

    between = planes[:-1] + layer
    starts_and_ends = (
        (points(pivots, planes), points(masses, planes)),
        (points(pivots, planes - layer / 2), points(pivots, planes + layer / 2)),
        (points(masses, planes - layer), points(masses, planes + layer)),
        (points(masses[:-1], between), points(masses[1:], between)),
    )
    return np.concatenate([np.stack(pair, axis=1) for pair in starts_and_ends])


def from_behind(bodies: Array, azimuth: float, elevation: float) -> list[int]:
    """Order in which to paint bodies, shape (K, 2, 3), for a camera at two angles [rad]."""
    towards = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    return [int(body) for body in np.argsort(bodies.mean(axis=1) @ towards, kind='stable')]
