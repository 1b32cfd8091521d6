# SPDX-License-Identifier: Apache-2.0
"""From pictures to angles: the one way of live cameras, films and tests.

The angle of a rotor is the direction from its pivot, the mean over all pictures, to the dot on its
mass. The dot is where it was on the mean over the exposure of its row, so that

    phi(t) = phi_measured - alpha T^2 / 24 + omega (t - t_row) + alpha (t - t_row)^2 / 2

at the time t of the frame, the middle of the exposure T of the row in which the pivots are on the
mean, with the rate omega and acceleration alpha of the last sightings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.dots import Dots, find_dots
from soliton_linkage.vision.frame_markers import FrameMarkers
from soliton_linkage.vision.identities import NOBODY, identified
from soliton_linkage.vision.layout import DOT_SHARE, MarkerLayout
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.plane import ChainPlane
from soliton_linkage.vision.rotor_tracks import Pivots, RotorTracks
from soliton_linkage.vision.scatter import Repeats, Scatter, Sightings

_SLACK = 0.7
"""By which distances of dots in pictures are uncertain when they are identified [pixels]."""
_LEAST_RADIUS = 1.5
"""Of a dot whose place can be told [pixels]."""


@dataclass(frozen=True)
class AngleFrame:
    """What a picture shows of N rotors."""

    delay: float
    """From the time of the picture to that of the angles [s]."""
    angles: Array
    """Actual angles, unwrapped [rad], NaN of rotors that are not seen, shape (N,)."""
    deviations: Array
    """Standard deviation of each angle [rad], NaN of rotors that are not seen, shape (N,)."""
    masses: Array
    """Where the dots of the masses are [pixels], NaN where they are not seen, shape (N, 2)."""
    pivots: Array
    """Where the pivots are [pixels], NaN where that is not known, shape (N, 2)."""
    frame_dots: Array
    """Where the dots of the frame markers are [pixels], shape (K, 2)."""
    status: str
    """What keeps rotors from being seen; empty where all are."""

    @property
    def seen(self) -> int:
        """Number of rotors that are seen."""
        return int(np.isfinite(self.angles).sum())


def no_rotors(rotors: int, delay: float, status: str) -> AngleFrame:
    """A picture in which none of so many rotors is seen, and why."""
    none = np.full(rotors, np.nan)
    nowhere = np.full((rotors, 2), np.nan)
    return AngleFrame(delay, none, none.copy(), nowhere, nowhere.copy(), np.zeros((0, 2)), status)


def check_picture(camera: Camera, picture: Picture) -> None:
    """Raise ValueError for what is no picture of a camera."""
    size = (camera.height, camera.width)
    if picture.dtype != np.uint8 or picture.shape not in (size, (*size, 3)):
        raise ValueError(
            f'a picture of {picture.dtype} and shape {picture.shape} is none of the camera, '
            f'whose have uint8 and shape {size} or {(*size, 3)}'
        )


class AngleCamera:
    """Sees the angles of a chain that wears the markers of a layout."""

    def __init__(self, layout: MarkerLayout, camera: Camera) -> None:
        """Have seen nothing yet."""
        self.frame_markers = FrameMarkers(layout, camera)
        self.pivots = Pivots(layout)
        self.tracks = RotorTracks(layout)
        self.scatter = Scatter(layout.chain.number_of_rotors)
        self.repeats = Repeats()
        self._before = 0.0
        self._layout, self._camera = layout, camera
        self._rotors = layout.chain.number_of_rotors
        self._parity = np.arange(self._rotors) % 2
        self._known: ChainPlane | None = None

    def look(self, time: float, picture: Picture) -> AngleFrame:
        """Angles in a picture that was begun at a time [s], later than the one before.

        It has the shape (height, width, 3), blue, green and red, or (height, width). Raises
        ValueError where it has not the size of the camera's pictures.
        """
        check_picture(self._camera, picture)
        cv2 = opencv()
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        if not self.frame_markers.look(grey):
            return self._nothing(
                f'{self.frame_markers.seen} dots of frame markers are seen, and 6 or more are '
                'needed; show two markers or more, whole, sharp and lit'
            )
        plane = self.frame_markers.plane
        assert plane is not None
        radius = self._learn(plane)
        if radius < _LEAST_RADIUS:
            return self._nothing(
                f'dots have a radius of {radius:.1f} pixels, too few to be found; go nearer, or '
                'film with more pixels'
            )
        dots = self._dots(time, grey, picture, plane)
        where = plane.points(np.stack([dots.places] * 2), self._layout.heights[:2, None])
        self.pivots.look(where, dots.colour_costs)
        if not self.pivots.known.any():
            return self._nothing(
                f'{self.pivots.found} black dots have been seen in a row for {self._rotors} '
                'pivots; uncover the others, and check chain.spacing'
            )
        return self._frame(time, grey, plane, dots, where)

    def _frame(
        self, time: float, grey: Picture, plane: ChainPlane, dots: Dots, where: Array
    ) -> AngleFrame:
        times = self._times(time, self._expected_pixels)
        pivots = np.where(self.pivots.known[:, None], self.pivots.places, np.nan)
        expected = self.tracks.expected(times, pivots, _SLACK * self._metres)
        spread = np.full(len(dots), _SLACK * self._metres)
        chosen = identified(where, spread, dots.colour_costs, expected)
        seen = chosen != NOBODY
        masses = np.full((self._rotors, 2), np.nan)
        pixels = np.full((self._rotors, 2), np.nan)
        masses[seen] = where[self._parity[seen], chosen[seen]]
        pixels[seen] = dots.places[chosen[seen]]
        arms = masses - self.pivots.places
        times = self._times(time, np.where(seen[:, None], pixels, self._pivot_pixels))
        angles = self.tracks.unwrapped(times, np.arctan2(arms[:, 0], arms[:, 1]))
        self.tracks.take(times, angles)
        repeated = self.repeats.look(grey, pixels, self._radius / DOT_SHARE)
        radial, turning = np.full((2, self._rotors), np.nan)
        radial[seen], turning[seen] = self._pixel_errors(
            plane, seen, pixels[seen], dots.covariances[chosen[seen]], arms[seen]
        )
        at_stamp = self._at(time + self._delay, times, angles)
        factors = self.scatter.look(
            self._sightings(time, at_stamp, arms, radial, turning, repeated)
        )
        self.tracks.measure(self.pivots.places, np.where(repeated[:, None], np.nan, masses))
        _, _, unsure = self.tracks.motion()
        deviations = np.hypot(factors * turning, unsure * (time + self._delay - times))
        hidden = int(self._rotors - seen.sum())
        status = f'{hidden} of {self._rotors} rotors are hidden' if hidden else ''
        known = np.where(self.pivots.known[:, None], self._pivot_pixels, np.nan)
        of_frame = self.frame_markers.places
        return AngleFrame(self._delay, at_stamp, deviations, pixels, known, of_frame, status)

    def _at(self, stamp: float, times: Array, angles: Array) -> Array:
        """Angles at the time of the frame [s] by those that were seen at others, (N,)."""
        rates, accelerations, _ = self.tracks.motion()
        apart = stamp - times
        blurred = accelerations * self._camera.exposure**2 / 24
        return np.asarray(angles - blurred + rates * apart + accelerations * apart**2 / 2)

    def _pixel_errors(
        self,
        plane: ChainPlane,
        seen: NDArray[np.bool_],
        pixels: Array,
        noise: Array,
        arms: Array,
    ) -> tuple[Array, Array]:
        """What pixels say of the rotors that are seen: errors of lengths [m] and angles [rad]."""
        steps = plane.metres_per_pixel(pixels, self._layout.heights[seen])
        noise = noise + self.frame_markers.deviation**2 * np.eye(2)
        covariances = steps @ noise @ np.swapaxes(steps, 1, 2)
        lengths = np.hypot(arms[:, 0], arms[:, 1])
        outwards = arms / lengths[:, None]
        across = np.stack([outwards[:, 1], -outwards[:, 0]], axis=1)
        radial, turning = (
            np.sqrt(np.einsum('ni,nij,nj->n', way, covariances, way)) for way in (outwards, across)
        )
        return radial, turning / lengths

    def _sightings(
        self,
        time: float,
        angles: Array,
        arms: Array,
        radial: Array,
        turning: Array,
        repeated: NDArray[np.bool_],
    ) -> Sightings:
        """What is shown at the time of a picture [s] of arms [m], (N, 2)."""
        lengths = np.hypot(arms[:, 0], arms[:, 1])
        errors = self.tracks.length_errors(lengths) / radial
        rates, _, _ = self.tracks.motion()
        pixels = lengths / self._metres
        ways = np.abs(rates) * (time - self._before) * pixels
        self._before = time
        return Sightings(time + self._delay, angles, turning, errors, pixels, ways, repeated)

    def _dots(self, time: float, grey: Picture, picture: Picture, plane: ChainPlane) -> Dots:
        """Dots of the picture, each with the way that the nearest expected one has gone."""
        angles, _ = self.tracks.predicted(np.full(self._rotors, time + self._delay))
        rates, _, _ = self.tracks.motion()
        arms = self.tracks.lengths[:, None] * np.column_stack([np.sin(angles), np.cos(angles)])
        expected = plane.pixels(self.pivots.places + arms, self._layout.heights)
        turned = angles + rates * self._camera.exposure / 2
        ends = self.tracks.lengths[:, None] * np.column_stack([np.sin(turned), np.cos(turned)])
        ways = 2 * (plane.pixels(self.pivots.places + ends, self._layout.heights) - expected)
        self._expected_pixels = expected
        places = np.concatenate([expected, self._pivot_pixels])
        smears = np.concatenate([ways, np.zeros_like(ways)])
        heights = np.concatenate([self._layout.heights] * 2)
        outlines = plane.metres_per_pixel(places, heights) / self._layout.dot_radius
        dots = find_dots(grey, picture, self._region, places, outlines, smears)
        return replace(dots, places=plane.centred(dots.places, self._layout.dot_radius))

    def _learn(self, plane: ChainPlane) -> float:
        """Take up a plane; return the usual radius of dots in it [pixels]."""
        if plane is not self._known:
            self._known = plane
            self._pivot_pixels = plane.pixels(self.pivots.places, self._layout.heights)
            self._delay = self._camera.exposure / 2
            self._delay += self._camera.row_time * float(self._pivot_pixels[:, 1].mean())
            (low_x, low_z), (high_x, high_z) = self._layout.bounds
            margin = 0.1 * (high_x - low_x)
            xs = np.linspace(low_x - margin, high_x + margin, 9)
            box = plane.pixels(np.array([(x, z) for x in xs for z in (low_z, high_z)]))
            limits = np.array([self._camera.width, self._camera.height])
            low = np.clip(np.floor(box.min(axis=0)), 0, limits - 1).astype(int)
            high = np.clip(np.ceil(box.max(axis=0)) + 1, low + 1, limits).astype(int)
            self._region = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
            scale = float(np.median(plane.pixels_per_metre(self.pivots.places)))
            self._metres = 1 / scale
            self._radius = self._layout.dot_radius * scale
        return self._radius

    def _times(self, time: float, pixels: Array) -> Array:
        """When each of N pixels was exposed, the middle of it [s]."""
        camera = self._camera
        return np.asarray(time + camera.exposure / 2 + camera.row_time * pixels[:, 1])

    def _nothing(self, status: str) -> AngleFrame:
        delay = self._camera.exposure / 2 + self._camera.row_time * self._camera.height / 2
        dots = self.frame_markers.places
        return replace(no_rotors(self._rotors, delay, status), frame_dots=dots)
