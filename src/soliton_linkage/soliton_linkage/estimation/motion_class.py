# SPDX-License-Identifier: Apache-2.0
"""How a wall moves, told from the angles alone, without the parameters of their chain.

A wall lies where u = r sin(phi) changes its sign. On its two sides the chain leans to the right
and to the left by the same angle: rotors of a flipper pass from one to the other through the
top or through the bottom, theta_right = -theta_left, and their staggered cosines have the same
sign; those of a spinner turn over, theta_right = theta_left + pi, and they have opposite signs.

A flipper that wobbles leans over by more than its angle at rest beside the wall. Outwards from
one rotor to the next its deviation e from rest goes over, for bars of fixed length and d = 1,
into F(e), `tail_loops.next_deviation`, which has a maximum of 0 at e = 0; for any d the slope
there is

    lambda = (1 - d) / (1 + d),    e' = F(e) + lambda e + ...,

so that a chain wobbles where lambda is below 0. Springs in motion keep the sign of lambda, and may
bend the rest, for which a term in e^2 stands.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.loops import tail_loops
from soliton_linkage.estimation.settings import DEFAULTS, MotionSettings
from soliton_linkage.linkage.chain import Array, Motion


class MotionClass(NamedTuple):
    """Class of motion that the angles speak for.

    motion: none where the data cannot tell: there is no wall, or too much noise.
    confidence: probability of the likeliest class, 0 to 1; the three are equally likely without
        data.
    spinning: probability that the rotors spin, 0 to 1.
    """

    motion: Motion | None
    confidence: float
    spinning: float


class MotionEvidence(NamedTuple):
    """What frames say of the motion together.

    place: where u changes its sign [rotor spacings], in the last frame; NaN without a wall.
    flipping: log likelihood of a flipper less that of a spinner [1], limited for errors that stay
        the same in all frames.
    rest_angle: mean angle that the uniform parts lean by [rad]; NaN without a wall.
    tails: sums of products of (e, e^2, e' - F(e)) over their variance, shape (3, 3).
    tail_ratio: deviation of a rotor over that of its inner neighbour, lambda [1]; NaN where
        unknown.
    tail_ratio_deviation: its standard deviation [1], with what springs in motion may do to it;
        infinite where unknown.
    """

    place: float
    flipping: float
    rest_angle: float
    tails: Array
    tail_ratio: float
    tail_ratio_deviation: float

    def verdict(self, settings: MotionSettings = DEFAULTS.motion) -> MotionClass:
        """Return the class; unknown where none of the three is sure."""
        told = math.isfinite(self.tail_ratio)
        scaled = self.tail_ratio / self.tail_ratio_deviation if told else 0.0
        wobbling = math.erfc(scaled / math.sqrt(2)) / 2
        spinning = 1 / (1 + 2 * math.exp(self.flipping))
        share, motion = (1 - spinning) * (1 - wobbling), Motion.FLIPPER
        if (1 - spinning) * wobbling > share:
            share, motion = (1 - spinning) * wobbling, Motion.WOBBLING_FLIPPER
        if spinning > share:
            share, motion = spinning, Motion.SPINNER
        known = motion if share >= settings.sure else None
        return MotionClass(known, share, spinning)


NO_EVIDENCE = MotionEvidence(math.nan, 0.0, math.nan, np.zeros((3, 3)), math.nan, math.inf)
"""Of no frame."""


class MotionObserver:
    """Adds up the evidence of the frames since the start or the last restart.

    A frame without a wall, with the wall within four rotors of an edge or with too few angles
    known says nothing.
    """

    def __init__(self, settings: MotionSettings = DEFAULTS.motion) -> None:
        """Begin without any frame."""
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Forget all frames, as where the source of the angles has been started anew."""
        self.evidence = NO_EVIDENCE

    def observe(self, angles: Array, noise: float = 0.0) -> MotionClass:
        """Add a frame of angles [rad], shape (N,), NaN where unknown, and return the class.

        Angles may be whole turns apart; the noise [rad], where it is known, is a lower bound of
        what the uniform parts show. Raises ValueError for a noise that is negative or not finite,
        and for angles that are not one row.
        """
        angles = np.asarray(angles, dtype=np.float64, order='C')
        if angles.ndim != 1:
            raise ValueError(f'angles of shape {angles.shape} must be one row, an angle a rotor')
        if not (math.isfinite(noise) and noise >= 0):
            raise ValueError(f'noise = {noise} rad must be a finite number of 0 or more')
        before, tails = self.evidence, self.evidence.tails.copy()
        found, ratio = tail_loops.observe(
            self._settings.record,
            angles,
            noise,
            before.flipping,
            before.rest_angle,
            tails,
        )
        self.evidence = MotionEvidence(*found, tails, *ratio)
        return self.evidence.verdict(self._settings)
