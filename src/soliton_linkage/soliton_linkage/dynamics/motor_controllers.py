# SPDX-License-Identifier: Apache-2.0
"""Feedback law of the motors, which computes torques from measured angles.

The motors apply constant torques from each frame to the next. They use the frame that was measured
`delay` frames ago. In this frame, q_n is the coordinate of rotor n (see `Chain.signs`). The rate
v_n is the change of q_n from the frame before to this frame, divided by the time between these two
frames. With q_ref = `Feedback.reference`, the torque on the coordinate of rotor n is

    -K (q_n - q_ref) - D v_n + K_l (q_{n-1} - q_n) + K_r (q_{n+1} - q_n)
    + D_l (v_{n-1} - v_n) + D_r (v_{n+1} - v_n),

with the gains of `Feedback`: K and D for the rotor itself, K_l and D_l for its left neighbour, K_r
and D_r for its right neighbour. Differences of coordinates are wrapped to the interval from -pi to
pi. At a free end, the terms of the missing neighbour are omitted. The gains of each motor are
multiplied by its element of `Chain.feedback_strengths`. The absolute value of the torque is
limited to `Feedback.limit`. `Simulation` and the node `serial_encoders` compute the same law.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain, wrapped


class MotorControllers:
    """Controllers of the motors of a chain; their input is only the angles in each frame."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._frames: deque[tuple[float, Array]] = deque(maxlen=chain.feedback.delay + 2)

    def torques(self, time: float, angles: Array) -> Array:
        """Return the torque of each motor [N m], shape (N,), from this frame to the next.

        `angles` [rad], shape (N,), are measured at `time` [s]. The law uses the frame `delay`
        frames ago and the frame before it. If the angle of a rotor is missing (NaN) in one of
        these two frames, the torques of this rotor and of its neighbours are 0. All torques are 0
        in the first `delay` + 1 frames.
        """
        self._frames.append((time, angles))
        if len(self._frames) < self._chain.feedback.delay + 2:
            return np.zeros_like(angles)
        (before, then), (now, measured) = self._frames[0], self._frames[1]
        rates = (measured - then) / (now - before)
        return np.nan_to_num(feedback_torques(self._chain, measured, rates))


def feedback_torques(chain: Chain, angles: Array, rates: Array, contraction: float = 1.0) -> Array:
    """Return the torques [N m] of the feedback law for given angles and rates, shape (N,).

    `angles` may contain a wall at rest instead of a moving wall. `contraction` is the width of the
    wall at rest, divided by the width of the moving wall [1]. The differences between the
    coordinates of neighbours are multiplied by this ratio.
    """
    signs, law, bonds = chain.signs, chain.feedback, chain.number_of_springs
    q, v = signs * angles + (1 - signs) * (np.pi / 2), signs * rates
    of_own = -law.angle * wrapped(q - law.reference) - law.rate * v
    bends = contraction * wrapped(np.roll(q, -1) - q)[:bonds]
    shears = (np.roll(v, -1) - v)[:bonds]
    of_others = chain.gathered(
        law.right_angle * bends + law.right_rate * shears,
        -law.left_angle * bends - law.left_rate * shears,
    )
    torques = signs * chain.feedback_strengths * (of_own + of_others)
    return np.clip(torques, -law.limit, law.limit)
