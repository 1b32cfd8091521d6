# SPDX-License-Identifier: Apache-2.0
"""Scenes of films: figures whose artists move from frame to frame."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from soliton_linkage.linkage.chain import Array, Chain, Motion, displacement, staggered
from soliton_linkage.solitons.continuum import FlipperTheory, SpinnerTheory
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage_studies.drawing import limits, show_leans
from soliton_linkage_studies.palette import BLACK, BLUE, DARK, GREY, PALE, WHITE
from soliton_linkage_studies.program import Registry

INCHES_HIGH = 7.2
"""Height of every figure [inches]; the font sizes are chosen for this height."""
STYLE: Any = {
    'font.size': 12.5,
    'axes.titlesize': 12.5,
    'axes.titlelocation': 'left',
    'text.hinting': 'no_hinting',
}
"""Settings of matplotlib; without hinting, text has the same proportions at any resolution."""
LEFT, WIDTH, BOTTOM, TOP = 0.07, 0.90, 0.085, 0.88
"""Area for the panels below the title, as fractions of the figure width and height [1]."""

TOLERANCE = 1e-9
"""Largest integration error of an angle per time unit [rad]; such errors are invisible in a
film."""

SPACE_TIME = (
    'The space-time diagram shows the displacement u, with one row for each past frame and one '
    'column for each rotor. A colour darker than at rest marks a rotor that overshoots its rest '
    'angle.'
)
_GAP = 0.06
"""Vertical gap between axes [figure heights]."""


@dataclass(frozen=True)
class Format:
    """Number, rate and size of the frames of a film."""

    frames: int
    frame_rate: float
    """Frames per second."""
    width: int
    """Width of a frame [pixels], an even number."""
    height: int
    """Height of a frame [pixels], an even number."""

    @property
    def resolution(self) -> float:
        """Resolution of the figure [pixels per inch]."""
        return self.height / INCHES_HIGH


class Scene(ABC):
    """Figure with title and clock; `show` moves its artists, `paint` returns a frame's pixels."""

    caption: ClassVar[str] = ''
    """Explanation of the symbols, lines and colours that have no label in the film."""
    settings: ClassVar[Any]
    """Class of the settings of a film, which the constructor of a subclass receives as the
    argument `motion`. The method `read` of this class creates the settings from a `Section`."""

    def __init__(
        self, title: str, subtitle: str, shape: Format, duration: float, time_unit: float
    ) -> None:
        """Prepare frames at equally spaced times from 0 to `duration` [s], both included.

        The clock shows the time in seconds and in units of `time_unit` = sqrt(M / k_e) [s].
        """
        self._time_unit = time_unit
        self.headline = f'{title}: {subtitle}.'
        """Title and subtitle of the film in one line."""
        self.times = np.linspace(0.0, duration, shape.frames)
        size = (shape.width / shape.resolution, INCHES_HIGH)
        self.figure = Figure(figsize=size, dpi=shape.resolution, facecolor=WHITE)
        self._canvas: Any = FigureCanvasAgg(self.figure)
        self.figure.text(0.02, 0.95, title, fontsize=18, fontweight='bold')
        pace = duration * shape.frame_rate / (shape.frames - 1)
        speed = f'{pace:.3g} × faster' if pace > 1 else f'{1 / pace:.3g} × slower'
        self.figure.text(0.02, 0.912, f'{subtitle}, shown {speed}', color=DARK)
        self._clock = self.figure.text(0.98, 0.912, '', color=DARK, ha='right')
        self._moving: list[Artist] = [self._clock]
        self._still: Any = None

    @property
    def period(self) -> float:
        """Simulated time between frames [s]."""
        return float(self.times[1])

    def show(self, frame: int) -> None:
        """Move all artists to their positions in a frame, counted from 0."""
        time = self.times[frame]
        self._clock.set_text(f't = {time:.2f} s = {time / self._time_unit:.1f} √(M/kₑ)')
        self._move(frame)

    def paint(self, frame: int) -> memoryview:
        """Return the RGBA pixels of a frame, top row first.

        Artists that `add_moving` has not registered are drawn once; all frames reuse their pixels.
        """
        self.show(frame)
        if self._still is None:
            for artist in self._moving:
                artist.set_animated(True)
            self._canvas.draw()
            self._still = self._canvas.copy_from_bbox(self.figure.bbox)
        self._canvas.restore_region(self._still)
        for artist in self._moving:
            self.figure.draw_artist(artist)
        return memoryview(self._canvas.buffer_rgba())

    def add_moving(self, artists: Iterable[Artist]) -> None:
        """Register artists that `_move` changes, in the order from back to front."""
        self._moving.extend(artists)

    @abstractmethod
    def _move(self, frame: int) -> None:
        """Move the artists to a frame."""


class SpaceTime:
    """Space-time diagram of the displacement u; a cover hides all frames after the current one."""

    def __init__(self, axes: Axes, chain: Chain, angles: Array, duration: float) -> None:
        """Draw the whole diagram from angles [rad], shape (frames, N), over a duration [s]."""
        half, last = chain.spacing / 2, float(chain.pivots[-1])
        show_leans(axes, chain, displacement(chain, angles), (-half, last + half, 0, duration))
        self.cover = Rectangle((-half, 0), last + 2 * half, duration, color=WHITE, zorder=2)
        axes.add_patch(self.cover)
        self._duration, self._frames = duration, len(angles)
        axes.set(xlabel='x [m]', ylabel='t [s]')
        axes.set_title('u in space and time: purple leans right, orange leans left')
        self.moving = [self.cover, *axes.spines.values()]

    def show(self, frame: int) -> None:
        """Uncover the diagram up to and including a frame."""
        now = self._duration * (frame + 1) / self._frames
        self.cover.set(y=now, height=self._duration - now)


class ProfilePanel:
    """Panel with the displacement profile u(x) of a chain and the theory of a wall at rest."""

    def __init__(self, axes: Axes, chain: Chain) -> None:
        self._chain = chain
        self._positions = chain.pivots
        self._fine = np.linspace(self._positions[0], self._positions[-1], 400)
        lines = [('-', BLACK, 'theory')]
        dots = [(BLUE, 'rotors'), (BLUE, None)]
        if chain.motion is Motion.SPINNER:
            lines = [('-', BLACK, 'theory, even'), ('--', GREY, 'theory, odd')]
            dots = [(BLUE, 'even rotors'), (WHITE, 'odd')]
        self.theory = [
            axes.plot([], [], line, color=colour, linewidth=2, label=name)[0]
            for line, colour, name in lines
        ]
        self.rotors = [
            axes.plot([], [], 'o', color=BLUE, markerfacecolor=face, markersize=7, label=name)[0]
            for face, name in dots
        ]
        most = 110 * chain.rotor_length
        axes.axhline(0, color=PALE, zorder=0)
        title = 'u = r sin φ of each rotor, and theory of a wall at rest'
        axes.set(ylim=(-most, most), ylabel='u [cm]', title=title)
        axes.tick_params(labelbottom=False)
        place: Any = {'loc': 'lower right', 'bbox_to_anchor': (1.0, 0.98)}
        axes.legend(ncols=4, frameon=False, fontsize=11.5, **place)
        self.moving = [*self.theory, *self.rotors]

    def show(self, angles: Array) -> None:
        """Show angles [rad], shape (N,), and the theory of the wall if the chain has one wall."""
        lean = displacement(self._chain, angles)
        for parity, markers in enumerate(self.rotors):
            markers.set_data(self._positions[parity::2], 100 * lean[parity::2])
        walls = find_solitons(self._chain, angles)
        wall = walls[0].position if len(walls) == 1 else math.nan
        for parity, line in enumerate(self.theory):
            profile = static_profile(self._chain, angles, wall, self._fine, parity)
            line.set_data(self._fine, 100 * profile)


def static_profile(
    chain: Chain, angles: Array, wall: float, positions: Array, parity: int = 0
) -> Array:
    """Return the displacement u [m] of a wall at rest in the continuum theory, at positions x [m].

    The wall is a kink: rotors to its left lean right, and rotors to its right lean left. It has
    the position X = `wall` [m] and the width w [m]. For flippers, u = -r sin(theta_bar) tanh((x -
    X) / w). For spinners, u = r sin(theta) with theta = theta_bar + s p arccos(-tanh((x - X) /
    w)). Here p is 1 for even rotors (`parity` 0) and -1 for odd rotors. The sign s is the
    direction in which the wall turns the rotors; it is determined from `angles` [rad], (N,).
    """
    if chain.motion is not Motion.SPINNER:
        return FlipperTheory(chain).displacements(positions, wall)
    turned = np.sin(staggered(angles) - chain.rest_angle)
    sense = 1 if turned[0::2].sum() >= turned[1::2].sum() else -1
    theta = SpinnerTheory(chain).staggered_angles(positions, parity, wall, turn=sense)
    return np.asarray(chain.rotor_length * np.sin(theta))


def stacked(figure: Figure, chain: Chain, shares: tuple[float, ...]) -> list[Axes]:
    """Return axes for a chain drawn to scale, and for panels below it with the same x range.

    `shares` are the relative heights of the panels.
    """
    left, right, bottom, top = limits(chain, projections=True)
    wide, high = (float(length) for length in figure.get_size_inches())
    height = (top - bottom) / (right - left) * WIDTH * wide / high
    most = 0.42 * (TOP - BOTTOM)
    spare = max(height / most - 1, 0) * (right - left) / 2
    height = min(height, most)
    edge = TOP - height
    axes = [figure.add_axes((LEFT, edge, WIDTH, height))]
    free = edge - BOTTOM - _GAP * len(shares)
    for share in shares:
        part = free * share / sum(shares)
        edge -= _GAP + part
        axes.append(figure.add_axes((LEFT, edge, WIDTH, part)))
        axes[-1].set_xlim(left - spare, right + spare)
    return axes


FILM_KINDS: Registry[type[Scene]] = Registry()
"""Class of the scene for each kind of film."""
