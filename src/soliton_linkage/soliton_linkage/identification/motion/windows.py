# SPDX-License-Identifier: Apache-2.0
"""Windows of frames in which nothing but springs moves rotors, each with a begin of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.motion.free_motion import FreeMotion
from soliton_linkage.linkage.chain import Array

_FIRST = 25
"""Frames of a window to begin with [1]: in half as many rates are unsure, in twice as many walls
of chains that are 5 % off may be lost."""
_OF_RATES = 8
"""Frames by which rates at the begin of a window are told [1]."""
_FEWEST = 100
"""Frames between pushes that count, at least [1]: a wall passes some rotors in them."""
_ARRIVAL = 0.05
"""Time in which a push arrives [s]: commands act when they come, whatever their stamps say."""
_JOINED = 4
"""Windows that are made one [1]: 2 take more rounds, 8 may lose a wall."""


_IN_A_ROW = 0.05
"""Share of the frames, at least, that follow each other as they were recorded [1], where most are
left out for being of rotors at rest."""


class FreeWindow(NamedTuple):
    """Frames in a row of one free motion."""

    frames: slice
    motion: FreeMotion
    """Of which all windows share the chain."""


def free_spans(times: Array, pushes: Sequence[float]) -> list[slice]:
    """Frames between pushes [s], but for times that are too short to tell anything."""
    begins = [-math.inf, *(push + _ARRIVAL for push in sorted(pushes))]
    ends = [*sorted(pushes), math.inf]
    spans = [
        slice(int(np.searchsorted(times, begin, 'right')), int(np.searchsorted(times, end)))
        for begin, end in zip(begins, ends, strict=True)
    ]
    return [span for span in spans if span.stop - span.start >= _FEWEST]


def first_windows(
    times: Array,
    angles: Array,
    chain: FreeMotion,
    pushes: Sequence[float],
    tilt_at: Callable[[float], float] = lambda _: 0.0,
) -> list[FreeWindow]:
    """Short windows between pushes [s], which begin as angles [rad], (T, N), of times [s] do.

    None goes on where frames are left out, for so long that they tell no rates. The chain has a
    tilt [rad] at each instant [s].
    """
    made = []
    whole = free_spans(times, pushes)
    for span in (part for each in whole for part in _without_gaps(times, each)):
        tilted = replace(chain, tilt=tilt_at(float(times[span.start])))
        for begin in range(span.start, span.stop - _FIRST + 1, _FIRST):
            stop = begin + _FIRST
            own = slice(begin, span.stop if span.stop - stop < _FIRST else stop)
            few = slice(begin, begin + _OF_RATES)
            slopes = np.polyfit(times[few] - times[begin], angles[few], 1)
            made.append(FreeWindow(own, replace(tilted, angles=slopes[1], rates=slopes[0])))
    return made


def _without_gaps(times: Array, span: slice) -> list[slice]:
    """Parts of a span between which frames are left out, but for those that tell nothing."""
    between = np.diff(times)
    long = between > _OF_RATES * np.quantile(between, _IN_A_ROW)
    inner = 1 + span.start + np.flatnonzero(long[span.start : span.stop - 1])
    parts = [slice(*each) for each in pairwise([span.start, *inner.tolist(), span.stop])]
    return [part for part in parts if part.stop - part.start >= _FEWEST]


def joined(
    windows: Sequence[FreeWindow], follows: Callable[[FreeWindow, slice], bool]
) -> tuple[FreeWindow, ...]:
    """Windows of which some that follow each other without a frame between are one.

    As long as the motion of the first, in a window with the frames of both, follows those of the
    next.
    """
    made: list[FreeWindow] = []
    count = 0
    for window in windows:
        if made and count < _JOINED and made[-1].frames.stop == window.frames.start:
            whole = FreeWindow(slice(made[-1].frames.start, window.frames.stop), made[-1].motion)
            if follows(whole, window.frames):
                made[-1] = whole
                count += 1
                continue
        made.append(window)
        count = 1
    return tuple(made)
