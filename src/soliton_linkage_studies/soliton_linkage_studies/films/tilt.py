# SPDX-License-Identifier: Apache-2.0
"""Films of a linkage that is tilted under gravity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.quiver import Quiver

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage_studies.captions import LINKAGE, MODE, PROJECTIONS, description
from soliton_linkage_studies.drawing import (
    ChainPicture,
    limits,
    move_projections,
    projection_quiver,
)
from soliton_linkage_studies.films.scenes import (
    BOTTOM,
    FILM_KINDS,
    LEFT,
    SPACE_TIME,
    TOLERANCE,
    TOP,
    WIDTH,
    Format,
    Scene,
    SpaceTime,
)
from soliton_linkage_studies.palette import BLACK, GREY
from soliton_linkage_studies.settings import Section, setting


@dataclass(frozen=True)
class Tilting:
    """Settings of rigid bars under gravity; the tilt varies linearly between the given times."""

    chain: Chain
    acceleration: float
    """Gravitational acceleration [m/s^2]."""
    times: tuple[float, ...] = setting('times of the tilts, from 0 on', 's', 0.0, 1e4)
    tilts: tuple[float, ...] = setting('tilts; above 0: last rotor low', 'rad', -math.pi, math.pi)

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


@FILM_KINDS.add('tilt')
class TiltScene(Scene):
    """Scene of a left-leaning linkage that is tilted back and forth under gravity."""

    caption = f"""
    {LINKAGE} Red lines are rigid bars; {MODE}. {PROJECTIONS}

    {SPACE_TIME} To its right, the grey line is the tilt of the linkage over time and the black dot
    is the current tilt.
    """
    settings = Tilting

    def __init__(self, title: str, motion: Tilting, shape: Format) -> None:
        chain = motion.chain
        subtitle = f'{description(chain)}, rigid bars, a little friction'
        super().__init__(title, subtitle, shape, motion.times[-1], chain.time_unit)
        self._tilts = np.interp(self.times, motion.times, motion.tilts)
        self.angles = _fallen(motion, self._tilts, self.period)
        height = 0.48
        above = self.figure.add_axes((LEFT, TOP - height, WIDTH, height))
        rest = self.angles[0]
        self._picture = ChainPicture(above, chain, rest, zero_mode(chain, rest), rigid=True)
        _make_room(above, chain, float(np.abs(self._tilts).max()))
        free = TOP - height - 0.11 - BOTTOM
        space = self.figure.add_axes((LEFT, BOTTOM, 0.6, free))
        self._space_time = SpaceTime(space, chain, self.angles, motion.times[-1])
        strip = self.figure.add_axes((LEFT, BOTTOM + free + 0.04, 0.6, 0.03))
        self._projections = _projected(strip, chain, rest, space.get_xlim())
        tilt = self.figure.add_axes((LEFT + 0.67, BOTTOM, WIDTH - 0.67, free))
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
        move_projections(self._projections, chain, angles)
        self._space_time.show(frame)
        self._now.set_data([math.degrees(tilt)], [self.times[frame]])


def _fallen(motion: Tilting, tilts: Array, period: float) -> Array:
    chain = motion.chain
    start = chain.uniform_state(-1)
    field = Gravity(motion.acceleration, float(tilts[0]))
    simulation = RigidSimulation(chain, start, None, period, TOLERANCE, field)
    angles = [simulation.angles]
    for tilt in tilts[:-1]:
        simulation.set_gravity(Gravity(motion.acceleration, float(tilt)))
        simulation.advance()
        angles.append(simulation.angles)
    return np.array(angles)


def _projected(axes: Axes, chain: Chain, angles: Array, along: tuple[float, float]) -> Quiver:
    axes.set(xlim=along, ylim=(limits(chain, projections=True)[2], limits(chain)[2]))
    axes.set_axis_off()
    axes.set_title('u = r sin φ of each rotor')
    return projection_quiver(axes, chain, angles)


def _make_room(axes: Axes, chain: Chain, tilt: float) -> None:
    left, right, _, top = limits(chain)
    rise = (right - left) / 2 * math.sin(tilt) + top
    axes.set_ylim(-rise, rise)
    arrow = {'arrowstyle': '-|>', 'linewidth': 2.5, 'mutation_scale': 20, 'color': BLACK}
    look: Any = {'xycoords': 'axes fraction', 'ha': 'center', 'va': 'top', 'arrowprops': arrow}
    axes.annotate('gravity', (0.5, 0.72), (0.5, 1.0), **look)
