# SPDX-License-Identifier: Apache-2.0
"""Whether what rotors about a wall tell is believed, and whether they are off by a strain."""

from __future__ import annotations

import numpy as np

from soliton_linkage.estimation.places.frame_view import FrameLikelihood, FrameView
from soliton_linkage.estimation.settings import EstimationSettings


class FrameTrust:
    """Tells strains from readings that are wrong, by how rotors were off before."""

    def __init__(
        self, rotors: int, likelihood: FrameLikelihood, settings: EstimationSettings
    ) -> None:
        """Begin with none off."""
        self._likelihood = likelihood
        self._settings, self._frames = settings.likelihood, settings.tracking.strained_frames
        self._never = np.zeros(rotors, dtype=np.int64)
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._strained = self._never

    def is_believed(self, view: FrameView) -> bool:
        """Whether most of what the rotors about the wall tell is believed."""
        return view.information >= self._settings.believed * view.information_of_all

    def is_strained(self, view: FrameView) -> bool:
        """Whether a wall is off as by a push: several rotors side by side, or one for a while.

        They are no further off than springs could have them, and most of the wall is seen.
        """
        if self.is_believed(view) or not view.information_of_all > self._settings.believed:
            self._strained = self._never
            return False
        off = view.outlying & (np.abs(view.residuals) < self._likelihood.gross)
        self._strained = np.where(off, self._strained + 1, 0)
        run = off[:-2] & off[1:-1] & off[2:]
        return bool(run.any() or (self._strained >= self._frames).any())
