# SPDX-License-Identifier: Apache-2.0
"""Films of whole chains: an insulator, a linkage that is tilted, and walls that run to and fro."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.quiver import Quiver

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.bands import gap, penetration_depth
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.studies.drawing import (
    BLACK,
    BLUE,
    GREEN,
    RED,
    ChainPicture,
    draw_projections,
    limits,
    pivot_points,
)
from soliton_linkage.studies.experiments import kick_rates
from soliton_linkage.studies.films.scenes import (
    BOTTOM,
    LEFT,
    TOP,
    WIDTH,
    Format,
    ProfilePanel,
    Scene,
    SpaceTime,
    describe,
    stacked,
)
from soliton_linkage.studies.settings import Section, chain_from

_TOLERANCE = 1e-9
_SMALLEST_SWING = 1e-5
_WAYS = 4


@dataclass(frozen=True)
class KickedWall:
    """A wall sent through a chain from its last rotor, by a kick along the zero mode."""

    chain: Chain
    kick: float
    """Speed r |phi_dot| in units of a sqrt(k_e / M)."""
    duration: float
    """Of the motion [s]."""

    @staticmethod
    def read(section: Section) -> KickedWall:
        """Read the settings, the duration in time units sqrt(M / k_e)."""
        section.allow('chain', 'kick', 'duration')
        chain = chain_from(section.section('chain'))
        kick = section.number('kick', 1e-6, 100.0)
        duration = section.number('duration', 1e-3, 1e6)
        return KickedWall(chain, kick, duration * chain.time_unit)

    def describe(self) -> str:
        """Return one line with the chain and the kick."""
        return f'{describe(self.chain)}, v₀ = {self.kick:g} a√(kₑ/M)'


class CycleScene(Scene):
    """A kicked chain of springs, its zero mode, its profile and its space-time picture."""

    def __init__(self, title: str, motion: KickedWall, shape: Format) -> None:
        """Simulate the motion and draw its first frame."""
        chain = motion.chain
        super().__init__(title, motion.describe(), shape, motion.duration, chain.time_unit)
        rest = chain.uniform_state(1)
        rates = kick_rates(chain, rest, motion.kick)
        simulation = ElasticSimulation(chain, rest, rates, self.period, _TOLERANCE)
        self.angles = simulation.record(motion.duration).angles
        above, middle, below = stacked(self.figure, chain, (0.45, 0.55))
        mode = zero_mode(chain, rest)
        self._picture = ChainPicture(above, chain, rest, mode, projections=True)
        self._profile = ProfilePanel(middle, chain)
        self._space_time = SpaceTime(below, chain, self.angles, motion.duration)
        for part in (self._picture.artists, self._profile.moving, self._space_time.moving):
            self.add_moving(part)
        self.show(0)

    def _move(self, frame: int) -> None:
        angles = self.angles[frame]
        self._picture.update(angles, zero_mode(self._picture.chain, angles))
        self._profile.show(angles)
        self._space_time.show(frame)


@dataclass(frozen=True)
class Tilting:
    """A linkage of rigid bars under gravity, its tilt going straight from angle to angle."""

    chain: Chain
    times: tuple[float, ...]
    """When the tilts are reached [s], from 0 on."""
    tilts: tuple[float, ...]
    """Of the chain from horizontal, the last rotor lower where positive [rad]."""
    acceleration: float
    """Of gravity [m/s^2]."""

    @staticmethod
    def read(section: Section) -> Tilting:
        """Read the settings, times in [s]."""
        section.allow('chain', 'times', 'tilts', 'gravity')
        times = section.numbers('times', 0.0, 1e4)
        if times[0] != 0 or len(times) < 2 or np.min(np.diff(times)) <= 0:
            raise section.complaint('times', 'must increase from 0; sort them')
        tilts = section.numbers('tilts', -math.pi, math.pi)
        if len(tilts) != len(times):
            raise section.complaint('tilts', f'must be {len(times)} numbers; give one a time')
        acceleration = section.number('gravity', 0.0, 1e3, 9.81)
        return Tilting(chain_from(section.section('chain')), times, tilts, acceleration)


class TiltScene(Scene):
    """A left-leaning linkage that is tilted to and fro, and how its rotors fall."""

    def __init__(self, title: str, motion: Tilting, shape: Format) -> None:
        """Simulate the motion and draw its first frame."""
        chain = motion.chain
        subtitle = f'{describe(chain)}, rigid bars, a little friction'
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
        tilt.plot(np.degrees(self._tilts), self.times, color='0.75', linewidth=2)
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
        leans, _ = chain.positions(angles)
        self._projections.set_UVC(leans, np.zeros_like(leans), leans)
        self._space_time.show(frame)
        self._now.set_data([math.degrees(tilt)], [self.times[frame]])


def _fallen(motion: Tilting, tilts: Array, period: float) -> Array:
    """Angles at each tilt [rad], shape (frames, N), the tilt being held for a period [s]."""
    chain = motion.chain
    start = chain.uniform_state(-1)
    field = Gravity(motion.acceleration, float(tilts[0]))
    simulation = RigidSimulation(chain, start, None, period, _TOLERANCE, field)
    angles = [simulation.angles]
    for tilt in tilts[:-1]:
        simulation.turn_gravity(Gravity(motion.acceleration, float(tilt)))
        simulation.advance()
        angles.append(simulation.angles)
    return np.array(angles)


def _projected(axes: Axes, chain: Chain, angles: Array, along: tuple[float, float]) -> Quiver:
    """Draw u of each rotor between two places along the chain [m], in axes of their own."""
    axes.set(xlim=along, ylim=(limits(chain, projections=True)[2], limits(chain)[2]))
    axes.set_axis_off()
    axes.set_title('u = r sin φ of each rotor')
    return draw_projections(axes, chain, angles)


def _make_room(axes: Axes, chain: Chain, tilt: float) -> None:
    """Widen the limits for a chain that turns about its middle, and draw gravity beside it."""
    left, right, _, top = limits(chain)
    rise = (right - left) / 2 * math.sin(tilt) + top
    axes.set_ylim(-rise, rise)
    axes.annotate(
        'gravity',
        (0.5, 0.72),
        (0.5, 1.0),
        xycoords='axes fraction',
        ha='center',
        va='top',
        arrowprops={'arrowstyle': '-|>', 'linewidth': 2.5, 'mutation_scale': 20, 'color': BLACK},
    )


@dataclass(frozen=True)
class Insulation:
    """Small motions of a chain: its zero mode, and an edge that is driven."""

    chain: Chain
    swing: float
    """Of the rotor that moves most [rad]."""
    drives: tuple[float, ...]
    """Angular frequencies of the drives, in units of the gap."""
    duration: float
    """Of the motion [s]."""

    @staticmethod
    def read(section: Section) -> Insulation:
        """Read the settings, the duration in time units sqrt(M / k_e)."""
        section.allow('chain', 'swing', 'drives', 'duration')
        chain = chain_from(section.section('chain'))
        drives = section.numbers('drives', 0.01, 100.0)
        if len(drives) != 2:
            raise section.complaint('drives', 'must be two numbers; give one each side of 1')
        duration = section.number('duration', 1e-3, 1e6)
        swing = section.number('swing', 1e-3, 0.5)
        return Insulation(chain, swing, drives, duration * chain.time_unit)


class InsulatorScene(Scene):
    """Three copies of the right-leaning chain: the zero mode, a drive in the gap, one above."""

    def __init__(self, title: str, motion: Insulation, shape: Format) -> None:
        """Solve the linear motion and draw its first frame."""
        chain = motion.chain
        super().__init__(title, describe(chain), shape, motion.duration, chain.time_unit)
        mode = zero_mode(chain, chain.uniform_state(1))
        mode *= motion.swing / mode[np.argmax(np.abs(mode))]
        self._frequencies = [2 * math.pi * _WAYS / motion.duration]
        self._frequencies += [drive * gap(chain) for drive in motion.drives]
        self._swings = [mode.astype(complex)]
        self._swings += [
            motion.swing * driven(chain, frequency) for frequency in self._frequencies[1:]
        ]
        below, above = (f'{drive:g} of the gap frequency' for drive in motion.drives)
        texts = (
            'the zero mode, at the right edge, stretches no spring and needs no force: '
            'arrows show where it moves the masses',
            f'first rotor driven at {below}: no wave has this frequency, the motion dies out',
            f'first rotor driven at {above}: a wave carries the motion along the chain',
        )
        self._pictures = self._add_chains(chain, mode, texts)
        self._add_swings(chain, motion)
        for picture in self._pictures:
            self.add_moving(picture.artists)
        self.show(0)

    def _move(self, frame: int) -> None:
        chain = self._pictures[0].chain
        rest = chain.uniform_state(1)
        time = self.times[frame]
        for place, picture in enumerate(self._pictures):
            turn = np.exp(1j * self._frequencies[place] * time)
            angles = rest + np.imag(self._swings[place] * turn)
            picture.update(angles, zero_mode(chain, rest) if place == 0 else None)

    def _add_chains(self, chain: Chain, mode: Array, texts: tuple[str, ...]) -> list[ChainPicture]:
        rest = chain.uniform_state(1)
        pictures = []
        height = 0.135
        for row, text in enumerate(texts):
            low = TOP - 0.04 - (row + 1) * height - row * 0.04
            axes = self.figure.add_axes((LEFT, low, WIDTH, height))
            axes.set_title(f'{row + 1}  {text}', y=0.97)
            pictures.append(
                ChainPicture(axes, chain, rest, None if row else mode, arrow_length=chain.spacing)
            )
        return pictures

    def _add_swings(self, chain: Chain, motion: Insulation) -> None:
        left, right, *_ = limits(chain)
        axes = self.figure.add_axes((LEFT, BOTTOM, WIDTH, 0.2))
        places = pivot_points(chain)[:, 0]
        names = ('1  zero mode', '2  driven in the gap', '3  driven above it')
        for swings, name, colour, marker in zip(
            self._swings, names, (GREEN, RED, BLUE), 'o^s', strict=True
        ):
            axes.semilogy(places, np.abs(swings), marker, color=colour, label=name)
        decay = np.exp((places - places[-1]) / penetration_depth(chain))
        axes.semilogy(places, motion.swing * decay, '-', color=GREEN, label='exp(−distance/ℓ)')
        axes.set(xlim=(left, right), ylim=(_SMALLEST_SWING, 3 * motion.swing))
        axes.set(xlabel='x [m]', ylabel='swing [rad]')
        axes.legend(loc='lower center', bbox_to_anchor=(0.5, 0.98), ncols=4, frameon=False)


def driven(chain: Chain, frequency: float) -> Array:
    """Steady small motion about the right-leaning state, its first rotor driven, shape (N,).

    (K - omega^2 I + i omega damping) x = torque on rotor 0, of the angular frequency omega
    [rad/s]; complex, in units of the motion of rotor 0.
    """
    stiffness = stiffness_matrix(chain, chain.uniform_state(1)).toarray()
    inertia = np.diag(-(frequency**2) * chain.moments_of_inertia + 1j * frequency * chain.dampings)
    motion = np.linalg.solve(stiffness + inertia, np.eye(chain.number_of_rotors)[0])
    return np.asarray(motion / motion[0])
