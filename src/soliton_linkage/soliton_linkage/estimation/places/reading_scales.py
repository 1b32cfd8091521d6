# SPDX-License-Identifier: Apache-2.0
"""How sure each reading of a frame is beside others, where who reads says so.

The likelihood of a frame has one variance V, of noise sigma^2 and of what is beside the orbit. A
reading whose deviation is r times the usual one has V + (r^2 - 1) sigma^2 = s^2 V. Its difference
and its tangent are divided by s, so that it weighs 1 / s^2.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.linkage.chain import Array, check_shape


def check_deviations(deviations: Array, rotors: int) -> Array:
    """Deviations of readings [rad], shape (N,), NaN where unknown, as a contiguous array.

    Raises ValueError for another shape, and where one is infinite or not above 0.
    """
    deviations = np.ascontiguousarray(deviations, dtype=np.float64)
    check_shape(deviations, rotors, 'deviation')
    wrong = np.flatnonzero((deviations <= 0) | np.isinf(deviations))
    if len(wrong):
        rotor = int(wrong[0])
        raise ValueError(
            f'deviation of the angle of rotor {rotor} = {deviations[rotor]:g} rad must be finite '
            'and above 0; give NaN where it is not known'
        )
    return deviations


class ReadingScales:
    """Deviations of the readings of a frame from the orbit, in units of a usual one."""

    def __init__(self, usual: float | None = None) -> None:
        """Take this for the usual deviation [rad], or that of the first frame that tells any.

        Of a frame it is that with which all of its readings would tell as much, by the mean of
        1 / sigma^2.
        """
        self._usual = usual
        self._squares: Array | None = None

    def take(self, deviations: Array | None) -> None:
        """Take the deviations of a frame [rad], shape (N,), NaN of usual readings, None of all."""
        self._squares = None
        if deviations is None:
            return
        known = np.isfinite(deviations)
        if not known.any():
            return
        if self._usual is None:
            self._usual = 1 / math.sqrt(float(np.mean(deviations[known] ** -2)))
        self._squares = np.where(known, (deviations / self._usual) ** 2, 1.0)

    def of_frame(self, noise: float, variance: float) -> Array | None:
        """Scale of each reading [1], shape (N,), None where all are 1.

        The variance of a usual one from the orbit [rad^2] is that of its noise and of what is
        beside the orbit, which does not change with the reading.
        """
        if self._squares is None:
            return None
        return np.asarray(np.sqrt(1 + (self._squares - 1) * min(noise / variance, 1.0)))
