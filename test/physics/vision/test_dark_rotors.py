# SPDX-License-Identifier: Apache-2.0
"""Angles of dark bars on a light background, drawn eight times as large and then reduced."""

from itertools import pairwise

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.vision.camera import uncalibrated_camera
from soliton_linkage.vision.dark_rotors import DarkRotors
from soliton_linkage.vision.layout import MarkerLayout

cv2 = pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
CHAIN = Chain(number_of_rotors=8)
SCALE, FINE, PARTS = 600.0, 8, 8


def drawn(angles: Array, hidden: int | None = None, seed: int = 0) -> np.ndarray:
    """Draw rotors of 30 pixels with thin bonds; one rotor may be covered."""
    picture = np.full((200 * FINE, 520 * FINE), 205.0, dtype=np.float32)
    pivots = np.column_stack([CHAIN.pivots, np.zeros(8)])
    masses = pivots + 0.05 * np.column_stack([np.sin(angles), np.cos(angles)])

    def pixels(point: Array) -> tuple[int, int]:
        at = np.array([50.0, 100.0]) + SCALE * point * [1, -1]
        x, y = ((at + 0.5) * FINE - 0.5) * 2**PARTS
        return round(x), round(y)

    for left, right in pairwise(masses):
        cv2.line(picture, pixels(left), pixels(right), 120.0, FINE, shift=PARTS)
    for pivot, mass in zip(pivots, masses, strict=True):
        cv2.line(picture, pixels(pivot), pixels(mass), 35.0, 7 * FINE, shift=PARTS)
    if hidden is not None:
        cv2.circle(picture, pixels(pivots[hidden]), 40 * FINE << PARTS, 205.0, -1, shift=PARTS)
    small = cv2.resize(picture, None, fx=1 / FINE, fy=1 / FINE, interpolation=cv2.INTER_AREA)
    noise = 2.0 * np.random.default_rng(seed).normal(size=small.shape)
    return np.clip(np.rint(small + noise), 0, 255).astype(np.uint8)


def test_errors_of_angles_agree_with_the_stated_deviations():
    eye = DarkRotors(MarkerLayout(CHAIN), uncalibrated_camera(520, 200))
    rest, sides = CHAIN.uniform_state(1), (-1.0) ** np.arange(8)
    errors, stated = [], []
    for frame in range(20):
        angles = rest + 0.15 * sides * np.sin(0.3 * frame)
        seen = eye.measure(frame / 60, drawn(angles, seed=frame))
        errors.append(seen.angles - angles)
        stated.append(seen.deviations)
    assert np.sqrt(np.mean(np.square(errors))) < 0.002
    assert 0.7 < np.sqrt(np.mean((np.array(errors) / stated)[5:] ** 2)) < 1.5
    assert not seen.status


def test_a_hidden_rotor_is_nan_and_the_others_keep_their_numbers():
    eye = DarkRotors(MarkerLayout(CHAIN), uncalibrated_camera(520, 200))
    rest = CHAIN.uniform_state(1)
    eye.measure(0.0, drawn(rest))
    seen = eye.measure(1 / 60, drawn(rest, hidden=4))
    assert np.isnan(seen.angles[4])
    clear = [0, 1, 2, 6, 7]
    assert np.abs(seen.angles - rest)[clear].max() < 0.05
    assert 'hidden' in seen.status


def test_the_status_reports_too_few_rotors():
    eye = DarkRotors(MarkerLayout(CHAIN), uncalibrated_camera(520, 200))
    seen = eye.measure(0.0, drawn(CHAIN.uniform_state(1), hidden=4))
    assert np.isnan(seen.angles).all()
    assert 'of 8 dark rotors' in seen.status
