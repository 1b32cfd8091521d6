# SPDX-License-Identifier: Apache-2.0
"""Films of the zero mode, of chains driven below and above the band gap, and of a unit cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.patches import Circle

from soliton_linkage.linear.bands import gap, penetration_depth
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage_studies import drawing
from soliton_linkage_studies.films import scenes
from soliton_linkage_studies.palette import BLACK, BLUE, DARK, GREEN, GREY, PALE, RED
from soliton_linkage_studies.settings import Section, setting
from soliton_linkage_studies.unit_cell import configuration_curves


@dataclass(frozen=True)
class Insulation:
    """Settings of a film of the zero mode, and of rotor 0 driven at two frequencies."""

    chain: Chain
    duration: float
    """Duration of the motion [s]."""
    swing: float = setting('amplitude of zero mode and of driven rotor', 'rad', 1e-3, 0.5)
    drives: tuple[float, ...] = setting('frequencies of both drives / gap', '1', 0.01, 100.0)

    @staticmethod
    def read(section: Section) -> Insulation:
        """Read the settings. In the file the duration is in time units sqrt(M / k_e)."""
        chain = section.chain()
        duration = section.number('duration', 1e-3, 1e6) * chain.time_unit
        values = section.values_of(Insulation, 'chain', 'duration')
        if len(values['drives']) != 2:
            raise section.error('drives', 'must be two numbers; give one below 1 and one above')
        return Insulation(chain, duration, **values)


@scenes.FILM_KINDS.add('insulator')
class InsulatorScene(scenes.Scene):
    """Scene of three right-leaning chains: zero mode, drive in the gap, drive above the gap."""

    caption = f"""
    {drawing.LINKAGE} Dashed red lines are springs; {drawing.MODE}.

    Bottom: amplitude of each rotor in the three motions against its position, on a logarithmic
    scale. The green line decays by a factor of e per penetration depth ℓ from the last rotor.
    """
    settings = Insulation

    def __init__(self, title: str, motion: Insulation, shape: scenes.Format) -> None:
        chain = motion.chain
        super().__init__(
            title, drawing.description(chain), shape, motion.duration, chain.time_unit
        )
        mode = zero_mode(chain, chain.uniform_state(1))
        mode *= motion.swing / mode[np.argmax(np.abs(mode))]
        driving = [drive * gap(chain) for drive in motion.drives]
        self._frequencies = [2 * math.pi * 4 / motion.duration, *driving]
        driven_motions = (motion.swing * driven(chain, each) for each in driving)
        self._swings = [mode.astype(complex), *driven_motions]
        below, above = (f'{drive:g} of the gap frequency' for drive in motion.drives)
        texts = (
            'the zero mode at the right edge stretches no spring and needs no force '
            '(arrows: velocities of the masses)',
            f'first rotor driven at {below}: no wave has this frequency, the motion decays',
            f'first rotor driven at {above}: a wave carries the motion along the chain',
        )
        self._pictures = self._add_chains(chain, mode, texts)
        self._add_swings(chain, motion)
        self.add_moving(artist for picture in self._pictures for artist in picture.artists)
        self.show(0)

    def _move(self, frame: int) -> None:
        chain = self._pictures[0].chain
        rest = chain.uniform_state(1)
        time = self.times[frame]
        for number, picture in enumerate(self._pictures):
            turn = np.exp(1j * self._frequencies[number] * time)
            angles = rest + np.imag(self._swings[number] * turn)
            picture.update(angles, zero_mode(chain, rest) if number == 0 else None)

    def _add_chains(
        self, chain: Chain, mode: Array, texts: tuple[str, ...]
    ) -> list[drawing.ChainPicture]:
        rest = chain.uniform_state(1)
        pictures = []
        height = 0.135
        for row, text in enumerate(texts):
            low = scenes.TOP - 0.04 - (row + 1) * height - row * 0.04
            axes = self.figure.add_axes((scenes.LEFT, low, scenes.WIDTH, height))
            axes.set_title(f'{row + 1}  {text}', y=0.97)
            moving = None if row else mode
            pictures.append(
                drawing.ChainPicture(axes, chain, rest, moving, arrow_length=chain.spacing)
            )
        return pictures

    def _add_swings(self, chain: Chain, motion: Insulation) -> None:
        left, right, *_ = drawing.limits(chain)
        axes = self.figure.add_axes((scenes.LEFT, scenes.BOTTOM, scenes.WIDTH, 0.2))
        positions = chain.pivots
        names = ('1  zero mode', '2  driven in the gap', '3  driven above it')
        for swings, name, colour, marker in zip(
            self._swings, names, (GREEN, RED, BLUE), 'o^s', strict=True
        ):
            axes.semilogy(positions, np.abs(swings), marker, color=colour, label=name)
        decay = np.exp((positions - positions[-1]) / penetration_depth(chain))
        axes.semilogy(positions, motion.swing * decay, '-', color=GREEN, label='exp(−distance/ℓ)')
        axes.set(xlim=(left, right), ylim=(1e-5, 3 * motion.swing))
        axes.set(xlabel='x [m]', ylabel='amplitude [rad]')
        axes.legend(loc='lower center', bbox_to_anchor=(0.5, 0.98), ncols=4, frameon=False)


def driven(chain: Chain, frequency: float) -> Array:
    """Return the steady response of the right-leaning chain to a torque on rotor 0, shape (N,).

    The complex amplitudes x obey (K - omega^2 I + i omega damping) x = torque with omega =
    `frequency` [rad/s], stiffness matrix K and moments of inertia I. The returned amplitudes are
    divided by the amplitude of rotor 0.
    """
    stiffness = stiffness_matrix(chain, chain.uniform_state(1)).toarray()
    inertia = np.diag(-(frequency**2) * chain.moments_of_inertia + 1j * frequency * chain.dampings)
    motion = np.linalg.solve(stiffness + inertia, np.eye(chain.number_of_rotors)[0])
    return np.asarray(motion / motion[0])


_SMOOTH = 800
"""Number of segments of a drawn curve [1], so that no segment is longer than a pixel."""


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


@scenes.FILM_KINDS.add('unit_cell')
class CellScene(scenes.Scene):
    """Scene of a moving unit cell, drawn as a linkage and as a point in configuration space."""

    caption = f"""
    {drawing.LINKAGE} The red line is a rigid bar; pale circles are the paths of the masses.

    Right: configuration space of the unit cell over both staggered angles, for a constant length
    of the bar. Both angles are periodic, so opposite sides of the square are identical. The
    component that contains the motion is blue. If a second component exists, it is pink. Triangles
    mark the uniform states. The black dot is the configuration on the left; the wide grey line
    is its past path.
    """
    settings = Cell

    def __init__(self, title: str, motion: Cell, shape: scenes.Format) -> None:
        chain = motion.chain
        curves = configuration_curves(chain, _SMOOTH)
        arc = float(np.linalg.norm(np.diff(curves[0], axis=0), axis=1).sum())
        rate = motion.kick * chain.spacing / (chain.rotor_length * chain.time_unit)
        subtitle = f'{drawing.description(chain)}, rigid bar, v₀ = {motion.kick:g} a√(kₑ/M)'
        super().__init__(title, subtitle, shape, arc / rate, chain.time_unit)
        shares, steps = np.linspace(0, _SMOOTH, shape.frames), np.arange(_SMOOTH + 1)
        self.cell = np.column_stack([np.interp(shares, steps, angles) for angles in curves[0].T])
        high = scenes.TOP - scenes.BOTTOM - 0.02
        left = self.figure.add_axes((0.03, scenes.BOTTOM, 0.44, high))
        right = self.figure.add_axes((0.53, scenes.BOTTOM, 0.45, high - 0.02))
        for number, (x, _) in enumerate(drawing.pivot_points(chain), start=1):
            look: Any = {'fill': False, 'edgecolor': PALE, 'linewidth': 1.5}
            left.add_patch(Circle((x, 0), chain.rotor_length, **look))
            below = -chain.rotor_length - 0.06 * chain.spacing
            left.text(x, below, f'rotor {number}', ha='center', va='top', color=DARK)
        self._picture = drawing.ChainPicture(left, chain, staggered(self.cell[0]), rigid=True)
        drawing.draw_torus(right, chain, curves)
        right.set(xlabel='θ₁ = φ₁ [rad]', ylabel='θ₂ = π − φ₂ [rad]')
        self.figure.legend(loc='lower center', bbox_to_anchor=(0.25, 0.05), ncols=2, frameon=False)
        right.set_title('configurations that keep the length of the bar')
        (self._trail,) = right.plot([], [], color=GREY, linewidth=7, alpha=0.45, zorder=1)
        look = {'color': BLACK, 'markersize': 14, 'clip_on': False}
        (self._point,) = right.plot([], [], 'o', zorder=6, **look)
        self.add_moving([*self._picture.artists, self._trail, self._point])
        self.show(0)

    def _move(self, frame: int) -> None:
        angles = self.cell[frame]
        self._picture.update(staggered(angles))
        self._trail.set_data(*drawing.split_at_wraps(self.cell[: frame + 1]).T)
        self._point.set_data(*drawing.split_at_wraps(angles[None]).T)
