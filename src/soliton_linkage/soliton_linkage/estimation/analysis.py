# SPDX-License-Identifier: Apache-2.0
"""What an analysis of a frame tells: walls, cycle, and all else."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from soliton_linkage.estimation.estimates import (
    AnalysedSoliton,
    OrbitEstimate,
    SolitonEvent,
    TrackingStatus,
    lost,
)
from soliton_linkage.estimation.frames import FrameClock
from soliton_linkage.estimation.motion_class import MotionClass, MotionObserver
from soliton_linkage.estimation.state_report import EdgeRotors, Energies, Topology
from soliton_linkage.estimation.wobble import Wobble
from soliton_linkage.linkage.chain import Array, Motion, check_shape, staggered
from soliton_linkage.orbit.orbit import Orbit


class CyclePhase(NamedTuple):
    """Where a chain is on its orbit, as a phase; NaN, and leg -1, where it is not known.

    phase: from 0 to 2 pi over a whole cycle [rad].
    rate: rate of the phase [rad/s].
    phase_deviation: standard deviation of the phase [rad].
    rate_deviation: standard deviation of the rate [rad/s].
    completed: whole cycles since the start, with which the phase grows without jumps.
    leg: leg of the cycle: as the phase grows, the wall leaves rotor 0 in even legs.
    """

    phase: float
    rate: float
    phase_deviation: float
    rate_deviation: float
    completed: int
    leg: int


class Analysis(NamedTuple):
    """What a frame shows, in the light of those before; None and NaN for what cannot be told.

    motion: how a wall moves, by the chain's parameters or, where they are not known, by the
        angles.
    measured_motion: the same by the angles alone.
    status: what the first wall rests on, or the place on the orbit where no wall is listed.
    estimate: where the chain is on its orbit.
    cycle: the same in phase.
    solitons: walls half a spacing or more from the edges, in the order of their place.
    events: what is known of late to have happened to walls.
    topology: of the whole state.
    edge_rotors: of the whole state.
    energies: of the whole state.
    wobble: beside the wall that is on the orbit.
    unseen: number of rotors that the frame did not show.
    """

    motion: Motion | None
    measured_motion: MotionClass
    status: TrackingStatus
    estimate: OrbitEstimate
    cycle: CyclePhase
    solitons: tuple[AnalysedSoliton, ...] = ()
    events: tuple[SolitonEvent, ...] = ()
    topology: Topology | None = None
    edge_rotors: EdgeRotors | None = None
    energies: Energies | None = None
    wobble: Wobble | None = None
    unseen: int = 0


def cycle_phase(estimate: OrbitEstimate, orbit: Orbit | None) -> CyclePhase:
    """Phase of the cycle that an estimate is in.

    Of spinners that were assembled upside down it runs against the arc, so that in either family
    the wall that leaves rotor 0 from the left-leaning state does so in leg 0, forwards.
    """
    if orbit is None or not estimate.leg_known:
        return CyclePhase(math.nan, math.nan, math.nan, math.nan, 0, -1)
    scale = 2 * math.pi / orbit.length
    backwards = estimate.upside_down and orbit.chain.motion is Motion.SPINNER
    sense = -1 if backwards else 1
    completed, phase = divmod(sense * scale * estimate.arc, 2 * math.pi)
    return CyclePhase(
        phase=phase,
        rate=sense * scale * estimate.rate,
        phase_deviation=scale * estimate.arc_deviation,
        rate_deviation=scale * estimate.rate_deviation,
        completed=int(completed) + backwards,
        leg=1 - estimate.leg if backwards else estimate.leg,
    )


class FrameAnalyser(Protocol):
    """Analyser of the frames of a chain in the order of their time, known or not."""

    @property
    def limitation(self) -> str:
        """Reason why walls are not placed on the orbit of the chain, empty where they are."""

    @property
    def late(self) -> int:
        """Number of frames that were not later than the one before."""

    @property
    def late_impulses(self) -> int:
        """Number of impulses that were reported after the frame that they acted from."""

    @property
    def starts(self) -> int:
        """Number of times that the chain was found on its orbit."""

    @property
    def offsets(self) -> Array:
        """Offsets of the encoders [rad], shape (N,), 0 where none is significant."""

    @property
    def offset_deviations(self) -> Array:
        """Standard deviations of the offsets [rad], shape (N,)."""

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame of an instant [ns]; return None unless it is later than the last."""


class UnknownChainAnalyser:
    """Analyses the frames of a chain of which only the order of its joints is known.

    It tells how a wall moves and about where it is: where u = r sin(phi) changes its sign, which
    may be more than a rotor spacing from the centre of the wall.
    """

    limitation = 'the parameters of the chain are not known'
    starts = late_impulses = 0

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
            solitons=_crossing(self._observer.evidence.site, seen),
            unseen=int(np.count_nonzero(np.isnan(seen))),
        )


def _crossing(site: float, angles: Array) -> tuple[AnalysedSoliton, ...]:
    """A wall of which nothing but about where it is and its charge are known; none for NaN."""
    if math.isnan(site):
        return ()
    leans = np.sin(staggered(angles))[: math.floor(site) + 1]
    charge = 1 if np.nansum(leans) > 0 else -1
    nan = math.nan
    return (AnalysedSoliton(0, site, nan, nan, nan, nan, charge, nan, nan, nan),)
