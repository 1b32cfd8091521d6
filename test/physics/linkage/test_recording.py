# SPDX-License-Identifier: Apache-2.0
"""A recording holds arrays that fit each other and times that increase, or is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from soliton_linkage.linkage.recording import Recording

TIMES = np.array([0.0, 0.1, 0.3])
ANGLES = np.zeros((3, 4))


@pytest.mark.parametrize('rates', [np.ones((3, 4)), np.empty((0, 4))])
def test_angles_with_rates_or_without_are_accepted(rates: np.ndarray) -> None:
    recording = Recording(TIMES, ANGLES, rates)
    assert recording.times is TIMES
    assert recording.angles is ANGLES
    assert recording.rates is rates


def test_a_recording_of_no_frames_is_one() -> None:
    assert len(Recording(np.empty(0), np.empty((0, 4)), np.empty((0, 4))).times) == 0


@pytest.mark.parametrize('shape', [(2, 4), (4, 4), (3,), (3, 4, 1), ()])
def test_angles_that_are_not_a_row_a_frame_are_rejected_with_their_shape(
    shape: tuple[int, ...],
) -> None:
    complaint = re.escape(f'angles of shape {shape} do not fit 3 times')
    with pytest.raises(ValueError, match=complaint):
        Recording(TIMES, np.zeros(shape), np.empty((0, 4)))


@pytest.mark.parametrize('shape', [(2, 4), (3, 3), (0, 3), (0,), (1, 4)])
def test_rates_that_do_not_fit_the_angles_are_rejected_with_both_shapes(
    shape: tuple[int, ...],
) -> None:
    complaint = re.escape(f'rates of shape {shape} do not fit angles of shape (3, 4)')
    with pytest.raises(ValueError, match=complaint):
        Recording(TIMES, ANGLES, np.zeros(shape))


@pytest.mark.parametrize(('late', 'frame'), [(0.0, 1), (-0.1, 1), (0.3, 2), (0.4, 2)])
def test_times_that_do_not_increase_are_rejected_by_frame(late: float, frame: int) -> None:
    with pytest.raises(ValueError, match=f'time of frame {frame} = .* is not later than'):
        Recording(np.array([0.0, late, 0.3]), ANGLES, ANGLES)


@pytest.mark.parametrize('frame', [0, 1, 2])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_times_that_are_not_finite_are_rejected_by_frame(frame: int, value: float) -> None:
    times = TIMES.copy()
    times[frame] = value
    with pytest.raises(ValueError, match=f'time of frame {frame} = {value} s must be a finite'):
        Recording(times, ANGLES, ANGLES)
