# SPDX-License-Identifier: Apache-2.0
"""Whether a frame tells the leg of the orbit, or only the place of the wall.

Legs of a flipper differ, with the wall at the same place, in whether either edge rotor has
toggled. Which leg it is, is known once both have been seen.
"""

from __future__ import annotations

import numpy as np

from soliton_linkage.estimation.frame_noise import FrameView
from soliton_linkage.estimation.settings import DEFAULTS, TrackingSettings
from soliton_linkage.linkage.chain import Motion, wrapped
from soliton_linkage.orbit.orbit import Orbit


class LegEvidence:
    """Logarithm of how much likelier each edge rotor is on the leg followed than toggled."""

    def __init__(self, orbit: Orbit, settings: TrackingSettings = DEFAULTS.tracking) -> None:
        """Begin with neither edge rotor seen."""
        self._enough = settings.leg_evidence
        self._spinner = orbit.chain.motion is Motion.SPINNER
        edges = []
        for leg in range(orbit.number_of_legs):
            left, right = orbit.background(orbit.arc_at(orbit.middle, leg))
            edges.append([left[0], right[-1]])
        swings = np.abs(wrapped(np.array(edges) - edges[0])).max(axis=0)
        self._squares: list[float] = (swings**2 / 2).tolist()
        self.forget()

    @property
    def known(self) -> bool:
        """Whether no other leg is likely; of spinners the wall itself tells it."""
        return self._spinner or min(self._evidence) > self._enough

    def forget(self) -> None:
        """Begin anew."""
        self._evidence = [0.0, 0.0]

    def update(self, view: FrameView, variance: float) -> None:
        """Take in a frame whose residuals have a variance [rad^2]."""
        if self.known:
            return
        for edge, square in enumerate(self._squares):
            residual = float(view.residuals[-edge])
            if view.outlying[-edge]:
                self._evidence[edge] = 0.0
            elif np.isfinite(residual):
                self._evidence[edge] += square / max(variance, 1e-12)
