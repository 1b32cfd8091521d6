# SPDX-License-Identifier: Apache-2.0
"""Result of an analysis, interface of analysers, and analyser for chains of unknown parameters."""

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
    """Phase of a chain in the cycle of its orbit; unknown quantities are NaN.

    phase: phase [rad]; it increases from 0 to 2 pi during each cycle.
    rate: rate of change of the phase [rad/s].
    phase_deviation: standard deviation of the phase [rad].
    rate_deviation: standard deviation of the rate of the phase [rad/s].
    completed: number of completed cycles of the phase; 0 in the cycle between the arc length 0 and
        the length of the orbit, negative in earlier cycles, and 0 if the phase is unknown.
    leg: number of the current leg (one passage of the wall along the chain); -1 if unknown. While
        the phase increases, the wall moves away from rotor 0 in even legs, and towards rotor 0 in
        odd legs.
    """

    phase: float
    rate: float
    phase_deviation: float
    rate_deviation: float
    completed: int
    leg: int


class Analysis(NamedTuple):
    """Result of the analysis of a frame; unknown quantities are None or NaN.

    motion: class of motion; it follows from the parameters of the chain if they are known, and is
        estimated from the angles otherwise.
    measured_motion: class of motion from the angles alone.
    status: if fits of wall shapes have found the walls, tracking status of the wall nearest to
        rotor 0; otherwise the status of `estimate`.
    estimate: estimated state of the chain on its orbit.
    cycle: phase of the chain in the cycle of its orbit.
    solitons: walls that are at least half a rotor spacing from the edges, sorted by their site.
    events: events that this frame has confirmed.
    topology: polarisations, winding numbers, charge and zero mode; None for a ring.
    edge_rotors: states of the first and the last rotor.
    energies: kinetic and elastic energies of the chain.
    wobble: amplitude, decay length and wavelength of the deviations of the rotors beside the wall
        from the uniform states; None unless the frame shows exactly one wall.
    unseen: number of rotors whose readings are missing or implausible.
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
    """Return the phase in the cycle of the orbit.

    In an upside-down spinner, the phase increases while the arc length decreases. With this
    convention, the rotors of all spinners turn in the same sense while the phase increases.
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


class AnalyserDiagnostics(NamedTuple):
    """Counters of an analyser, and estimated errors of the readings.

    An estimated error is 0 if it is not significant.

    offsets: estimated offset of each encoder [rad], shape (N,).
    offset_deviations: standard deviation of each offset [rad], shape (N,); NaN without an orbit.
    late: number of frames rejected because their stamps did not increase.
    late_impulses: number of impulses ignored because their stamps were not after the last frame.
    starts: number of times that a search has located the chain on its orbit.
    stamp_error: estimated standard deviation of the errors of the frame stamps [s].
    rest_angle_error: estimated error of the rest angle, common to all rotors [rad].
    """

    offsets: Array
    offset_deviations: Array
    late: int
    late_impulses: int = 0
    starts: int = 0
    stamp_error: float = 0.0
    rest_angle_error: float = 0.0


class FrameAnalyser(Protocol):
    """Interface of an analyser that receives the frames of a chain in the order of their time."""

    @property
    def limitation(self) -> str:
        """Reason why the analyser cannot locate walls on an orbit; an empty string if it can."""

    @property
    def diagnostics(self) -> AnalyserDiagnostics:
        """Counters of the analyser, and estimated errors of the readings."""

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame that was measured at a time `stamp` [ns]; return None if it is late."""


class UnknownChainAnalyser:
    """Analyser of a chain with unknown parameters; only the order of the joints is known.

    The wall is where the horizontal displacement u = r sin(phi) of the rotor tips changes its
    sign. The error of this position may exceed one rotor spacing.
    """

    limitation = 'the parameters of the chain are unknown'

    def __init__(self, number_of_rotors: int) -> None:
        """Start without frames; raise ValueError if the chain has fewer than 2 rotors."""
        if number_of_rotors < 2:
            raise ValueError(f'a chain of {number_of_rotors} joints is too short; give 2 or more')
        self._rotors = number_of_rotors
        self._observer = MotionObserver()
        self._clock = FrameClock()

    @property
    def diagnostics(self) -> AnalyserDiagnostics:
        """Number of late frames; this analyser does not estimate the errors of the readings."""
        unknown = np.full(self._rotors, math.nan)
        return AnalyserDiagnostics(np.zeros(self._rotors), unknown, self._clock.late)

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame as `Analyser.analyse` does, but ignore rates and standard deviations."""
        check_shape(angles, self._rotors, 'angle')
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
    if math.isnan(site):
        return ()
    leans = np.sin(staggered(angles))[: math.floor(site) + 1]
    charge = 1 if np.nansum(leans) > 0 else -1
    nan = math.nan
    return (AnalysedSoliton(0, site, nan, nan, nan, nan, charge, nan, nan, nan),)
