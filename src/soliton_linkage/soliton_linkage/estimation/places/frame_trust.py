# SPDX-License-Identifier: Apache-2.0
"""Whether a frame is that of a wall: which readings may be wrong, and which are strains."""

from __future__ import annotations

import numpy as np

from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.estimation.places.frame_view import FrameLikelihood, FrameView
from soliton_linkage.estimation.settings import EstimationSettings


class FrameTrust:
    """Tells frames of a wall from others, by how rotors were off before."""

    def __init__(
        self, rotors: int, likelihood: FrameLikelihood, settings: EstimationSettings
    ) -> None:
        """Begin with none off."""
        self._likelihood = likelihood
        self._settings, self._frames = settings.likelihood, settings.tracking.strained_frames
        self._none_off = np.zeros(rotors, dtype=np.bool_)
        self._never = np.zeros(rotors, dtype=np.int64)
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._off, self._strained = self._none_off, self._never

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

    def is_explained(self, view: FrameView, largest: float, doubtful: Flags) -> bool:
        """Whether a frame is that of a wall, with the largest variance of a rotor [rad^2].

        Readings that are wrong at random are so in one frame; rotors that are far off in two
        running are elsewhere, unless they are doubtful.
        """
        off, staying = self._none_off, 0
        if view.off:
            off = view.outlying & (np.abs(view.residuals) > self._likelihood.gross) & ~doubtful
            staying = int(np.count_nonzero(off & self._off))
        self._off = off
        few = staying <= self._settings.most_staying
        return few and self._likelihood.explains(view, largest)
