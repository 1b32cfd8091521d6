# SPDX-License-Identifier: Apache-2.0
"""Renderer of films of a chain with known angles; includes rolling shutter and motion blur."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import CheckedQuantities, document_fields, quantity
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.layout import COLOURS, MODULES, MarkerLayout, marker_cells
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.plane import ChainPlane
from soliton_linkage_studies.camera.render_loops import Pixels, expose, paint_bonds, paint_rotors

Motion = Callable[[Array], tuple[Array, Array, Array]]
"""Function from times [s], (T,), to angles, rates and accelerations, (T, N) each."""

_BOARD = (172, 180, 176)
"""RGB colour of the board behind the chain [0 to 255]."""
_ARM, _BOND, _WHITE = (70, 74, 80), (120, 110, 90), (246, 246, 242)
"""RGB colours of arms, bonds and paper [0 to 255]. Labels are printed on paper, and so are the
square markers on the fixed frame of the chain."""
_ARM_WIDTH, _BOND_WIDTH = 0.5, 0.12
"""Half widths of arms and bonds, divided by the radius of a label [1]. A label is a white paper
disc with a coloured dot, on a pivot or a mass."""
_NOISES = 4
"""Number of noise images [1]; successive pictures use them in turn, each with a random shift."""


@document_fields
@dataclass(frozen=True)
class FilmSettings(CheckedQuantities):
    """Light and camera sensor of a film. Raises ValueError for values out of their range."""

    light: float = quantity(
        0.85, 'brightness of white in the middle; 1 saturates the sensor', '', 0, 1
    )
    unevenness: float = quantity(
        0.25, 'relative difference in brightness between left and right', '', 0.0, 1.0
    )
    noise: float = quantity(2.5, 'standard deviation of pixel noise', 'grey levels', 0.0, 50.0)
    blur: float = quantity(0.5, 'standard deviation of the lens blur', 'pixels', 0.1, 5.0)
    quality: int = quantity(0, 'JPEG quality, 0 for uncompressed pictures', '', 0, 100)
    samples: int = quantity(6, 'number of instants rendered per exposure', '', 1, 100)
    seed: int = quantity(0, 'random seed of the noise', '', 0, 10**9)


@dataclass(frozen=True)
class Hand:
    """Ellipse that moves across the picture in front of the chain, like a hand."""

    begin: float
    """Time at which the ellipse appears [s]."""
    end: float
    start: tuple[float, float]
    """Centre of the ellipse when it appears [pixels]."""
    velocity: tuple[float, float]
    """Velocity of the centre [pixels/s]."""
    size: tuple[float, float]
    """Half axes of the ellipse [pixels]."""


class Renderer:
    """Camera that films a chain in motion."""

    def __init__(
        self,
        layout: MarkerLayout,
        plane: ChainPlane,
        motion: Motion,
        settings: FilmSettings = FilmSettings(),
        hands: tuple[Hand, ...] = (),
    ) -> None:
        self._layout, self._plane, self._motion = layout, plane, motion
        self._settings, self._hands = settings, hands
        self._camera = plane.camera
        self._generator = np.random.default_rng(settings.seed)
        self._pictures = 0
        self._background = self._painted_background()
        shape = _NOISES, *self._background.shape
        self._noise = settings.noise * self._generator.standard_normal(shape, dtype=np.float32)

    @cached_property
    def middle_row(self) -> float:
        """Mean picture row of the pivots [pixels]."""
        layout = self._layout
        pivots = np.column_stack([layout.chain.pivots, np.zeros(layout.chain.number_of_rotors)])
        return float(self._plane.pixels(pivots, layout.heights)[:, 1].mean())

    def stamp(self, time: float) -> float:
        """Return the time stamp of `picture(time)` [s]: the mid-exposure time of `middle_row`."""
        camera = self._camera
        return time + camera.exposure / 2 + self.middle_row * camera.row_time

    def picture(self, time: float) -> Picture:
        """Return the picture whose first row is exposed from `time` [s] on."""
        canvas = self._background.copy()
        self._paint_chain(canvas, time)
        noise = self._noise[self._pictures % _NOISES]
        shift = int(self._generator.integers(0, noise.shape[1]))
        picture = np.empty(canvas.shape, dtype=np.uint8)
        expose(canvas, self._lighting, noise, shift, picture)
        self._pictures += 1
        self._paint_hands(picture, time)
        if not self._settings.quality:
            return picture
        cv2 = opencv()
        _, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, self._settings.quality])
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))

    def _paint_chain(self, canvas: NDArray[np.float32], time: float) -> None:
        angles, rates, accelerations = (
            each[0] for each in self._motion(np.array([self.stamp(time)]))
        )
        camera, samples = self._camera, self._settings.samples
        instants: Array = camera.exposure * ((np.arange(samples) + 0.5) / samples - 0.5)
        chain, radius = self._layout.chain, self._layout.label_radius
        rotors = np.stack([angles, rates, accelerations, chain.pivots, chain.rotor_lengths])
        shape = np.array([radius, self._layout.dot_radius, _ARM_WIDTH * radius])
        rows = np.arange(camera.height, dtype=np.float64) - self.middle_row
        moments = camera.row_time * rows[:, None] + instants
        boxes, paint = self._boxes(angles, rates), self._paint
        paint_bonds(
            canvas, self._pixels[0], rotors, boxes, paint[3], _BOND_WIDTH * radius, moments
        )
        for parity, pixels in enumerate(self._pixels):
            paint_rotors(canvas, pixels, parity, rotors, boxes, paint, shape, moments)

    def _boxes(self, angles: Array, rates: Array) -> NDArray[np.int64]:
        layout, camera = self._layout, self._camera
        reach = 1.5 * layout.label_radius
        longest = camera.exposure / 2 + camera.row_time * camera.height / 2
        turns = np.linspace(-1, 1, 5) * np.minimum(np.abs(rates) * longest, np.pi)[:, None]
        swept = angles[:, None] + turns
        pivots = np.column_stack([layout.chain.pivots, np.zeros_like(angles)])
        lengths = layout.chain.rotor_lengths[:, None]
        masses = np.stack([lengths * np.sin(swept), lengths * np.cos(swept)], axis=-1)
        points = np.concatenate([pivots[:, None], pivots[:, None] + masses], axis=1)
        low, high = points.min(axis=1) - reach, points.max(axis=1) + reach
        corners = np.stack(
            [np.column_stack([x[:, 0], z[:, 1]]) for x in (low, high) for z in (low, high)], axis=1
        )
        pixels = self._plane.pixels(corners, layout.heights[:, None])
        edges = np.array([camera.width, camera.height])
        first = np.clip(np.floor(pixels.min(axis=1)) - 2, 0, edges)
        last = np.clip(np.ceil(pixels.max(axis=1)) + 3, 0, edges)
        return np.column_stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]]).astype(np.int64)

    @cached_property
    def _pixels(self) -> tuple[Pixels, Pixels]:
        even, odd = self._layout.heights[:2]
        return self._seen_at(float(even)), self._seen_at(float(odd))

    def _seen_at(self, height: float) -> Pixels:
        camera = self._camera
        grid = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1)
        points = self._plane.points(grid.astype(np.float64), height)
        down, across = (np.asarray(np.gradient(points, axis=axis)) for axis in (0, 1))
        areas = down[..., 0] * across[..., 1] - down[..., 1] * across[..., 0]
        size = np.sqrt(np.abs(areas))
        spread = np.sqrt(self._settings.blur**2 + 1 / 12)
        return Pixels(*map(np.ascontiguousarray, (*np.moveaxis(points, -1, 0), size * spread)))

    @cached_property
    def _paint(self) -> NDArray[np.float32]:
        """BGR colours of arms, paper, pivot dots and bonds, then of the dots on masses, (K, 3)."""
        paints = [_ARM, _WHITE, COLOURS[0], _BOND, *COLOURS[1:]]
        table = np.array(paints, dtype=np.float32)[:, ::-1]
        return np.ascontiguousarray(np.maximum(table, 12.0))

    @cached_property
    def _lighting(self) -> NDArray[np.float32]:
        camera, settings = self._camera, self._settings
        across = np.linspace(-0.5, 0.5, camera.width)
        up = np.linspace(-0.5, 0.5, camera.height)[:, None]
        light = settings.light * (1 + settings.unevenness * (across + 0.6 * up))
        return np.asarray(light, dtype=np.float32)

    def _painted_background(self) -> NDArray[np.float32]:
        cv2 = opencv()
        camera, layout = self._camera, self._layout
        canvas = np.empty((camera.height, camera.width, 3), dtype=np.float32)
        canvas[:] = _BOARD[::-1]
        size = layout.frame_marker_size
        for number, centre in enumerate(layout.frame_centres):
            bits = marker_cells(number)
            half = layout.paper_size / size / 2
            box = centre + size * half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            pixels = self._plane.pixels(box)
            low = np.clip(np.floor(pixels.min(axis=0)) - 2, 0, [camera.width, camera.height])
            high = np.clip(np.ceil(pixels.max(axis=0)) + 3, 0, [camera.width, camera.height])
            (left, top), (right, bottom) = low.astype(int), high.astype(int)
            if left >= right or top >= bottom:
                continue
            fine = 8
            columns = np.arange(left, right + 1) - 0.5
            rows = np.arange(top, bottom + 1) - 0.5
            corners = self._plane.points(np.stack(np.meshgrid(columns, rows), axis=-1))
            across = _between(corners.swapaxes(0, 1), fine).swapaxes(0, 1)
            positions = (_between(across, fine) - centre) / size
            x, z = np.abs(np.moveaxis(positions, -1, 0))
            beside = np.maximum(x, z)
            paper = beside < half
            from_dot = np.hypot(*(size * each - size / 2 - layout.label_radius for each in (x, z)))
            cells = np.floor((positions * [1, -1] + 0.5) * MODULES).astype(int)
            inside = np.clip(cells, 0, MODULES - 1)
            cell = (beside < 0.5) & (bits[inside[..., 1], inside[..., 0]] == 0)
            # The edge of a dot is a ramp between black and white, because a sharp step would
            # displace the rendered dot.
            sharpness = fine * self._plane.pixels_per_metre(centre[None])[0]
            dot = np.clip(0.5 + sharpness * (layout.dot_radius - from_dot), 0, 1)
            black = np.maximum(cell, dot)
            shape = (bottom - top, fine, right - left, fine)
            of_black, of_white = (
                each.reshape(shape).mean(axis=(1, 3))[..., None]
                for each in (black, paper * (1 - black))
            )
            board, white = np.array(_BOARD[::-1]), np.array(_WHITE[::-1])
            rest = 1 - of_black - of_white
            canvas[top:bottom, left:right] = 14.0 * of_black + white * of_white + board * rest
        return np.asarray(cv2.GaussianBlur(canvas, (0, 0), self._settings.blur), dtype=np.float32)

    def _paint_hands(self, picture: Picture, time: float) -> None:
        cv2 = opencv()
        for hand in self._hands:
            if hand.begin <= time < hand.end:
                moved = np.array(hand.start) + np.array(hand.velocity) * (time - hand.begin)
                centre, axes = (tuple(map(round, each)) for each in (moved.tolist(), hand.size))
                skin = (120, 150, 205)
                cv2.ellipse(picture, centre, axes, 20.0, 0.0, 360.0, skin, -1, cv2.LINE_AA)


def _between(edges: Array, parts: int) -> Array:
    share = ((np.arange(parts) + 0.5) / parts)[:, None, None]
    middles = edges[:-1, None] * (1 - share) + edges[1:, None] * share
    return np.asarray(middles.reshape(-1, *edges.shape[1:]))


def posed_plane(
    camera: Camera,
    middle: tuple[float, float],
    distance: float,
    pan: float = 0.0,
    pitch: float = 0.0,
    roll: float = 0.0,
) -> ChainPlane:
    """Return the plane of a chain whose point `middle` [m] is on the camera axis.

    The distance of this point from the camera is `distance` [m]. If `pan`, `pitch` and `roll`
    [rad] are 0, the plane is perpendicular to the camera axis, with x to the right and z up in the
    picture. Otherwise the plane is turned about the point `middle`: first by `pan` about the
    vertical axis of the picture, then by `pitch` about its horizontal axis, and then by `roll`
    about the camera axis. A positive `pan` moves the right side of the chain towards the camera. A
    positive `pitch` moves the upper side towards the camera. A positive `roll` turns the picture
    of the chain clockwise.
    """
    turned = Rotation.from_euler('yxz', [pan, pitch, roll]).as_matrix()
    axes = turned @ np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
    origin = np.array([0.0, 0.0, distance]) - axes @ np.array(middle)
    return ChainPlane(camera, np.column_stack([axes, origin]))
