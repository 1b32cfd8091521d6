# SPDX-License-Identifier: Apache-2.0
"""What frames show of a chain of which nothing is known but the order of its joints."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.analysis import Analysis, cycle_phase
from soliton_linkage.estimation.frame_clock import FrameClock
from soliton_linkage.estimation.motion_class import MotionObserver
from soliton_linkage.estimation.places.orbit_estimate import TrackingStatus, lost
from soliton_linkage.estimation.walls.analysed_soliton import AnalysedSoliton
from soliton_linkage.linkage.chain import Array, check_shape, staggered


class UnknownChainAnalyser:
    """Analyses the frames of a chain of which only the order of its joints is known.

    It tells how a wall moves and about where it is: where u = r sin(phi) changes its sign, which
    may be more than a rotor spacing from the centre of the wall.
    """

    limitation = 'the parameters of the chain are not known'
    starts = late_pushes = 0

    def __init__(self, number_of_rotors: int) -> None:
        """Raises ValueError for fewer than 2 rotors."""
        if number_of_rotors < 2:
            raise ValueError(f'{number_of_rotors} joints are no chain; name 2 or more')
        self.offsets = np.zeros(number_of_rotors)
        self.offset_deviations = np.full(number_of_rotors, math.nan)
        self._observer = MotionObserver()
        self._clock = FrameClock()

    @property
    def late(self) -> int:
        """Number of frames that were not later than the one before."""
        return self._clock.late

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame, as `Analyser.analyse`; rates and deviations say nothing here."""
        check_shape(angles, len(self.offsets), 'angle')
        if not self._clock.advance(stamp):
            return None
        if self._clock.restarted:
            self._observer.restart()
        seen = np.where(np.isfinite(angles), angles, np.nan)
        measured = self._observer.observe(seen)
        return Analysis(
            motion=measured.motion,
            measured_motion=measured,
            status=TrackingStatus.LOST,
            estimate=lost(self._clock.time),
            cycle=cycle_phase(lost(self._clock.time), None),
            solitons=_crossing(self._observer.evidence.place, seen),
            unseen=int(np.count_nonzero(np.isnan(seen))),
        )


def _crossing(place: float, angles: Array) -> tuple[AnalysedSoliton, ...]:
    """A wall of which nothing but about where it is and its charge are known; none for NaN."""
    if math.isnan(place):
        return ()
    leans = np.sin(staggered(angles))[: math.floor(place) + 1]
    charge = 1 if np.nansum(leans) > 0 else -1
    nan = math.nan
    return (AnalysedSoliton(0, place, nan, nan, nan, nan, charge, nan, nan, nan),)
