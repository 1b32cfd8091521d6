# SPDX-License-Identifier: Apache-2.0
"""Plane of the chain by the markers on its frame, and moves of the camera.

ArUco markers are detected in the first picture and after each move of the camera. Their dots are
fitted in every picture; while the camera stands, the plane is that of their means.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.dot_fit import fit_dots
from soliton_linkage.vision.layout import DICTIONARY, DOT_SHARE, MarkerLayout
from soliton_linkage.vision.opencv import opencv
from soliton_linkage.vision.plane import ChainPlane, fit_plane

Grey = NDArray[np.uint8]

_MOST_AVERAGED = 1000
"""Most pictures in a mean [1], so that a frame that settles slowly is followed."""
_ALL_FITTED = 30
"""Pictures of which each is fitted, and period of fits after that [1]: means hardly change."""
FEWEST_DOTS = 6
"""Fewest dots that define a plane and its misfit [1]."""
_MOVED = 6.0
"""Shift of the mean dot that is a move of the camera, in standard deviations [1]: never by chance
at 60 pictures a second."""
_LEAST_MOVE = 0.1
"""Least move of the camera [pixels]: flickering lamps shift dots by less."""
_HIDDEN = 0.5
"""Least deviation from the common shift of a dot that counts as hidden [pixels]."""
_LARGEST_MISFIT = 0.12
"""Largest misfit of a dot, over its contrast [1]: half hidden ones have larger misfits."""
_LEAST_CONTRAST = 20.0
"""Least contrast of a dot [grey levels of 256]: a tenth of that in good light."""
_PATIENCE = 60
"""Period of the search for missing markers [pictures]: it takes as long as a picture."""


class FrameMarkers:
    """Markers on the frame of a chain in the pictures so far."""

    def __init__(self, layout: MarkerLayout, camera: Camera) -> None:
        self.plane: ChainPlane | None = None
        """Plane by the pictures so far."""
        self.deviation = 0.0
        """Standard deviation of a common shift of the plane [pixels]."""
        self.seen = 0
        """Dots of frame markers seen in the latest picture."""
        self.moves = 0
        """Number of moves of the camera."""
        self.shift = 0.0
        """Distance of the last move [pixels]."""
        self._layout, self._camera = layout, camera
        self._points = layout.frame_dots.reshape(-1, 2)
        self._known = np.zeros(len(self._points), dtype=bool)
        self._places = np.full((len(self._points), 2), np.nan)
        self._noise = _HIDDEN
        self._pictures = self._missing_for = 0
        self._detector = marker_detector(opencv())

    @property
    def places(self) -> Array:
        """Mean places of the known dots [pixels], shape (K, 2)."""
        return self._places[self._known]

    def update(self, grey: Grey) -> bool:
        """Add a picture; return whether the plane is known."""
        if self.plane is None:
            return self._find(grey)
        if not self._known.all():
            self._missing_for += 1
            if self._missing_for % _PATIENCE == 0 and self._found_more(grey):
                return True
        places, good = self._measured(grey, self.plane, self._places[self._known])
        shifts = places - self._places[self._known]
        common = np.median(shifts[good], axis=0) if good.any() else np.zeros(2)
        good &= np.hypot(*(shifts - common).T) < max(_HIDDEN, 6 * self._noise)
        self.seen = int(good.sum())
        if self.seen < max(FEWEST_DOTS, len(places) // 2):
            return self._find_anew(grey)
        mean = float(np.hypot(*shifts[good].mean(axis=0)))
        if mean > max(_LEAST_MOVE, _MOVED * self._noise / np.sqrt(self.seen)):
            return self._find_anew(grey)
        self._pictures = min(self._pictures + 1, _MOST_AVERAGED)
        which = np.flatnonzero(self._known)[good]
        self._places[which] += shifts[good] / self._pictures
        if self._pictures < _ALL_FITTED or self._pictures % _ALL_FITTED == 0:
            self._fit()
        return True

    def _find(self, grey: Grey) -> bool:
        """Detect all markers; return whether there are enough."""
        found = self._detected(grey)
        self.seen = 0
        if len(found) * 4 < FEWEST_DOTS:
            return False
        numbers = sorted(found)
        corners = self._layout.frame_corners[numbers].reshape(-1, 2)
        rough, _ = fit_plane(self._camera, corners, np.concatenate([found[n] for n in numbers]))
        places, good = self._measured(grey, rough, rough.pixels(self._points))
        self.seen = int(good.sum())
        if self.seen < FEWEST_DOTS:
            return False
        self._known = good
        self._places = np.where(good[:, None], places, np.nan)
        self._pictures = 1
        self._fit()
        return True

    def _find_anew(self, grey: Grey) -> bool:
        """Decide whether the camera has moved or the markers are hidden."""
        before, known = self._places.copy(), self._known.copy()
        kept = self.plane, self._places, self._known, self._pictures
        found, distance = self._find(grey), np.nan
        both = known & self._known
        if found and both.any():
            distance = float(np.hypot(*np.median(self._places[both] - before[both], axis=0)))
        if not found or distance < _LEAST_MOVE:
            self.plane, self._places, self._known, self._pictures = kept
            return True
        self.moves += 1
        self.shift = distance
        return True

    def _found_more(self, grey: Grey) -> bool:
        """Add markers that were not seen before; return whether there are any."""
        kept = self.plane, self._places, self._known, self._pictures
        before = int(self._known.sum())
        if self._find(grey) and self.seen > before:
            return True
        self.plane, self._places, self._known, self._pictures = kept
        return False

    def _measured(
        self, grey: Grey, plane: ChainPlane, starts: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the centres of dots near places [pixels], and which are visible."""
        radius = self._layout.dot_radius
        outlines = plane.metres_per_pixel(starts) / radius
        fitted = fit_dots(grey, starts, outlines, DOT_SHARE, np.zeros_like(starts))
        good = (fitted.contrasts > _LEAST_CONTRAST) & (
            fitted.misfits < _LARGEST_MISFIT * fitted.contrasts + 2.0
        )
        moved = outlines @ (fitted.places - starts)[..., None]
        good &= np.hypot(moved[:, 0, 0], moved[:, 1, 0]) < 2
        return plane.circle_centres(fitted.places, radius), good

    def _fit(self) -> None:
        points, places = self._points[self._known], self._places[self._known]
        self.plane, self._noise = fit_plane(self._camera, points, places)
        self.deviation = self._noise / np.sqrt(len(points))

    def _detected(self, grey: Grey) -> dict[int, Array]:
        """Return the corners of the markers of the layout by their number, (4, 2) each."""
        corners, numbers = self._detector(grey)
        known = len(self._layout.frame_centres)
        return {
            int(number): np.asarray(four, dtype=np.float64).reshape(4, 2)
            for number, four in zip(
                [] if numbers is None else np.ravel(numbers), corners, strict=True
            )
            if number < known
        }


def marker_detector(cv2: Any) -> Any:
    """Return a detector of corners and numbers of markers for OpenCV 4.6 or later."""
    aruco = cv2.aruco
    dictionary = aruco.getPredefinedDictionary(getattr(aruco, DICTIONARY))
    if hasattr(aruco, 'ArucoDetector'):
        detector = aruco.ArucoDetector(dictionary, aruco.DetectorParameters())
        return lambda grey: detector.detectMarkers(grey)[:2]
    parameters = aruco.DetectorParameters_create()
    return lambda grey: aruco.detectMarkers(grey, dictionary, parameters=parameters)[:2]
