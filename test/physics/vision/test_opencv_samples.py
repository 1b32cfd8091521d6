# SPDX-License-Identifier: Apache-2.0
"""Calibration and marker detection in sample pictures of OpenCV (Debian package opencv-doc)."""

import os
from pathlib import Path

import numpy as np
import pytest

from soliton_linkage.vision.camera import calibrate, uncalibrated_camera
from soliton_linkage.vision.frame_markers import marker_detector
from soliton_linkage.vision.plane import fit_plane

DOC = Path(os.environ.get('OPENCV_DOC', '/usr/share/doc/opencv-doc'))
SAMPLES, TUTORIALS = DOC / 'examples/data', DOC / 'opencv4/html'
FOCAL, MIDDLE, LENS = 535.9, (342.3, 235.6), (-0.266, -0.0386, 0.2384)
"""Parameters from left_intrinsics.yml, next to these pictures in the sources of OpenCV."""


@pytest.mark.skipif(not SAMPLES.is_dir(), reason='needs samples: apt install opencv-doc')
def test_the_calibration_agrees_with_the_parameters_from_opencv():
    cv2 = pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    pictures = [cv2.imread(str(path)) for path in sorted(SAMPLES.glob('left[01]*.jpg'))]
    found = calibrate(pictures, 9, 6, 0.025)
    assert found.pictures >= 8
    assert found.misfit < 0.5
    assert found.camera.focal == pytest.approx((FOCAL, FOCAL), abs=6)
    assert found.camera.centre == pytest.approx(MIDDLE, abs=6)
    k1, k2, _, _, k3 = found.camera.distortion[:5]
    for square in (0.05, 0.15, 0.25, 0.35):
        powers = [square, square**2, square**3]
        theirs = np.dot(LENS, powers)
        assert np.dot((k1, k2, k3), powers) == pytest.approx(theirs, abs=0.01)


@pytest.mark.skipif(not TUTORIALS.is_dir(), reason='needs samples: apt install opencv-doc')
def test_markers_in_a_photo_agree_with_the_drawing():
    cv2 = pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    found = []
    for name in ('charuco_board.png', 'screen_charuco.jpg'):
        grey = cv2.imread(str(TUTORIALS / name), cv2.IMREAD_GRAYSCALE)
        corners, numbers = marker_detector(cv2)(grey)
        found.append(dict(zip(np.ravel(numbers).tolist(), corners, strict=True)))
    both = sorted(found[0].keys() & found[1].keys())
    assert len(both) >= 12
    points, pixels = (np.concatenate([each[n].reshape(4, 2) for n in both]) for each in found)
    _, misfit = fit_plane(
        uncalibrated_camera(800, 450), points.astype(float), pixels.astype(float)
    )
    assert misfit < 1.5
