# SPDX-License-Identifier: Apache-2.0
"""What the frames of a window say of a chain, its begin being eliminated.

With the normal equations of a window in blocks of the chain q and its begin s,

    (A_qq - A_qs A_ss^-1 A_sq) dq = b_q - A_qs A_ss^-1 b_s

adds up to what all windows say of the chain, and ds = A_ss^-1 (b_s - A_sq dq).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.geometry.lengths import OF_A_ROTOR
from soliton_linkage.identification.motion.free_motion import frames_with_changes
from soliton_linkage.identification.motion.windows import FreeWindow
from soliton_linkage.linkage.chain import Array

_UNSURE = 10.0
"""Standard deviation of a begin that no reading tells [rad], [rad/s]: more than rotors do."""


class Eliminated(NamedTuple):
    """What a window says of the chain, and how its begin follows from that."""

    matrix: Array
    """(Q - 2 N, Q - 2 N)."""
    vector: Array
    """(Q - 2 N,)."""
    begin: Array
    """A_ss^-1 b_s, (2 N,)."""
    across: Array
    """A_ss^-1 A_sq, (2 N, Q - 2 N)."""
    gain: float
    """b_s A_ss^-1 b_s: what the squares lose by the begin where the chain keeps still [1]."""

    def change(self, of_chain: Array) -> Array:
        """Change of all unknowns of the window, (Q,), given that of the chain."""
        return np.concatenate([of_chain, self.begin - self.across @ of_chain])


class WindowEquations(NamedTuple):
    """Normal equations of a window, for readings of unit variance; its begin is at the end."""

    matrix: Array
    """(Q, Q)."""
    vector: Array
    """(Q,)."""
    squares: float
    """Of what is left of the readings [rad^2]."""

    def eliminated(self, rotors: int, noise: float, damping: float) -> Eliminated:
        """Eliminate the begin, for a noise of readings [rad], with a damped step [1]."""
        matrix, vector = self.matrix / noise**2, self.vector / noise**2
        size = len(vector) - 2 * rotors
        begin = matrix[size:, size:] * (1 + damping * np.eye(2 * rotors))
        begin += np.eye(2 * rotors) / _UNSURE**2
        across = np.asarray(np.linalg.solve(begin, matrix[size:, :size]))
        moved = np.asarray(np.linalg.solve(begin, vector[size:]))
        return Eliminated(
            matrix[:size, :size] - matrix[:size, size:] @ across,
            vector[:size] - matrix[:size, size:] @ moved,
            moved,
            across,
            float(vector[size:] @ moved),
        )


def window_equations(
    window: FreeWindow, times: Array, readings: Array, spreads: Array
) -> WindowEquations:
    """Normal equations of a window of all readings [rad] and their spreads [1], (T, N)."""
    rotors = np.arange(readings.shape[1])
    rows, angles = [], []
    for frame, x in frames_with_changes(window.motion, times[window.frames]):
        x[rotors, OF_A_ROTOR * rotors + 1] += 1
        rows.append(x)
        angles.append(frame)
    left = readings[window.frames] - window.motion.lengths.offsets - np.array(angles)
    seen = np.isfinite(left)
    weights = 1 / spreads[window.frames][seen]
    slopes, errors = np.array(rows)[seen] * weights[:, None], left[seen] * weights
    return WindowEquations(slopes.T @ slopes, slopes.T @ errors, float(errors @ errors))
