# SPDX-License-Identifier: Apache-2.0
"""Measurement of angles in pictures of a chain with markers.

The angle of a rotor is the direction from its pivot to the dot on its mass. The fitted position of
a dot is a mean over the exposure time T of its row of pixels. Let t_row be the middle of this
exposure, omega the rate of the rotor, and alpha the acceleration of the rotor. All angles of a
picture refer to one time t, the middle of the exposure of the mean row of the pivots:

    phi(t) = phi_measured - alpha T^2 / 24 + omega (t - t_row) + alpha (t - t_row)^2 / 2.

The exposure of a picture begins when the exposure of the first row begins.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.assignment import HIDDEN, assign_dots
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.dot_errors import DotMeasurements, ErrorScale, RepeatDetector
from soliton_linkage.vision.dots import Dots, find_dots
from soliton_linkage.vision.frame_markers import FrameMarkers
from soliton_linkage.vision.layout import DOT_SHARE, MarkerLayout
from soliton_linkage.vision.opencv import Picture
from soliton_linkage.vision.plane import MIN_POINTS, ChainPlane
from soliton_linkage.vision.rotor_tracks import Pivots, RotorTracks

_DOT_DEVIATION = 0.7
"""The assignment of dots to rotors assumes this standard deviation of a position [pixels]."""
_SEARCHED = 5.0
"""The dot of a rotor is searched for only near its predicted position. The largest distance is the
arc of the circle around the pivot that belongs to this angle [standard deviations of the predicted
angle], plus the radius of a label."""
_MIN_RADIUS = 1.5
"""Dots with a smaller radius than this cannot be fitted [pixels]."""


@dataclass(frozen=True)
class AngleFrame:
    """Measurement of N rotors in a picture; values of hidden rotors are NaN."""

    delay: float
    """Time from the start of the exposure of the picture to the time of the angles [s]."""
    angles: Array
    """Unwrapped angles phi [rad], (N,)."""
    deviations: Array
    """Standard deviations of angles due to errors of dots and frame markers [rad], (N,)."""
    masses: Array
    """Centres of the dots on the masses [pixels], (N, 2)."""
    pivots: Array
    """Positions of the pivots [pixels], (N, 2); NaN for unknown pivots."""
    frame_dots: Array
    """Centres of the dots of the frame markers [pixels], (K, 2)."""
    status: str
    """Reason why rotors are hidden, or warning that the sizes of the frame markers do not match
    their distances; empty if there is neither."""

    @property
    def seen(self) -> int:
        """Number of visible rotors."""
        return int(np.isfinite(self.angles).sum())


def hidden_frame(rotors: int, delay: float, status: str) -> AngleFrame:
    """Return a frame in which all rotors are hidden; `status` is the reason."""
    none, nowhere = np.full((2, rotors), np.nan), np.full((2, rotors, 2), np.nan)
    no_dots = np.zeros((0, 2))
    return AngleFrame(delay, none[0], none[1], nowhere[0], nowhere[1], no_dots, status)


class AngleCamera:
    """Measurement of the angles of a chain that carries the markers of a layout."""

    def __init__(self, layout: MarkerLayout, camera: Camera) -> None:
        self.frame_markers = FrameMarkers(layout, camera)
        self.pivots = Pivots(layout)
        self.tracks = RotorTracks(layout)
        self._error_scale = ErrorScale(layout.chain.number_of_rotors)
        self._repeats = RepeatDetector()
        self._before = 0.0
        self._layout, self._camera = layout, camera
        self._rotors = layout.chain.number_of_rotors
        self._known: ChainPlane | None = None

    def measure(self, time: float, picture: Picture) -> AngleFrame:
        """Measure the next picture, whose exposure begins at `time` [s].

        Raises ValueError if the picture does not have the size of the camera.
        """
        grey = self._camera.checked_grey(picture)
        if not self.frame_markers.update(grey):
            return self._hidden(
                f'{self.frame_markers.seen} dots of frame markers are visible, and {MIN_POINTS} '
                'are needed; show two or more complete markers, sharp and well lit'
            )
        plane = self.frame_markers.plane
        assert plane is not None
        radius = self._adopt(plane)
        if radius < _MIN_RADIUS:
            return self._hidden(
                f'dots have a radius of {radius:.1f} pixels, and {_MIN_RADIUS} are needed; move '
                'the camera closer, or record more pixels'
            )
        dots = self._find_dots(time, grey, picture, plane)
        points = plane.points(np.stack([dots.centres] * 2), self._layout.heights[:2, None])
        self.pivots.update(points, dots.colour_costs)
        if not self.pivots.known.any():
            return self._hidden(
                f'{self.pivots.candidates} black dots are visible in a row for {self._rotors} '
                'pivots; uncover the other pivots, and check chain.spacing'
            )
        return self._frame(time, grey, plane, dots, points)

    def _frame(
        self, time: float, grey: Picture, plane: ChainPlane, dots: Dots, points: Array
    ) -> AngleFrame:
        times = self._times(time, self._expected_pixels)
        pivots = np.where(self.pivots.known[:, None], self.pivots.positions, np.nan)
        predicted = self.tracks.predict(times, pivots, _DOT_DEVIATION * self._metres)
        deviations = np.full(len(dots.centres), _DOT_DEVIATION * self._metres)
        chosen = assign_dots(points, deviations, dots.colour_costs, predicted)
        seen = chosen != HIDDEN
        masses, pixels = np.full((2, self._rotors, 2), np.nan)
        masses[seen] = points[np.flatnonzero(seen) % 2, chosen[seen]]
        pixels[seen] = dots.centres[chosen[seen]]
        arms = masses - self.pivots.positions
        times = self._times(time, np.where(seen[:, None], pixels, self._pivot_pixels))
        angles = self.tracks.unwrap(times, np.arctan2(arms[:, 0], arms[:, 1]))
        self.tracks.add_angles(times, angles)
        repeated = self._repeats.compare(grey, pixels, self._radius / DOT_SHARE)
        radial, tangential = np.full((2, self._rotors), np.nan)
        radial[seen], tangential[seen] = self._pixel_errors(
            plane, seen, pixels[seen], dots.covariances[chosen[seen]], arms[seen]
        )
        rates, accelerations, rate_errors = self.tracks.motion()
        since = time + self._delay - times
        blurred = accelerations * self._camera.exposure**2 / 24
        at_stamp = angles - blurred + rates * since + accelerations * since**2 / 2
        lengths = np.hypot(arms[:, 0], arms[:, 1])
        steps = lengths / self._metres
        factors = self._error_scale.update(
            DotMeasurements(
                time + self._delay,
                at_stamp,
                tangential,
                self.tracks.length_errors(lengths) / radial,
                steps,
                np.abs(rates) * (time - self._before) * steps,
                repeated,
            ),
            self.frame_markers.fit_error,
        )
        self._before = time
        self.tracks.add_lengths(self.pivots.positions, np.where(repeated[:, None], np.nan, masses))
        assert self.frame_markers.placing is not None
        placing = self.frame_markers.placing.deviations(self.pivots.positions, arms)
        placing *= self._layout.settings.placing_tolerance
        of_pivots = self.frame_markers.fit_error * self._metres / lengths
        deviations = np.sqrt(
            (factors * tangential) ** 2 + (rate_errors * since) ** 2 + placing**2 + of_pivots**2
        )
        hidden = int(self._rotors - seen.sum())
        hiding = f'{hidden} of {self._rotors} rotors are hidden' if hidden else ''
        status = '; '.join(filter(None, (self.frame_markers.complaint, hiding)))
        known = np.where(self.pivots.known[:, None], self._pivot_pixels, np.nan)
        frame_dots = self.frame_markers.centres
        return AngleFrame(self._delay, at_stamp, deviations, pixels, known, frame_dots, status)

    def _pixel_errors(
        self, plane: ChainPlane, seen: NDArray[np.bool_], pixels: Array, noise: Array, arms: Array
    ) -> tuple[Array, Array]:
        steps = plane.metres_per_pixel(pixels, self._layout.heights[seen])
        covariances = steps @ noise @ np.swapaxes(steps, 1, 2)
        lengths = np.hypot(arms[:, 0], arms[:, 1])
        outwards = arms / lengths[:, None]
        across = np.stack([outwards[:, 1], -outwards[:, 0]], axis=1)
        radial, tangential = (
            np.sqrt(np.einsum('ni,nij,nj->n', axis, covariances, axis))
            for axis in (outwards, across)
        )
        return radial, tangential / lengths

    def _find_dots(self, time: float, grey: Picture, picture: Picture, plane: ChainPlane) -> Dots:
        now = np.full(self._rotors, time + self._delay)
        angles, angle_deviations = self.tracks.predict_angles(now)
        rates, _, _ = self.tracks.motion()

        def mass_pixels(turned: Array) -> Array:
            arms = self.tracks.lengths[:, None] * np.column_stack([np.sin(turned), np.cos(turned)])
            return plane.pixels(self.pivots.positions + arms, self._layout.heights)

        expected = self._expected_pixels = mass_pixels(angles)
        smears = 2 * (mass_pixels(angles + rates * self._camera.exposure / 2) - expected)
        starts = np.concatenate([expected, self._pivot_pixels])
        smears = np.concatenate([smears, np.zeros_like(smears)])
        heights = np.concatenate([self._layout.heights] * 2)
        outlines = plane.metres_per_pixel(starts, heights) / self._layout.dot_radius
        # Only dots near their predictions are fitted. The prediction of a hidden rotor becomes
        # uncertain, so that the dot is searched for on the whole circle around the pivot.
        arms = _SEARCHED * angle_deviations * self.tracks.lengths / self._metres
        label = self._radius / DOT_SHARE
        reaches = label + np.concatenate([arms, np.where(self.pivots.known, 0.0, np.inf)])
        dots = find_dots(grey, picture, self._region, starts, outlines, smears, reaches)
        return replace(dots, centres=plane.circle_centres(dots.centres, self._layout.dot_radius))

    def _adopt(self, plane: ChainPlane) -> float:
        if plane is not self._known:
            self._known = plane
            self._pivot_pixels = plane.pixels(self.pivots.positions, self._layout.heights)
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
            scale = float(np.median(plane.pixels_per_metre(self.pivots.positions)))
            self._metres = 1 / scale
            self._radius = self._layout.dot_radius * scale
        return self._radius

    def _times(self, time: float, pixels: Array) -> Array:
        camera = self._camera
        return np.asarray(time + camera.exposure / 2 + camera.row_time * pixels[:, 1])

    def _hidden(self, status: str) -> AngleFrame:
        frame = hidden_frame(self._rotors, self._camera.middle_delay, status)
        return replace(frame, frame_dots=self.frame_markers.centres)
