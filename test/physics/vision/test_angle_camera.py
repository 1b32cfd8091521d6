# SPDX-License-Identifier: Apache-2.0
"""Measured angles in rendered films with known angles."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from filmed_chains import CAMERA, PERIOD, exact_layout, renderer, swinging

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.vision.angle_camera import AngleCamera, AngleFrame
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.opencv import Picture
from soliton_linkage.vision.video import TimedPicture, read_video, write_video
from soliton_linkage_studies.camera.renderer import Hand

cv2 = pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
CHAIN = Chain(number_of_rotors=10)
TIMES = PERIOD * np.arange(24)


@cache
def swing(hands: tuple[Hand, ...] = ()) -> list[Picture]:
    _, film, _ = renderer(CHAIN, hands=hands)
    return [film.picture(time) for time in TIMES.tolist()]


def measure(pictures: Sequence[Picture]) -> tuple[AngleCamera, list[AngleFrame], np.ndarray]:
    """Return the camera, its frames and the errors of the angles [rad], (frames, N)."""
    camera = AngleCamera(exact_layout(CHAIN), CAMERA)
    times = TIMES[: len(pictures)]
    seen = [camera.measure(time, each) for time, each in zip(times, pictures, strict=True)]
    truth = swinging(CHAIN, 0.15, 12.0)(times + np.array([frame.delay for frame in seen]))[0]
    return camera, seen, np.array([frame.angles for frame in seen]) - truth


def test_errors_of_angles_agree_with_the_stated_deviations_and_have_no_bias():
    _, seen, errors = measure(swing())
    assert np.isfinite(errors).all()
    errors, stated = errors[3:], np.array([frame.deviations for frame in seen[3:]])
    own = errors - errors.mean(axis=0)
    assert np.sqrt(np.mean(own**2)) < 1e-3
    assert 0.85 < np.sqrt(np.mean((errors / stated) ** 2)) < 1.15
    assert abs(errors.mean()) < 0.1 * np.sqrt(np.mean(own**2))


def test_dots_that_differ_within_their_sheets_increase_the_stated_deviations():
    layout, film, _ = renderer(CHAIN)
    shifts = np.random.default_rng(2).normal(0, 1e-4, layout.frame_dots.shape)
    stated = []
    for moved in (0 * shifts, shifts):
        # The layout of the camera differs from the printed one by the shifts of the dots.
        own = exact_layout(CHAIN)
        object.__setattr__(own, 'frame_dots', layout.frame_dots + moved)
        camera = AngleCamera(own, CAMERA)
        for time in TIMES[:4].tolist():
            frame = camera.measure(time, film.picture(time))
        stated.append(frame.deviations)
        error = camera.frame_markers.fit_error
    scale = np.median(camera.frame_markers.plane.pixels_per_metre(camera.pivots.positions))
    assert error == pytest.approx(1e-4 * scale, rel=0.3)
    assert (stated[1] > stated[0]).all()


def test_errors_in_a_compressed_clip_are_small_and_correlated(tmp_path):
    layout, film, motion = renderer(CHAIN, amplitude=0.02, rate=3.0)
    shots = (TimedPicture(time, film.picture(time)) for time in TIMES.tolist())
    write_video(tmp_path / 'clip.mp4', shots, 18)
    camera = AngleCamera(layout, CAMERA)
    pictures = read_video(tmp_path / 'clip.mp4').pictures
    seen = [camera.measure(time, picture) for time, picture in pictures]
    truth = motion(TIMES + np.array([frame.delay for frame in seen]))[0]
    errors = np.array([frame.angles for frame in seen]) - truth
    assert np.abs(errors).max() < 0.01
    own = errors[3:] - errors[3:].mean(axis=0)
    assert np.sqrt(np.mean(own**2)) < 2.5e-3
    assert 0.5 < np.mean(own[1:] * own[:-1]) / np.mean(own**2) < 0.95
    assert np.sqrt(np.mean((own / [frame.deviations for frame in seen[3:]]) ** 2)) < 3.5


def test_hidden_rotors_are_nan_and_return_with_their_turns():
    hand = Hand(6 * PERIOD, 12 * PERIOD, (250.0, 180.0), (0.0, 0.0), (45.0, 60.0))
    _, seen, errors = measure(swing((hand,)))
    hidden = np.isnan(errors)
    assert not hidden[:6].any()
    assert hidden[7:12].any(axis=1).all()
    assert not hidden[14:].any()
    assert np.nanmax(np.abs(errors)) < 0.02
    assert 'hidden' in seen[8].status
    assert not seen[-1].status


def test_a_motion_of_the_camera_is_detected_and_angles_stay_correct():
    pushed = [np.roll(picture, (2, 3), axis=(0, 1)) for picture in swing()[8:16]]
    camera, _, errors = measure([*swing()[:8], *pushed])
    assert camera.frame_markers.moves == 1
    assert camera.frame_markers.shift == pytest.approx(np.hypot(2, 3), abs=0.1)
    assert np.abs(errors[-1]).max() < 0.01


def test_the_status_without_markers_names_the_remedy():
    seen = AngleCamera(MarkerLayout(CHAIN), CAMERA).measure(
        0.0, np.full((360, 640, 3), 128, dtype=np.uint8)
    )
    assert np.isnan(seen.angles).all()
    assert 'show two or more complete markers' in seen.status


def test_a_picture_of_another_size_is_rejected():
    with pytest.raises(ValueError, match=r'shape \(360, 641, 3\) does not match the camera'):
        AngleCamera(MarkerLayout(CHAIN), CAMERA).measure(
            0.0, np.zeros((360, 641, 3), dtype=np.uint8)
        )
