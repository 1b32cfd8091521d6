# SPDX-License-Identifier: Apache-2.0
"""Films of a wall: a full cycle, drawn flat or in three dimensions, and a tilted linkage."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage_studies import drawing
from soliton_linkage_studies.experiments import kick_rates
from soliton_linkage_studies.films import scenes
from soliton_linkage_studies.palette import BLACK, BLUE, GREY, RED, WHITE
from soliton_linkage_studies.settings import Section, setting

_AZIMUTH = math.radians(-75)
"""Initial azimuth of the camera [rad]; from the front, rotors would hide their bars."""
_ELEVATION = math.radians(22)
"""Elevation of the camera above the axles [rad]."""
_BODIES = (
    ('rotors', BLACK, 6.0),
    ('axles on the frame', GREY, 5.0),
    ('pins, the masses', BLUE, 8.0),
    ('bars', RED, 4.0),
)
"""Names, colours and line widths [points] of the bodies that `layered` returns."""


@dataclass(frozen=True)
class KickedWall:
    """Settings of a motion that begins with a kick of the wall at the last rotor."""

    chain: Chain
    duration: float
    """Duration of the motion [s]."""
    kick: float = setting('norm of the velocities r phi_dot', 'a sqrt(k_e / M)', 1e-6, 100.0)

    @classmethod
    def read(cls, section: Section) -> Any:
        """Read the settings. In the file the duration is in time units sqrt(M / k_e)."""
        chain = section.chain()
        duration = section.number('duration', 1e-3, 1e6) * chain.time_unit
        return cls(chain, duration, **section.values_of(cls, 'chain', 'duration'))

    def describe(self) -> str:
        """Return a one-line description of the chain and of the kick."""
        return f'{drawing.description(self.chain)}, v₀ = {self.kick:g} a√(kₑ/M)'


@scenes.FILM_KINDS.add('cycle')
class CycleScene(scenes.Scene):
    """Scene of a kicked chain of springs, with its zero mode, profile and space-time diagram."""

    caption = f"""
    {drawing.LINKAGE} Dashed red lines are springs; {drawing.MODE}. {drawing.PROJECTIONS}

    Middle: displacement u of each rotor against its position (dots). If the chain has one wall,
    the line shows the continuum theory of a wall at rest at the same position. For a spinner, even
    rotors have filled dots and the solid line; odd rotors have hollow dots and the dashed line.
    The pale line is u = 0.
    {scenes.SPACE_TIME}
    """
    settings = KickedWall

    def __init__(self, title: str, motion: KickedWall, shape: scenes.Format) -> None:
        chain = motion.chain
        super().__init__(title, motion.describe(), shape, motion.duration, chain.time_unit)
        rest = chain.uniform_state(1)
        rates = kick_rates(chain, rest, motion.kick)
        simulation = ElasticSimulation(chain, rest, rates, self.period, scenes.TOLERANCE)
        self.angles = simulation.record(motion.duration).angles
        above, middle, below = scenes.stacked(self.figure, chain, (0.45, 0.55))
        mode = zero_mode(chain, rest)
        self._picture = drawing.ChainPicture(above, chain, rest, mode, projections=True)
        self._profile = scenes.ProfilePanel(middle, chain)
        self._space_time = scenes.SpaceTime(below, chain, self.angles, motion.duration)
        self.add_moving([*self._picture.artists, *self._profile.moving, *self._space_time.moving])
        self.show(0)

    def _move(self, frame: int) -> None:
        angles = self.angles[frame]
        self._picture.update(angles, zero_mode(self._picture.chain, angles))
        self._profile.show(angles)
        self._space_time.show(frame)


@dataclass(frozen=True)
class Staggering(KickedWall):
    """Settings of a kicked linkage whose rotors and bars lie in separate planes."""

    depth: float = setting('distance of a rotor plane from the bar behind it', 'a', 0.01, 10.0)
    turn: float = setting("change of the camera's azimuth during the film", 'rad', -10.0, 10.0)


@scenes.FILM_KINDS.add('staggered')
class StaggeredScene(scenes.Scene):
    """Scene of a three-dimensional linkage, whose rotors and bars lie in separate planes."""

    caption = f"""
    Each rotor and each bar lies in a separate plane. Where two bodies cross, the nearer one has a
    white border. The legend in the film explains the colours. {scenes.SPACE_TIME}
    """
    settings = Staggering

    def __init__(self, title: str, motion: Staggering, shape: scenes.Format) -> None:
        chain = motion.chain
        subtitle = f'{motion.describe()}, rigid bars'
        super().__init__(title, subtitle, shape, motion.duration, chain.time_unit)
        rest = chain.uniform_state(1)
        rates = kick_rates(chain, rest, motion.kick)
        simulation = RigidSimulation(chain, rest, rates, self.period, scenes.TOLERANCE)
        self.angles = simulation.record(motion.duration).angles
        self._chain, self._layer = chain, motion.depth * chain.spacing
        self._azimuths = _AZIMUTH + np.linspace(0, motion.turn, shape.frames)
        counts = [chain.number_of_rotors] * 3 + [chain.number_of_springs]
        self._colours = [
            colour
            for (_, colour, _), count in zip(_BODIES, counts, strict=True)
            for _ in range(count)
        ]
        self._widths = np.repeat([width for *_, width in _BODIES], counts)
        self._axes = self._add_axes()
        self._add_legend()
        self._bodies = LineCollection([[(0, 0), (0, 0)]], capstyle='round')
        self._bodies.set_clip_on(False)
        self._axes.add_collection3d(self._bodies)
        below = self.figure.add_axes((scenes.LEFT, scenes.BOTTOM, scenes.WIDTH, 0.19))
        self._space_time = scenes.SpaceTime(below, chain, self.angles, motion.duration)
        self.add_moving([self._axes, *self._space_time.moving])
        self.show(0)

    def _move(self, frame: int) -> None:
        azimuth = float(self._azimuths[frame])
        bodies = layered(self._chain, self.angles[frame], self._layer)
        order = from_behind(bodies, azimuth, _ELEVATION)
        widths, colours = self._widths, self._colours
        # The white border behind each body shows which of two crossing bodies is nearer.
        self._bodies.set_segments(list(np.repeat(bodies[order], 2, axis=0)))
        thicknesses = np.column_stack([widths[order] + 3, widths[order]])
        self._bodies.set_linewidth(thicknesses.ravel().tolist())
        shown = [shade for body in order for shade in (WHITE, colours[body])]
        self._bodies.set_color(shown)
        self._axes.view_init(elev=math.degrees(_ELEVATION), azim=math.degrees(azimuth))
        self._space_time.show(frame)

    def _add_legend(self) -> None:
        lines = [
            Line2D([], [], color=colour, linewidth=width, label=name)
            for name, colour, width in _BODIES
        ]
        place: Any = {'loc': 'upper right', 'bbox_to_anchor': (0.99, 0.905)}
        self.figure.legend(handles=lines, ncols=len(lines), frameon=False, **place)

    def _add_axes(self) -> Any:
        axes: Any = self.figure.add_axes((0.0, 0.17, 1.0, 0.9), projection='3d')
        left, right, bottom, top = drawing.limits(self._chain)
        deep = 2 * self._layer * self._chain.number_of_rotors
        axes.set(xlim=(left, right), ylim=(-self._layer, deep), zlim=(bottom, top))
        axes.set_box_aspect((right - left, deep + self._layer, top - bottom), zoom=1.9)
        axes.set_proj_type('ortho')
        axes.set_axis_off()
        axes.patch.set_visible(False)
        return axes


def layered(chain: Chain, angles: Array, layer: float) -> Array:
    """Return both end points [m] of each body, in the order rotors, axles, pins and bars.

    The result has shape (3 N + number of springs, 2, 3). Rotor n lies in the plane y = 2 n layer
    [m]. Each bar lies halfway between the planes of its two rotors, so that bodies that are not
    joined cannot collide.
    """
    pivots, masses = drawing.pivot_points(chain), drawing.mass_points(chain, angles)
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
    """Return the indices of `bodies`, from the farthest to the nearest.

    A body is a pair of end points [m]. The direction of the camera has the given azimuth and
    elevation [rad].
    """
    nearness = bodies.mean(axis=1) @ drawing.towards_camera(azimuth, elevation)
    return [int(body) for body in np.argsort(nearness, kind='stable')]


@dataclass(frozen=True)
class Tilting:
    """Settings of rigid bars under gravity; the tilt varies linearly between the given times."""

    chain: Chain
    acceleration: float
    """Gravitational acceleration [m/s^2]."""
    times: tuple[float, ...] = setting('times of the tilts, from 0 on', 's', 0.0, 1e4)
    tilts: tuple[float, ...] = setting(
        'tilts; positive: last rotor lower', 'rad', -math.pi, math.pi
    )

    @staticmethod
    def read(section: Section) -> Tilting:
        """Read the settings."""
        values = section.values_of(Tilting, 'chain', 'gravity')
        times, tilts = values['times'], values['tilts']
        if times[0] != 0 or len(times) < 2 or np.min(np.diff(times)) <= 0:
            raise section.error('times', 'must increase from 0; sort them')
        if len(tilts) != len(times):
            raise section.error('tilts', f'must be {len(times)} numbers; give one for each time')
        acceleration = section.number('gravity', 0.0, 1e3, 9.81)
        return Tilting(section.chain(), acceleration, times, tilts)


@scenes.FILM_KINDS.add('tilt')
class TiltScene(scenes.Scene):
    """Scene of a left-leaning linkage that is tilted back and forth under gravity."""

    caption = f"""
    {drawing.LINKAGE} Red lines are rigid bars; {drawing.MODE}. {drawing.PROJECTIONS}

    {scenes.SPACE_TIME} To its right, the grey line is the tilt of the linkage over time and the
    black dot is the current tilt.
    """
    settings = Tilting

    def __init__(self, title: str, motion: Tilting, shape: scenes.Format) -> None:
        chain = motion.chain
        subtitle = f'{drawing.description(chain)}, rigid bars, a little friction'
        super().__init__(title, subtitle, shape, motion.times[-1], chain.time_unit)
        self._tilts = np.interp(self.times, motion.times, motion.tilts)
        self.angles = _fallen(motion, self._tilts, self.period)
        height = 0.48
        above = self.figure.add_axes((scenes.LEFT, scenes.TOP - height, scenes.WIDTH, height))
        rest = self.angles[0]
        self._picture = drawing.ChainPicture(
            above, chain, rest, zero_mode(chain, rest), rigid=True
        )
        _make_room(above, chain, float(np.abs(self._tilts).max()))
        free = scenes.TOP - height - 0.11 - scenes.BOTTOM
        space = self.figure.add_axes((scenes.LEFT, scenes.BOTTOM, 0.6, free))
        self._space_time = scenes.SpaceTime(space, chain, self.angles, motion.times[-1])
        strip = self.figure.add_axes((scenes.LEFT, scenes.BOTTOM + free + 0.04, 0.6, 0.03))
        bottom, top = drawing.limits(chain, projections=True)[2], drawing.limits(chain)[2]
        strip.set(xlim=space.get_xlim(), ylim=(bottom, top), title='u = r sin φ of each rotor')
        strip.set_axis_off()
        self._projections = drawing.projection_quiver(strip, chain, rest)
        tilt = self.figure.add_axes((scenes.LEFT + 0.67, scenes.BOTTOM, scenes.WIDTH - 0.67, free))
        tilt.plot(np.degrees(self._tilts), self.times, color=GREY, linewidth=2)
        tilt.set(xlabel='tilt [°]', ylabel='t [s]', title='left end low | right end low')
        tilt.set(ylim=(0, motion.times[-1]))
        (self._now,) = tilt.plot([], [], 'o', color=BLACK, markersize=9)
        self.add_moving([*self._picture.artists, *self._space_time.moving])
        self.add_moving([self._projections, self._now])
        self.show(0)

    def _move(self, frame: int) -> None:
        angles, tilt = self.angles[frame], float(self._tilts[frame])
        chain = self._picture.chain
        self._picture.update(angles, zero_mode(chain, angles), tilt)
        drawing.move_projections(self._projections, chain, angles)
        self._space_time.show(frame)
        self._now.set_data([math.degrees(tilt)], [self.times[frame]])


def _fallen(motion: Tilting, tilts: Array, period: float) -> Array:
    chain = motion.chain
    start = chain.uniform_state(-1)
    field = Gravity(motion.acceleration, float(tilts[0]))
    simulation = RigidSimulation(chain, start, None, period, scenes.TOLERANCE, field)
    angles = [simulation.angles]
    for tilt in tilts[:-1]:
        simulation.set_gravity(Gravity(motion.acceleration, float(tilt)))
        simulation.advance()
        angles.append(simulation.angles)
    return np.array(angles)


def _make_room(axes: Axes, chain: Chain, tilt: float) -> None:
    left, right, _, top = drawing.limits(chain)
    rise = (right - left) / 2 * math.sin(tilt) + top
    axes.set_ylim(-rise, rise)
    arrow = {'arrowstyle': '-|>', 'linewidth': 2.5, 'mutation_scale': 20, 'color': BLACK}
    look: Any = {'xycoords': 'axes fraction', 'ha': 'center', 'va': 'top', 'arrowprops': arrow}
    axes.annotate('gravity', (0.5, 0.72), (0.5, 1.0), **look)
