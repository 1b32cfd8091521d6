# SPDX-License-Identifier: Apache-2.0
"""Plane of the chain from the markers on the frame, and detection of camera motions.

ArUco markers are detected in the first picture and after each motion of the camera. The dots of
the markers are fitted in every picture; while the camera rests, their centres are averaged.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.dot_fit import fit_dots
from soliton_linkage.vision.dots import MIN_CONTRAST
from soliton_linkage.vision.layout import DICTIONARY, DOT_SHARE, MarkerLayout
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.plane import MIN_POINTS, ChainPlane, fit_plane


class PlacingErrors:
    """Errors of angles due to errors in the stated positions of the frame markers.

    To first order, errors of the positions of markers displace the point (x, z) of the fitted
    plane by the vector u with eight parameters p0 to p7:

        u_x = p0 + p1 x + p2 z + p6 x^2 + p7 x z,
        u_z = p3 + p4 x + p5 z + p6 x z + p7 z^2.
    """

    def __init__(self, dots: Array, markers: NDArray[np.intp]) -> None:
        """Prepare for K visible `dots` [m], (K, 2), on markers with given numbers, (K,)."""
        self._centre, self._scale = dots.mean(axis=0), float(np.ptp(dots, axis=0).max())
        moved = np.kron(markers[:, None] == np.unique(markers), np.eye(2))
        fields = self._fields(dots).reshape(-1, 8)
        self._parameters = np.linalg.lstsq(fields, moved, rcond=None)[0]

    def deviations(self, pivots: Array, arms: Array) -> Array:
        """Return the standard deviations of angles for markers with unit errors [rad/m], (N,).

        Unit errors have a standard deviation of 1 m in each coordinate of each marker. `arms`,
        (N, 2), are the vectors [m] from the `pivots`, (N, 2), to the masses.
        """
        change = self._fields(pivots + arms) - self._fields(pivots)
        across = np.stack([arms[:, 1], -arms[:, 0]], axis=1) / np.sum(arms**2, axis=1)[:, None]
        turns = np.einsum('ni,nij->nj', across, change) @ self._parameters
        return np.asarray(np.sqrt(np.sum(turns**2, axis=1)))

    def _fields(self, points: Array) -> Array:
        x, z = ((points - self._centre) / self._scale).T
        one, none = np.ones_like(x), np.zeros_like(x)
        along = [one, x, z, none, none, none, x * x, x * z]
        up = [none, none, none, one, x, z, x * z, z * z]
        return np.stack([np.stack(along, axis=1), np.stack(up, axis=1)], axis=1)


_MAX_PICTURES = 1000
"""Largest number of averaged pictures. The mean therefore follows slow motions of the frame, so
that these do not count as motions of the camera."""
_FIT_PERIOD = 30
"""Let n be the number of pictures since the markers were detected. The plane is fitted in each
picture while n is smaller than this, and later whenever n is a multiple of this."""
_MOTION_THRESHOLD = 6.0
"""The camera may have moved if the mean shift of the dots from their averaged centres is larger
than this [standard deviations of this mean] and also larger than `_MIN_MOTION`. The markers are
then detected again."""
_MIN_MOTION = 0.1
"""Smallest shift that counts as a camera motion [pixels]; flickering lamps shift dots by less."""
_MIN_OUTLIER = 0.5
"""A dot counts as hidden if its shift differs from the median shift by more than this [pixels]."""
_MAX_RESIDUAL = 0.12
"""A dot counts as visible if its residual, relative to its contrast, is smaller than this [1];
partly hidden dots have larger residuals."""
_MAX_SCALE_ERROR = 0.02
"""A warning is given if `print_scale` differs from 1 by more than this [1]."""
_SEARCH_PERIOD = 60
"""Number of pictures from one search for missing markers to the next; a search takes about as long
as the time between two pictures."""


class FrameMarkers:
    """Frame markers of a chain (fixed beside it), tracked in successive pictures."""

    def __init__(self, layout: MarkerLayout, camera: Camera) -> None:
        self.plane: ChainPlane | None = None
        """Plane of the chain, None until enough markers have been visible."""
        self.fit_error = 0.0
        """Standard deviation of the constant part of the errors of fitted centres [pixels], which
        averaging over pictures does not reduce."""
        self.placing: PlacingErrors | None = None
        """Errors of angles due to errors of the marker positions; None without a plane."""
        self.print_scale = 1.0
        """Ratio of the size of markers to their distances, divided by this ratio in the
        layout [1]."""
        self.seen = 0
        """Number of visible dots in the latest picture."""
        self.moves = 0
        """Number of motions of the camera so far."""
        self.shift = 0.0
        """Distance by which the last motion of the camera shifted the dots [pixels]."""
        self._layout, self._camera = layout, camera
        self._points = layout.frame_dots.reshape(-1, 2)
        self._known = np.zeros(len(self._points), dtype=bool)
        self._centres = np.full((len(self._points), 2), np.nan)
        self._noise = _MIN_OUTLIER
        self._pictures = self._since_search = 0
        self._variance = 0.0
        self._detector = marker_detector(opencv())

    @property
    def complaint(self) -> str:
        """Error message if the sizes of frame markers do not match their distances, else empty."""
        if abs(self.print_scale - 1) < _MAX_SCALE_ERROR:
            return ''
        return (
            f'frame markers have {self.print_scale:.0%} of their size at the stated distances; '
            'print them without scaling, or correct markers.frame_x and markers.frame_z'
        )

    @property
    def centres(self) -> Array:
        """Centres of those K dots that were visible when the markers were last detected, (K, 2).

        The centres [pixels] are averaged over the pictures since this detection.
        """
        return self._centres[self._known]

    def update(self, grey: Picture) -> bool:
        """Add a picture; return whether the plane of the chain is known."""
        if self.plane is None:
            return self._find(grey)
        if not self._known.all():
            self._since_search += 1
            if self._since_search % _SEARCH_PERIOD == 0 and self._find_more(grey):
                return True
        centres, good = self._fit_centres(grey, self.plane, self.centres)
        shifts = centres - self.centres
        common = np.median(shifts[good], axis=0) if good.any() else np.zeros(2)
        good &= np.hypot(*(shifts - common).T) < max(_MIN_OUTLIER, 6 * self._noise)
        self.seen = int(good.sum())
        hidden = self.seen < max(MIN_POINTS, len(centres) // 2)
        mean = 0.0 if hidden else float(np.hypot(*shifts[good].mean(axis=0)))
        limit = _MOTION_THRESHOLD * self._noise / np.sqrt(max(self.seen, 1))
        if hidden or mean > max(_MIN_MOTION, limit):
            self._relocate(grey)
            return True
        self._pictures += 1
        which = np.flatnonzero(self._known)[good]
        self._centres[which] += shifts[good] / min(self._pictures, _MAX_PICTURES)
        if self._pictures < _FIT_PERIOD or self._pictures % _FIT_PERIOD == 0:
            self._fit_plane()
        return True

    def _find(self, grey: Picture) -> bool:
        found = self._detect(grey)
        self.seen = 0
        if len(found) * 4 < MIN_POINTS:
            return False
        numbers = sorted(found)
        printed = self._layout.frame_corners[numbers]
        corners = np.stack([found[n] for n in numbers])
        rough, _ = fit_plane(self._camera, printed.reshape(-1, 2), corners.reshape(-1, 2))
        # If markers were printed too small, their dots are nearer to the centres of the markers.
        dots, middles = self._layout.frame_dots, self._layout.frame_centres[:, None]
        starts = middles + _print_scale(rough, corners, printed) * (dots - middles)
        centres, good = self._fit_centres(grey, rough, rough.pixels(starts.reshape(-1, 2)))
        self.seen = int(good.sum())
        if self.seen < MIN_POINTS:
            return False
        self._known = good
        self._centres = np.where(good[:, None], centres, np.nan)
        self._pictures = 1
        self._fit_plane()
        return True

    def _relocate(self, grey: Picture) -> None:
        kept = self.plane, self._centres, self._known, self._pictures
        found, distance = self._find(grey), np.nan
        both = kept[2] & self._known
        if found and both.any():
            distance = float(np.hypot(*np.median(self._centres[both] - kept[1][both], axis=0)))
        if not found or distance < _MIN_MOTION:
            self.plane, self._centres, self._known, self._pictures = kept
        else:
            self.moves += 1
            self.shift = distance

    def _find_more(self, grey: Picture) -> bool:
        kept = self.plane, self._centres, self._known, self._pictures
        if self._find(grey) and self.seen > int(kept[2].sum()):
            return True
        self.plane, self._centres, self._known, self._pictures = kept
        return False

    def _fit_centres(
        self, grey: Picture, plane: ChainPlane, starts: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        radius = self._layout.dot_radius
        outlines = plane.metres_per_pixel(starts) / radius
        fitted = fit_dots(grey, starts, outlines, DOT_SHARE, np.zeros_like(starts))
        good = (fitted.contrasts > MIN_CONTRAST) & (
            fitted.residuals < _MAX_RESIDUAL * fitted.contrasts + 2.0
        )
        self._variance = float(np.median(fitted.covariances[:, [0, 1], [0, 1]]))
        shifts = outlines @ (fitted.centres - starts)[..., None]
        good &= np.hypot(shifts[:, 0, 0], shifts[:, 1, 0]) < 2
        return plane.circle_centres(fitted.centres, radius), good

    def _fit_plane(self) -> None:
        points = self._points[self._known]
        self.plane, self._noise = fit_plane(self._camera, points, self.centres)
        self.placing = PlacingErrors(points, np.flatnonzero(self._known) // 4)
        whole = self._known.reshape(-1, 4).all(axis=1)
        seen = self._centres.reshape(-1, 4, 2)[whole]
        self.print_scale = _print_scale(self.plane, seen, self._layout.frame_dots[whole])
        if whole.any():
            expected = self.plane.pixels(self._points).reshape(-1, 4, 2)[whole]
            error = _shape_error(seen - expected)
            averaged = min(self._pictures, _MAX_PICTURES)
            self.fit_error = float(np.sqrt(max(error**2 - self._variance / averaged, 0.0)))

    def _detect(self, grey: Picture) -> dict[int, Array]:
        corners, numbers = self._detector(grey)
        if numbers is None:
            return {}
        return {
            int(number): np.asarray(four, dtype=np.float64).reshape(4, 2)
            for number, four in zip(np.ravel(numbers), corners, strict=True)
            if number < len(self._layout.frame_centres)
        }


def _print_scale(plane: ChainPlane, pixels: Array, printed: Array) -> float:
    """Return the size of M markers divided by their distances, relative to the layout [1].

    `pixels` and `printed`, (M, 4, 2), are the same corners or dots of the markers in the picture
    [pixels] and in the layout [m].
    """
    if len(pixels) < 2:
        return 1.0
    size, distance = np.divide(_spreads(plane.points(pixels)), _spreads(printed))
    return float(size / distance)


def _spreads(dots: Array) -> tuple[float, float]:
    centres = dots.mean(axis=1)
    within = np.linalg.norm(dots - centres[:, None]) / np.sqrt(len(dots))
    return float(within), float(np.linalg.norm(centres - centres.mean(axis=0)))


def _shape_error(errors: Array) -> float:
    """Return the root mean square of position errors of the dots of M markers, (M, 4, 2).

    The four dots of a marker lie on a parallelogram also if the plane is slightly wrong, because
    other markers are at wrong positions. In the difference between the sums of both pairs of
    opposite dots, such errors therefore cancel each other.
    """
    differences = errors[:, 0] - errors[:, 1] + errors[:, 2] - errors[:, 3]
    return float(np.sqrt(np.mean(differences**2))) / 2


def marker_detector(cv2: Any) -> Any:
    """Return a function that detects markers in a grey picture, for OpenCV 4.6 or later."""
    aruco = cv2.aruco
    dictionary = aruco.getPredefinedDictionary(getattr(aruco, DICTIONARY))
    if hasattr(aruco, 'ArucoDetector'):
        detector = aruco.ArucoDetector(dictionary, aruco.DetectorParameters())
        return lambda grey: detector.detectMarkers(grey)[:2]
    parameters = aruco.DetectorParameters_create()
    return lambda grey: aruco.detectMarkers(grey, dictionary, parameters=parameters)[:2]
