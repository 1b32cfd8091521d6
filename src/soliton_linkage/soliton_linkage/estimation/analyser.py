# SPDX-License-Identifier: Apache-2.0
"""What the frames of a chain show, one after the other: the analyser, as it runs live and offline.

Where the frames show one wall that costs nothing it is placed on the orbit of the chain, by all
frames so far. Of several each has a filter of its own, `walls.WallTracker`, which also names them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.completed_frame import (
    CompletedFrame,
    Unwrapper,
    complete,
    on_orbit,
    whole_frame,
)
from soliton_linkage.estimation.loops.frame_loops import all_within
from soliton_linkage.estimation.motion_class import MotionClass, MotionObserver
from soliton_linkage.estimation.orbit_filter import (
    OrbitEstimate,
    OrbitFilter,
    TrackingStatus,
    lost,
)
from soliton_linkage.estimation.pushes import Push, WaitingPushes
from soliton_linkage.estimation.rate_noise import RateNoise
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings
from soliton_linkage.estimation.state_report import (
    ArcRate,
    EdgeRotors,
    Energies,
    FrameErrors,
    FrameState,
    StateReporter,
    Topology,
)
from soliton_linkage.estimation.wall_width import Width, WidthReporter
from soliton_linkage.estimation.walls.soliton_event import SolitonEvent
from soliton_linkage.estimation.walls.wall_frame import WallFrame
from soliton_linkage.estimation.walls.wall_reporter import WallReporter
from soliton_linkage.estimation.walls.wall_track import WallTrack
from soliton_linkage.estimation.wobble import RestingWall, Wobble, WobbleReporter
from soliton_linkage.linkage.chain import Array, Chain, Motion, check_shape, staggered
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.continuum import wall_theory

_NANOSECOND = 1e-9
"""Unit of stamps [s]."""
_NO_WIDTH = Width(math.nan, math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class AnalysedSoliton:
    """One wall; a quantity that cannot be told is NaN, and so is its standard deviation.

    id: its name for as long as it is followed, from 1 on; 0 where walls are not followed.
    rotor: centre in rotor spacings from rotor 0.
    position: centre [m] from the pivot of rotor 0.
    velocity: of the centre [m/s], positive towards the last rotor.
    width: width w of tanh(x / w) [m]; NaN in chains with deviations.
    theory_width: width that the continuum theory gives a wall of this velocity [m].
    charge: +1: leans right on the side of rotor 0 and left beyond, free at rest; -1: the opposite.
    position_deviation: standard deviation of the position [m].
    velocity_deviation: standard deviation of the velocity [m/s].
    width_deviation: standard deviation of the width [m].
    """

    id: int
    rotor: float
    position: float
    velocity: float
    width: float
    theory_width: float
    charge: int
    position_deviation: float
    velocity_deviation: float
    width_deviation: float


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


@dataclass(frozen=True)
class Analysis:
    """What a frame shows, in the light of those before; None and NaN for what cannot be told.

    motion: how a wall moves, by the chain's parameters or, where they are not known, by the
        angles.
    measured_motion: the same by the angles alone.
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
    estimate: OrbitEstimate
    cycle: CyclePhase
    solitons: tuple[AnalysedSoliton, ...]
    events: tuple[SolitonEvent, ...]
    topology: Topology | None
    edge_rotors: EdgeRotors | None
    energies: Energies | None
    wobble: Wobble | None
    unseen: int


class FrameClock:
    """Takes the stamps of frames, and refuses those that are late."""

    def __init__(self, limit: float = DEFAULTS.tracking.clock_limit) -> None:
        """Begin at the first stamp; one that goes back by more than the limit [s] starts anew."""
        self._limit = limit
        self.time = -math.inf
        """Instant of the last frame that was taken, from the first on [s]."""
        self.late = 0
        """Number of frames that were refused."""
        self.restarted = False
        """Whether the last one was by a clock that had been set back."""
        self._epoch: int | None = None

    def advance(self, stamp: int) -> bool:
        """Go on to a stamp [ns]; False where it is not later than the last, by up to the limit."""
        if self._epoch is None:
            self._epoch = stamp
        time = (stamp - self._epoch) * _NANOSECOND
        if -self._limit <= time - self.time <= 0:
            self.late += 1
            return False
        self.restarted = time < self.time
        self.time = time
        return True


class Analyser:
    """Analyses the frames of a chain in the order of their time.

    The deviations of the chain are taken for known. Where a chain has no orbit, as `limitation`
    says, walls are placed by a fit to each frame alone.
    """

    def __init__(
        self,
        chain: Chain,
        noise: float | None = None,
        settings: EstimationSettings = DEFAULTS,
    ) -> None:
        """Work out the orbit of the chain, which may take seconds where it has deviations.

        The noise is the standard deviation of the angles [rad], None to have it estimated.
        Raises ValueError where it is none.
        """
        if noise is not None and not 0 < noise < math.inf:
            raise ValueError(
                f'noise = {noise:g} rad must be finite and above 0; give None to have it estimated'
            )
        self.chain = chain
        self._settings = settings
        self._noise = math.nan if noise is None else noise
        self.limitation = ''
        self._filter: OrbitFilter | None = None
        try:
            self._filter = OrbitFilter(orbit_of(chain), noise, settings)
        except (ValueError, ArithmeticError) as error:
            self.limitation = str(error)
        self._observer = MotionObserver(settings.motion)
        self._reporter = StateReporter(chain, settings.report)
        self._widths: WidthReporter | None = None
        if self._filter is not None and chain.deviations == NO_DEVIATIONS:
            self._widths = WidthReporter(chain, settings.width)
        self._wobbles = WobbleReporter(chain, settings.wobble)
        self._walls = WallReporter(chain, self._filter.orbit if self._filter else None, settings)
        self._rate_noise = RateNoise(chain, settings.noise)
        self._theory = wall_theory(chain)
        self._unwrapper = Unwrapper(chain.number_of_rotors)
        self._clock = FrameClock(settings.tracking.clock_limit)
        self._pushes = WaitingPushes()

    @property
    def late_pushes(self) -> int:
        """Number of pushes that were told after the frame that they acted from."""
        return self._pushes.late

    def push(self, stamp: int | None, impulses: Array) -> None:
        """Tell of angular impulses [N m s], shape (N,), that were made at an instant [ns].

        They act from the first frame that is not earlier, or from the next one for None. Those
        that come after that frame are counted, and change nothing. Raises ValueError for what are
        no impulses of this chain.
        """
        self._pushes.add(stamp, self.chain.check_angles(impulses, 'impulse'))

    @property
    def offsets(self) -> Array:
        """Offsets found in the encoders [rad], shape (N,), 0 where none is sure."""
        if self._filter is None:
            return np.zeros(self.chain.number_of_rotors)
        return self._filter.offsets.corrections

    @property
    def offset_deviations(self) -> Array:
        """Standard deviations of the offsets [rad], shape (N,)."""
        if self._filter is None:
            return np.full(self.chain.number_of_rotors, math.nan)
        return self._filter.offsets.deviations

    @property
    def late(self) -> int:
        """Number of frames that were not later than the one before."""
        return self._clock.late

    @property
    def starts(self) -> int:
        """How often the chain was found anew on its orbit."""
        return 0 if self._filter is None else self._filter.starts

    def analyse(self, stamp: int, angles: Array, rates: Array | None = None) -> Analysis | None:
        """Analyse a frame of an instant [ns]; None where it is not later than the one before.

        Angles [rad] and rates [rad/s] are of shape (N,), NaN or infinite where they are not
        known; angles may be wrapped. A stamp that goes back by more than a second is that of a
        clock that was set anew, and begins a new record. Raises ValueError for arrays of another
        shape.
        """
        rotors = self.chain.number_of_rotors
        angles = np.ascontiguousarray(angles, dtype=np.float64)
        check_shape(angles, rotors, 'angle')
        if rates is not None:
            rates = np.ascontiguousarray(rates, dtype=np.float64)
            check_shape(rates, rotors, 'rate')
        if not self._clock.advance(stamp):
            return None
        if self._clock.restarted:
            self._observer.restart()
            self._rate_noise.restart()
            self._walls.restart()
            self._unwrapper = Unwrapper(rotors)
        estimate, frame = self._read(angles, rates, self._pushes.due(stamp))
        errors = self._errors(estimate, frame)
        unknown = frame.number_filled and np.isnan(frame.angles).any()
        state = None if unknown else FrameState(self.chain, frame.angles)
        alone = self._is_alone(estimate, frame)
        solitons, events = self._solitons(frame, state, estimate, alone, errors)
        return Analysis(
            motion=self.chain.motion,
            measured_motion=self._measured_motion(state, frame, errors.noise),
            estimate=estimate,
            cycle=cycle_phase(estimate, self._filter.orbit if self._filter else None),
            solitons=solitons,
            events=events,
            topology=self._topology(state, solitons),
            edge_rotors=None if state is None else self._reporter.edge_rotors(state),
            energies=self._energies(state, frame, estimate, solitons, errors),
            wobble=self._wobble(frame, estimate, errors) if alone and solitons else None,
            unseen=frame.number_filled,
        )

    def _read(
        self, angles: Array, rates: Array | None, pushes: list[Push]
    ) -> tuple[OrbitEstimate, CompletedFrame]:
        """Estimate where the chain is after pushes, and complete its frame."""
        seen = self._unwrapper.unwrapped(angles)
        if rates is not None:
            fastest = self._settings.report.fastest
            if not all_within(rates, fastest):
                rates = np.where(np.abs(rates) < fastest, rates, np.nan)
            self._rate_noise.update(self._clock.time, rates)
        if self._filter is None:
            estimate = lost(self._clock.time, self._noise)
            return estimate, complete(self.chain, seen, rates, None, self._unwrapper.last)
        self._filter.update(self._clock.time, seen)
        for push in pushes:
            self._filter.push(push)
        estimate, view = self._filter.estimate, self._filter.view
        corrected = seen - self.offsets
        expected = None
        if estimate.status is not TrackingStatus.LOST:
            whole = whole_frame(self.chain, corrected, rates, view)
            if whole is not None:
                return estimate, whole
            expected = on_orbit(self._filter.orbit, estimate, view)
        last = self._unwrapper.last - self.offsets
        return estimate, complete(self.chain, corrected, rates, expected, last)

    def _errors(self, estimate: OrbitEstimate, frame: CompletedFrame) -> FrameErrors:
        """Errors of a frame, 0 where they are unknown."""
        noise = estimate.noise if math.isfinite(estimate.noise) else 0.0
        misfit = estimate.misfit if math.isfinite(estimate.misfit) else 0.0
        return FrameErrors(
            noise=noise,
            rate_noise=self._rate_noise.deviation,
            lasting=math.sqrt(max(misfit**2 - noise**2, 0.0)),
            unseen=frame.filled if frame.number_filled else None,
        )

    def _measured_motion(
        self, state: FrameState | None, frame: CompletedFrame, noise: float
    ) -> MotionClass:
        if state is not None and not frame.number_filled:
            return self._observer.observe_sines(state.sines, noise)
        return self._observer.observe(frame.seen, noise)

    def _followed(
        self, estimate: OrbitEstimate, frame: CompletedFrame, name: int
    ) -> AnalysedSoliton:
        """The wall on the orbit."""
        chain, place = self.chain, estimate.place
        velocity = estimate.place_rate * chain.spacing
        width = self._width(estimate, frame, velocity)
        return AnalysedSoliton(
            id=name,
            rotor=place,
            position=place * chain.spacing,
            velocity=velocity,
            width=width.measured,
            theory_width=width.theory,
            charge=1,
            position_deviation=estimate.place_deviation * chain.spacing,
            velocity_deviation=estimate.place_rate_deviation * chain.spacing,
            width_deviation=width.deviation,
        )

    def _width(self, estimate: OrbitEstimate, frame: CompletedFrame, velocity: float) -> Width:
        """Width of the wall on the orbit, by the rotors that were seen."""
        angles = frame.seen
        if estimate.upside_down:
            angles = math.pi - angles
        if frame.others or self._widths is None:
            return _NO_WIDTH
        noise = max(estimate.noise, self._settings.width.least_noise)
        return self._widths.update(angles, estimate.place, estimate.leg, velocity, noise)

    def _is_alone(self, estimate: OrbitEstimate, frame: CompletedFrame) -> bool:
        """Whether a frame shows one wall at most, where it is on the orbit."""
        if estimate.status is TrackingStatus.LOST:
            return False
        on_it = estimate.status in (TrackingStatus.ACQUIRED, TrackingStatus.TRACKING)
        return on_it or not frame.others or frame.number_filled == len(frame.filled)

    def _solitons(
        self,
        frame: CompletedFrame,
        state: FrameState | None,
        estimate: OrbitEstimate,
        alone: bool,
        errors: FrameErrors,
    ) -> tuple[tuple[AnalysedSoliton, ...], tuple[SolitonEvent, ...]]:
        """Walls of a frame, of which one that is alone is placed on the orbit, and events."""
        seen = WallFrame(self.chain, self._walls.line, state, frame.rates, errors)
        if alone:
            tracks, events = self._walls.on_orbit(estimate, seen)
            found = [self._followed(estimate, frame, track.id) for track in tracks]
            return tuple(found), tuple(events)
        if state is None or frame.number_filled == len(frame.filled):
            return (), ()
        tracks, events = self._walls.beside_orbit(self._clock.time, state, frame.seen, seen)
        return tuple(map(self._tracked, tracks)), tuple(events)

    def _tracked(self, track: WallTrack) -> AnalysedSoliton:
        """A wall that is followed by a filter of its own."""
        spacing, seen = self.chain.spacing, track.seen
        velocity = track.place_rate * spacing
        return AnalysedSoliton(
            id=track.id,
            rotor=track.rotor,
            position=track.rotor * spacing,
            velocity=velocity,
            width=math.nan if seen is None else seen.width,
            theory_width=self._theory_width(velocity),
            charge=track.charge,
            position_deviation=track.deviation * spacing,
            velocity_deviation=track.rate_deviation * spacing,
            width_deviation=math.nan if seen is None else seen.width_deviation,
        )

    def _theory_width(self, velocity: float) -> float:
        slower = abs(velocity) < self._theory.speed_of_sound
        return self._theory.width(velocity) if slower else math.nan

    def _topology(
        self, state: FrameState | None, solitons: tuple[AnalysedSoliton, ...]
    ) -> Topology | None:
        if state is None or self.chain.periodic:
            return None
        return self._reporter.topology(state, [each.rotor for each in solitons])

    def _energies(
        self,
        state: FrameState | None,
        frame: CompletedFrame,
        estimate: OrbitEstimate,
        solitons: tuple[AnalysedSoliton, ...],
        errors: FrameErrors,
    ) -> Energies | None:
        if state is None or (frame.number_filled and not frame.placed):
            return None
        rates: Array | ArcRate | None = frame.rates
        if rates is None and frame.placed and estimate.rate_deviation < abs(estimate.rate):
            rates = ArcRate(estimate.rate, estimate.rate_deviation)
        return self._reporter.energies(state, [each.rotor for each in solitons], rates, errors)

    def _wobble(
        self, frame: CompletedFrame, estimate: OrbitEstimate, errors: FrameErrors
    ) -> Wobble | None:
        if self._filter is None or frame.others:
            return None
        about = self._filter.orbit.stretch(estimate.arc)
        wall = RestingWall(about.first, about.angles, estimate.place)
        return self._wobbles.of_frame(frame.angles, wall, errors.noise, errors.lasting)


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

    def analyse(self, stamp: int, angles: Array, rates: Array | None = None) -> Analysis | None:
        """Analyse a frame, as `Analyser.analyse`; rates say nothing here."""
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
            estimate=lost(self._clock.time),
            cycle=cycle_phase(lost(self._clock.time), None),
            events=(),
            solitons=_crossing(self._observer.evidence.place, seen),
            topology=None,
            edge_rotors=None,
            energies=None,
            wobble=None,
            unseen=int(np.count_nonzero(np.isnan(seen))),
        )


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


def _crossing(place: float, angles: Array) -> tuple[AnalysedSoliton, ...]:
    """A wall of which nothing but about where it is and its charge are known; none for NaN."""
    if math.isnan(place):
        return ()
    leans = np.sin(staggered(angles))[: math.floor(place) + 1]
    charge = 1 if np.nansum(leans) > 0 else -1
    nan = math.nan
    return (AnalysedSoliton(0, place, nan, nan, nan, nan, charge, nan, nan, nan),)
