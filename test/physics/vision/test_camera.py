# SPDX-License-Identifier: Apache-2.0
"""The camera and the plane of a chain agree with their formulas and inverses."""

from dataclasses import replace

import numpy as np
import pytest
from filmed_chains import CAMERA, LENS

from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.plane import fit_plane
from soliton_linkage_studies.camera.renderer import posed_plane

POINTS = np.array([(x, z) for x in np.linspace(-1, 1, 5) for z in (-0.3, 0.0, 0.4)])
PLANE = posed_plane(CAMERA, (0.1, 0.0), 2.0, 0.2, -0.15, 0.05)


def test_a_lens_maps_rays_by_its_formula_and_back():
    pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    x, y = rays = np.array([(0.3, 0.0, -0.5), (-0.2, 0.0, 0.25)])
    q = x**2 + y**2
    for lens in (LENS, (0.3, -0.1, 1e-4, 1e-4, 0.01, 0.5, -0.05, 0.02)):
        k1, k2, p1, p2, k3, k4, k5, k6 = (*lens, 0.0, 0.0, 0.0)[:8]
        radial = (1 + k1 * q + k2 * q**2 + k3 * q**3) / (1 + k4 * q + k5 * q**2 + k6 * q**3)
        moved = [
            x * radial + 2 * p1 * x * y + p2 * (q + 2 * x**2),
            y * radial + p1 * (q + 2 * y**2) + 2 * p2 * x * y,
        ]
        camera = replace(CAMERA, distortion=lens)
        pixels = np.transpose(moved) * CAMERA.focal + CAMERA.centre
        np.testing.assert_allclose(camera.pixels(rays.T), pixels, atol=1e-9)
        np.testing.assert_allclose(camera.rays(pixels), rays.T, atol=1e-8)


def test_points_are_recovered_from_their_pixels():
    for height in [0.0, 0.05]:
        assert np.allclose(PLANE.points(PLANE.pixels(POINTS, height), height), POINTS, atol=1e-7)


def test_a_plane_is_fitted_to_its_points():
    pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    found, misfit = fit_plane(CAMERA, POINTS, PLANE.pixels(POINTS))
    assert misfit < 1e-4
    assert np.allclose(found.columns, PLANE.columns, atol=1e-5)


def test_centres_of_circles_are_corrected_for_perspective():
    turns = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = 0.1 * np.column_stack([np.cos(turns), np.sin(turns)])
    outline = PLANE.pixels(POINTS[:1] + circle)
    middle = (outline.min(axis=0) + outline.max(axis=0))[None] / 2
    centre = PLANE.pixels(POINTS[:1])
    off = np.hypot(*(middle - centre).T)
    assert np.hypot(*(PLANE.circle_centres(middle, 0.1) - centre).T) < 0.2 * off


def test_invalid_cameras_are_rejected():
    for values, message in [
        ({'width': 0}, 'camera width = 0 must lie in the range 1 to 32768 pixels'),
        ({'focal': (0.0, 1.0)}, 'focal lengths .* must be above 0 pixels'),
        ({'exposure': -1.0}, 'must be 0 s or more'),
        ({'distortion': (np.nan,)}, 'not finite'),
    ]:
        whole = {'width': 64, 'height': 48, 'focal': (50.0, 50.0), 'centre': (31.5, 23.5)}
        with pytest.raises(ValueError, match=message):
            Camera(**{**whole, **values})
