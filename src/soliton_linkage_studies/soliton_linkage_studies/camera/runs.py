# SPDX-License-Identifier: Apache-2.0
"""Films of ideal and of handmade chains, and the errors of the angles measured in them.

A film consists of pictures. Frame markers are square markers on the fixed frame of the chain; they
define the plane of the chain.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain, wrapped
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.vision.angle_camera import AngleCamera
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.layout import MarkerLayout, MarkerSettings
from soliton_linkage.vision.opencv import opencv
from soliton_linkage.vision.plane import ChainPlane
from soliton_linkage.vision.video import TimedPicture, read_video, write_video
from soliton_linkage_studies.camera.renderer import (
    FilmSettings,
    Hand,
    Motion,
    Renderer,
    posed_plane,
)
from soliton_linkage_studies.experiments import record_kick

_LENS = (1100.0, 1100.0), (641.3, 357.2), (-0.12, 0.05, 5e-4, -3e-4, 0.0)
"""Focal lengths [pixels], principal point [pixels] and distortion [1] of the lens of a phone."""
CAMERA = Camera(1280, 720, *_LENS, row_time=25e-6, exposure=0.004)
"""Camera with the lens and the rolling shutter of a phone."""
PERIOD = 1 / 60
"""Time between successive pictures [s]."""
SIMULATED = 0.002
"""Time between two simulated states of the chain [s]; cubic splines interpolate between them."""
_TILTS = (0.06, -0.09, 0.01)
"""Pan, pitch and roll of the plane of the chain relative to the camera [rad]."""
_FILLED = 1.12
"""Width that a picture shows at the distance of the chain, divided by the length of the chain with
the paper of one frame marker added at each end [1]."""
_SWAPPED = 0.1
"""A measured angle counts as the angle of another rotor if its error is above this [rad]."""
_SETTLING = 10
"""Number of pictures at the start that are not evaluated [1], because the estimate of the chain
plane is still inaccurate."""
_HAND_EVERY, _HAND_FOR = 10.0, 0.7
"""Interval at which a hand covers part of the view, and duration of each cover [s]."""
_TURN = 0.01
"""Step of the central differences that give the derivatives of grey levels with respect to an
angle [rad]."""


@dataclass(frozen=True)
class FilmedTask:
    """Task to render a film and to measure its angles."""

    chain: Chain
    kick: float
    """Norm of the velocities of all masses after the kick, in units of a sqrt(k_e / M) [1]."""
    frames: int
    settings: FilmSettings
    h264: int = 0
    """Rate factor (CRF) of an H.264 video from which the pictures are read; 0 means no video."""

    def __call__(self) -> FilmedRun:
        """Render the film and measure its angles, picture by picture."""
        duration = PERIOD * (self.frames + 2)
        frames = round(duration / SIMULATED)
        whole = frames * SIMULATED / self.chain.time_unit
        motion = interpolate_motion(record_kick(self.chain, self.kick, whole, frames))
        layout = MarkerLayout(self.chain, MarkerSettings(placing_tolerance=0.0))
        plane = chain_plane(layout)
        hands = _hands(duration)
        film = Renderer(layout, plane, motion, self.settings, hands)
        eye = AngleCamera(layout, CAMERA)
        seen, truth, busy = [], [], 0.0
        for taken, picture in self._pictures(film):
            before = time.process_time()
            seen.append(eye.measure(taken, picture))
            busy += time.process_time() - before
            truth.append(motion(np.array([taken + seen[-1].delay]))[0][0])
        angles = np.array([frame.angles for frame in seen])
        stated = np.array([frame.deviations for frame in seen])
        bound = _pixel_bound(self, layout, plane)
        return FilmedRun(angles - np.array(truth), stated, bound, busy / self.frames)

    def _pictures(self, film: Renderer) -> Iterator[TimedPicture]:
        begin = 2 * PERIOD
        times = begin + PERIOD * np.arange(self.frames)
        shots = (TimedPicture(taken, film.picture(taken)) for taken in times.tolist())
        if not self.h264:
            yield from shots
            return
        with TemporaryDirectory() as folder:
            path = Path(folder, 'film.mp4')
            write_video(path, shots, self.h264)
            for taken, picture in read_video(path).pictures:
                yield TimedPicture(begin + taken, picture)


@dataclass(frozen=True)
class FilmedRun:
    """Errors and statistics of the angles measured in a film of F pictures."""

    errors: Array
    """Errors of the unwrapped angles [rad], (F, N); NaN if an angle was not measured."""
    stated: Array
    """Stated standard deviations of the angles [rad], (F, N)."""
    bound: float
    """Cramer-Rao bound of the standard deviation of an angle [rad]. The angle is measured from the
    pixels of the label on the mass, a white paper disc with a coloured dot."""
    busy: float
    """CPU time of the measurement per picture [s]."""

    @property
    def figures(self) -> tuple[float, ...]:
        """Statistics in the order of `FIGURES`."""
        known = np.isfinite(self.errors[_SETTLING:])
        errors, stated = self.errors[_SETTLING:], self.stated[_SETTLING:]
        near = wrapped(errors)
        swapped = known & (np.abs(near) > _SWAPPED)
        right = np.where(swapped, np.nan, near)
        own = right - np.nanmean(right, axis=0)
        hidden = known.size - int(known.sum())
        counts = len(self.errors), known.size, hidden, int(swapped.sum()), _changes(errors)
        of_stated = float(np.sqrt(np.nanmean(stated**2))), float(np.nanstd(own / stated))
        spreads = self.bound, float(np.nanstd(own)), *of_stated
        return *counts, *spreads, float(np.nanmean(right)), self.busy


FIGURES = (
    *('pictures', 'angles', 'hidden', 'swapped', 'turns_lost'),
    *('bound', 'noise', 'stated', 'normalised', 'bias', 'busy'),
)
"""Names of the statistics of a film. `hidden` is the number of angles that were not measured, and
`swapped` the number with an error above `_SWAPPED`. `turns_lost` counts changes of the error by
full turns. `noise` is the standard deviation of the errors [rad], `stated` is the rms of their
stated standard deviations [rad], and `normalised` is the standard deviation of their ratio [1].
`bias` is the mean error [rad]. For `bound` [rad] and `busy` [s], see `FilmedRun`."""


def _changes(errors: Array) -> int:
    turns = np.rint(errors / (2 * np.pi)).T
    known = (of_rotor[np.isfinite(of_rotor)] for of_rotor in turns)
    return sum(int(np.count_nonzero(np.diff(each))) for each in known)


def interpolate_motion(recording: Recording) -> Motion:
    """Return cubic Hermite splines through the angles and rates of a recording."""
    angles = CubicHermiteSpline(recording.times, recording.angles, recording.rates)
    rates, accelerations = angles.derivative(1), angles.derivative(2)
    return lambda times: (angles(times), rates(times), accelerations(times))


def chain_plane(layout: MarkerLayout) -> ChainPlane:
    """Return the plane of a chain at such a distance that the chain nearly fills the picture."""
    length = float(layout.chain.pivots[-1])
    distance = _FILLED * (length + 2 * layout.paper_size) * CAMERA.focal[0] / CAMERA.width
    return posed_plane(CAMERA, (length / 2, 0.0), distance, *_TILTS)


def _hands(duration: float) -> tuple[Hand, ...]:
    begins = np.arange(_HAND_EVERY / 2, duration, _HAND_EVERY).tolist()
    starts = [(150.0 + 370.0 * (number % 3), 250.0) for number in range(len(begins))]
    return tuple(
        Hand(begin, begin + _HAND_FOR, start, (150.0, 150.0), (45.0, 90.0))
        for begin, start in zip(begins, starts, strict=True)
    )


def _pixel_bound(task: FilmedTask, layout: MarkerLayout, plane: ChainPlane) -> float:
    """Return the median over the rotors of the Cramer-Rao bound of an angle [rad].

    With the grey levels I of the pixels of the label on the mass (a white paper disc with a
    coloured dot) and the standard deviation sigma of their noise, the bound of an angle phi is
    sigma / sqrt(sum (dI / dphi)^2).
    """
    cv2 = opencv()
    rest, still = task.chain.uniform_state(1), np.zeros((1, task.chain.number_of_rotors))
    clear = FilmSettings(light=task.settings.light, blur=task.settings.blur, noise=0.0)

    def picture(angles: Array) -> Any:
        film = Renderer(layout, plane, lambda _: (angles, still, still), clear)
        return cv2.cvtColor(film.picture(0.0), cv2.COLOR_BGR2GRAY).astype(float)

    change = (picture((rest + _TURN)[None]) - picture((rest - _TURN)[None])) / (2 * _TURN)
    lengths = task.chain.rotor_lengths[:, None]
    arms = lengths * np.column_stack([np.sin(rest), np.cos(rest)])
    positions = plane.pixels(np.column_stack([task.chain.pivots, 0 * rest]) + arms)
    radius = layout.label_radius * float(np.median(plane.pixels_per_metre(arms)))
    rows, columns = np.indices(change.shape)
    weights = np.array([0.299, 0.587, 0.114])
    noise = task.settings.noise * float(np.sqrt(np.sum(weights**2)))
    shown = (np.hypot(columns - x, rows - y) < radius for x, y in positions.tolist())
    sums = [np.sum(change[each] ** 2) for each in shown]
    return noise / float(np.sqrt(np.median(sums)))


@dataclass(frozen=True)
class BenchParameters:
    """Parameters of a filmed chain: manufacturing deviations, kick and duration."""

    spread: float = quantity(0.05, 'relative standard deviation of every length', '', 0.0, 0.2)
    seed: int = quantity(
        0, 'first random seed of the lengths; later seeds are tried until a wall can pass', '', 0
    )
    kick: float = quantity(
        10.0, 'speed of rotor 0 along the zero mode at the start of the film', 'rad/s', 0.1, 1000.0
    )
    duration: float = quantity(5.0, 'length of the film', 's', 1.0, 3600.0)


@dataclass(frozen=True)
class FilmedBench:
    """Chain with manufacturing deviations; its markers are printed for the ideal chain `plan`."""

    plan: Chain
    markers: MarkerSettings
    parameters: BenchParameters

    @cached_property
    def chain(self) -> Chain:
        """Chain with manufacturing deviations through which a wall can pass."""
        rotors, spread = self.plan.number_of_rotors, self.parameters.spread
        for seed in count(self.parameters.seed):
            lengths = drawn_deviations(
                rotors, seed, spacing=spread, rotor_length=spread, rest_length=spread
            )
            made = replace(self.plan, deviations=lengths)
            if not blocked_bonds(made).any():
                break
        return made

    @cached_property
    def pictures(self) -> int:
        """Number of pictures of the film."""
        return round(self.parameters.duration / PERIOD)

    def film(self) -> Iterator[TimedPicture]:
        """Yield the pictures of the chain after a kick, 1280 x 720 pixels at 60 Hz."""
        for number in range(self.pictures):
            time = number * PERIOD
            yield TimedPicture(time, self._renderer.picture(self._begin + time))

    def angles(self, times: Array) -> Array:
        """Return the true angles [rad] at `times` [s] since the stamp of the first picture."""
        return self._motion(times + self._renderer.stamp(self._begin))[0]

    @property
    def _begin(self) -> float:
        return CAMERA.row_time * CAMERA.height

    @cached_property
    def _renderer(self) -> Renderer:
        printed = MarkerLayout(self.plan, self.markers).as_printed
        layout = MarkerLayout(self.chain, printed)
        return Renderer(layout, chain_plane(layout), self._motion, FilmSettings())

    @cached_property
    def _motion(self) -> Motion:
        start = leaning(self.chain, -1).angles
        rates = self.parameters.kick * edge_mode(self.chain, start, Edge.FIRST)
        whole = self.parameters.duration + 10 * PERIOD
        return interpolate_motion(simulate(self.chain, start, rates, np.ceil(whole), SIMULATED))
