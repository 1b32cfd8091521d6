# SPDX-License-Identifier: Apache-2.0
"""Analysis of one frame, the protocol of analysers, and the analyser of unknown chains."""

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
    """Phase of a chain on its orbit; NaN, and leg -1, if unknown.

    phase: phase from 0 to 2 pi over a cycle [rad].
    rate: rate of the phase [rad/s].
    phase_deviation: standard deviation of the phase [rad].
    rate_deviation: standard deviation of the rate [rad/s].
    completed: number of completed cycles since the start; it changes when the phase jumps by 2 pi.
    leg: leg of the cycle; with increasing phase the wall moves away from rotor 0 in even legs.
    """

    phase: float
    rate: float
    phase_deviation: float
    rate_deviation: float
    completed: int
    leg: int


class Analysis(NamedTuple):
    """Analysis of a frame and the preceding ones; unknown quantities are None or NaN.

    motion: class of motion from the parameters of the chain or, if they are unknown, from the
        angles.
    measured_motion: class of motion from the angles alone.
    status: basis of the first wall or, if `solitons` is empty, of the estimate.
    estimate: state on the orbit.
    cycle: phase of the state on the orbit.
    solitons: walls at least half a spacing from the edges, sorted by their site.
    events: newly confirmed events.
    topology: topology of the whole state.
    edge_rotors: edge rotors of the whole state.
    energies: energies of the whole state.
    wobble: wobble beside the wall on the orbit.
    unseen: number of rotors without a reading.
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
    """Return the phase of an estimate in the cycle.

    For spinners that were assembled upside down, the phase decreases with the arc. Thus in both
    assemblies a wall that starts at rotor 0 in the left-leaning state is in leg 0, with increasing
    phase.
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
    """Analyser of the frames of a known or unknown chain, in the order of time."""

    @property
    def limitation(self) -> str:
        """Reason why walls are not located on the orbit of the chain, empty if they are."""

    @property
    def late(self) -> int:
        """Number of frames that were not later than the preceding one."""

    @property
    def late_impulses(self) -> int:
        """Number of impulses that arrived after their frame."""

    @property
    def starts(self) -> int:
        """Number of times that the chain was located on its orbit."""

    @property
    def stamp_error(self) -> float:
        """Standard deviation of the errors of the stamps [s], 0 unless significant."""

    @property
    def rest_angle_error(self) -> float:
        """Common error of the rest angles [rad], 0 unless significant."""

    @property
    def offsets(self) -> Array:
        """Offsets of the encoders [rad], shape (N,), 0 unless significant."""

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
        """Analyse a frame of an instant [ns]; return None unless it is later than the last one."""


class UnknownChainAnalyser:
    """Analyser of a chain whose parameters are unknown; the order of its joints is known.

    It reports the class of motion and an approximate site of the wall: the crossing of u = r
    sin(phi) through 0, which may be more than a spacing from the centre of the wall.
    """

    limitation = 'the parameters of the chain are unknown'
    starts = late_impulses = 0
    stamp_error = rest_angle_error = 0.0

    def __init__(self, number_of_rotors: int) -> None:
        """Start without a frame; raise ValueError for fewer than 2 rotors."""
        if number_of_rotors < 2:
            raise ValueError(f'a chain of {number_of_rotors} joints is too short; give 2 or more')
        self.offsets = np.zeros(number_of_rotors)
        self.offset_deviations = np.full(number_of_rotors, math.nan)
        self._observer = MotionObserver()
        self._clock = FrameClock()

    @property
    def late(self) -> int:
        """Number of frames that were not later than the preceding one."""
        return self._clock.late

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame as `Analyser.analyse` does, without rates and deviations."""
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
    """Return a wall with only a site and a charge, or no wall if the site is NaN."""
    if math.isnan(site):
        return ()
    leans = np.sin(staggered(angles))[: math.floor(site) + 1]
    charge = 1 if np.nansum(leans) > 0 else -1
    nan = math.nan
    return (AnalysedSoliton(0, site, nan, nan, nan, nan, charge, nan, nan, nan),)
