# SPDX-License-Identifier: Apache-2.0
"""The camera and the plane, against OpenCV and there and back."""

from __future__ import annotations

import numpy as np
import pytest
from filmed_chains import CAMERA, LENS

from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.plane import fitted_plane
from soliton_linkage_studies.camera.renderer import posed_plane

POINTS = np.array([(x, z) for x in np.linspace(-1, 1, 5) for z in (-0.3, 0.0, 0.4)])
PLANE = posed_plane(CAMERA, (0.1, 0.0), 2.0, 0.2, -0.15, 0.05)


def test_the_lens_is_that_of_opencv() -> None:
    cv2 = pytest.importorskip('cv2', reason='cameras need OpenCV')
    rays = np.array([(0.3, -0.2), (0.0, 0.0), (-0.5, 0.25)])
    matrix = np.array([[560.0, 0, 318.6], [0, 560.0, 181.2], [0, 0, 1]])
    space = np.column_stack([rays, np.ones(3)])
    theirs, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), matrix, np.array(LENS))
    assert np.allclose(CAMERA.pixels(rays), theirs.reshape(-1, 2), atol=1e-9)
    assert np.allclose(CAMERA.rays(CAMERA.pixels(rays)), rays, atol=1e-8)


@pytest.mark.parametrize('height', [0.0, 0.05])
def test_points_come_back_from_their_pixels(height: float) -> None:
    assert np.allclose(PLANE.points(PLANE.pixels(POINTS, height), height), POINTS, atol=1e-7)


def test_a_plane_is_found_by_its_points() -> None:
    pytest.importorskip('cv2', reason='cameras need OpenCV')
    found, misfit = fitted_plane(CAMERA, POINTS, PLANE.pixels(POINTS))
    assert misfit < 1e-4
    assert np.allclose(found.columns, PLANE.columns, atol=1e-5)


def test_the_centre_of_a_circle_is_not_that_of_its_image() -> None:
    turns = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = 0.1 * np.column_stack([np.cos(turns), np.sin(turns)])
    outline = PLANE.pixels(POINTS[:1] + circle)
    middle = (outline.min(axis=0) + outline.max(axis=0))[None] / 2
    centre = PLANE.pixels(POINTS[:1])
    off = np.hypot(*(middle - centre).T)
    assert np.hypot(*(PLANE.centred(middle, 0.1) - centre).T) < 0.2 * off


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({'width': 0}, 'camera width = 0 must lie in the range 1 to 32768 pixels'),
        ({'focal': (0.0, 1.0)}, 'focal lengths .* must be above 0 pixels'),
        ({'exposure': -1.0}, 'must be 0 s or more'),
        ({'distortion': (np.nan,)}, 'not finite'),
    ],
)
def test_what_is_no_camera_is_refused(values: dict[str, object], said: str) -> None:
    whole = {'width': 64, 'height': 48, 'focal': (50.0, 50.0), 'centre': (31.5, 23.5)}
    with pytest.raises(ValueError, match=said):
        Camera(**{**whole, **values})
