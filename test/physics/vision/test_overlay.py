# SPDX-License-Identifier: Apache-2.0
"""Overlays are drawn at the measured positions."""

import math

import numpy as np
import pytest

from soliton_linkage.vision.angle_camera import AngleFrame
from soliton_linkage.vision.overlay import WallMark, draw_overlay

pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
ROTORS = 5
NAMES = [f'rotor_{rotor}' for rotor in range(ROTORS)]
PICTURE = np.full((300, 600, 3), 128, dtype=np.uint8)
PIVOTS = np.column_stack([100.0 * np.arange(1, ROTORS + 1), np.full(ROTORS, 150.0)])


def frame(hidden: int | None = None, length: float = 40.0) -> AngleFrame:
    """Return a frame of upright rotors of a length [pixels]; one rotor may be hidden."""
    masses = PIVOTS - [0.0, length]
    angles = np.zeros(ROTORS)
    if hidden is not None:
        masses[hidden], angles[hidden] = np.nan, np.nan
    dots = np.array([[20.0, 20.0]])
    status = '' if hidden is None else f'1 of {ROTORS} rotors are hidden'
    return AngleFrame(0.0, angles, 0 * angles, masses, PIVOTS, dots, status)


def painted(picture: np.ndarray) -> np.ndarray:
    return np.any(picture != PICTURE, axis=2)


def test_rings_and_lines_mark_the_measurement_in_a_copy_of_the_picture():
    drawn = draw_overlay(PICTURE, frame(), NAMES)
    assert (PICTURE == 128).all()
    marks = painted(drawn)
    for x, y in PIVOTS:
        assert marks[int(y) - 20, int(x)], 'line of a rotor'
        assert not marks[int(y) - 20, int(x) + 30], 'beside a rotor'
    assert marks[10:31, 10:31].any(), 'dot of the frame'
    assert painted(draw_overlay(PICTURE, frame(2), NAMES))[115:140].sum() < marks[115:140].sum()


def test_the_distance_of_names_does_not_depend_on_the_length_of_rotors():
    short, long = (painted(draw_overlay(PICTURE, frame(None, each), NAMES)) for each in (40, 110))
    assert short[220:270].any()
    assert (short == long)[180:280].all()


def test_a_wall_is_drawn_between_its_rotors():
    for rotor in [0.0, 1.25, 3.5]:
        without = draw_overlay(PICTURE, frame(), NAMES)
        drawn = draw_overlay(PICTURE, frame(), NAMES, [WallMark(rotor, 0.02, 1)])
        changed = np.flatnonzero(np.any(drawn[125] != without[125], axis=1))
        assert changed.mean() == pytest.approx(100 * (1 + rotor), abs=1.5)


def test_walls_without_position_and_frames_without_rotors_draw_nothing():
    unplaced = WallMark(math.nan, math.nan, -1)
    assert (
        draw_overlay(PICTURE, frame(), NAMES, [unplaced]) == draw_overlay(PICTURE, frame(), NAMES)
    ).all()
    none = np.full((ROTORS, 2), np.nan)
    empty = AngleFrame(0.0, none[:, 0], none[:, 0], none, none, np.zeros((0, 2)), 'no markers')
    grey = draw_overlay(PICTURE[..., 0], empty, NAMES, [WallMark(1.0, 0.1, 1)])
    assert not painted(grey)[:250].any()
