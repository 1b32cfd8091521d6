# SPDX-License-Identifier: Apache-2.0
"""How sure each reading of a frame is beside others, where who reads says so.

The likelihood of a frame has one variance. Of a reading whose deviation is s times the usual one
both difference and tangent are divided by s, so that it weighs 1 / s^2.
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
    """Deviations of readings in units of the usual one, of which the estimated noise is."""

    def __init__(self, usual: float | None = None) -> None:
        """Take this for the usual deviation [rad], or that of the first frame that tells any.

        Of a frame it is that with which all of its readings would tell as much, by the mean of
        1 / sigma^2.
        """
        self._usual = usual

    def of_frame(self, deviations: Array | None) -> Array | None:
        """Scale of each reading [1], shape (N,), 1 where its deviation [rad] is NaN.

        None where all are 1.
        """
        if deviations is None:
            return None
        known = np.isfinite(deviations)
        if not known.any():
            return None
        if self._usual is None:
            self._usual = 1 / math.sqrt(float(np.mean(deviations[known] ** -2)))
        return np.where(known, deviations / self._usual, 1.0)
