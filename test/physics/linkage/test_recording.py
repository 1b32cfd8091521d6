# SPDX-License-Identifier: Apache-2.0
"""A recording holds arrays that fit each other and times that increase, or is refused."""

import math
import re

import numpy as np
import pytest

from soliton_linkage.linkage.recording import Recording

TIMES = np.array([0.0, 0.1, 0.3])
ANGLES = np.zeros((3, 4))


def test_angles_with_rates_or_without_are_accepted():
    for rates in [np.ones((3, 4)), np.empty((0, 4))]:
        recording = Recording(TIMES, ANGLES, rates)
        assert recording.times is TIMES
        assert recording.angles is ANGLES
        assert recording.rates is rates


def test_a_recording_of_no_frames_is_one():
    assert len(Recording(np.empty(0), np.empty((0, 4)), np.empty((0, 4))).times) == 0


def test_angles_and_rates_of_another_shape_are_rejected():
    for shape in [(2, 4), (4, 4), (3,), (3, 3), (3, 4, 1), (0, 3), ()]:
        if shape != (3, 3):
            with pytest.raises(
                ValueError, match=re.escape(f'angles of shape {shape} do not fit 3')
            ):
                Recording(TIMES, np.zeros(shape), np.empty((0, 4)))
        complaint = re.escape(f'rates of shape {shape} do not fit angles of shape (3, 4)')
        with pytest.raises(ValueError, match=complaint):
            Recording(TIMES, ANGLES, np.zeros(shape))


def test_invalid_times_are_rejected_by_frame():
    for frame, time, complaint in [
        *((1, late, 'is not later than') for late in (0.0, -0.1, 0.3)),
        *((n, bad, 'must be a finite') for n in range(3) for bad in (math.nan, math.inf)),
    ]:
        times = np.array([0.0, 0.1, 0.3])
        times[frame] = time
        named = 2 if time == 0.3 else frame
        with pytest.raises(ValueError, match=f'time of frame {named} = .* {complaint}'):
            Recording(times, ANGLES, ANGLES)
