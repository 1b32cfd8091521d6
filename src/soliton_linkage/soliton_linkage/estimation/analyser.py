# SPDX-License-Identifier: Apache-2.0
"""Analyser of the frames of a chain, live and offline.

A single wall of zero energy is located on the orbit of the chain by all frames so far. Of several
walls each has a filter of its own, in a `WallTracker`, which also names them.
"""

from __future__ import annotations

import math
from contextlib import suppress
from functools import cached_property

import numpy as np

from soliton_linkage.estimation.analysis import Analysis, cycle_phase
from soliton_linkage.estimation.estimates import (
    AnalysedSoliton,
    OrbitEstimate,
    SolitonEvent,
    TrackingStatus,
    lost,
)
from soliton_linkage.estimation.frames import (
    CompletedFrame,
    FrameClock,
    FrameImpulse,
    ImpulseQueue,
    Unwrapper,
    all_within,
    check_deviations,
    complete,
    on_orbit,
    whole_frame,
)
from soliton_linkage.estimation.lattice import LatticeCoordinates, WallFrame
from soliton_linkage.estimation.motion_class import MotionObserver
from soliton_linkage.estimation.noise import RateNoise
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings
from soliton_linkage.estimation.shape_model import (
    ShapeMeasurementModel,
    borders_of_ring,
    domain_borders,
)
from soliton_linkage.estimation.state_report import (
    ArcRate,
    FrameErrors,
    FrameState,
    StateReport,
    StateReporter,
)
from soliton_linkage.estimation.wall_shapes import WallShapes
from soliton_linkage.estimation.wall_track import WallMeasurement, WallTrack
from soliton_linkage.estimation.wall_tracker import WallTracker
from soliton_linkage.estimation.wall_width import TheoryWidth, WidthReporter
from soliton_linkage.estimation.wobble import RestingWall, Wobble, WobbleReporter
from soliton_linkage.linear.bands import couplings
from soliton_linkage.linkage.chain import Array, Chain, check_shape
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.wall_shifts import WallShifts
from soliton_linkage.solitons.static_wall import site_arc

Walls = tuple[list[WallTrack], list[SolitonEvent]]
"""Walls that a frame shows, from rotor 0 on, and what happened to them."""


class WallReporter:
    """Follows the walls of a chain through its frames."""

    def __init__(self, chain: Chain, orbit: Orbit | None, settings: EstimationSettings) -> None:
        """Make the shapes of walls; the orbit tells how long one takes to turn back at an edge."""
        self._chain = chain
        self._inside = settings.report.inside
        self.line = LatticeCoordinates(chain, settings.walls, settings.report)
        self._opposite = settings.walls.opposite
        plus, minus = couplings(chain)
        self._uniform = (plus**2 - minus**2) / (plus**2 + minus**2)
        arc, swing = _site_arc(chain), 2 * self.line.width
        if orbit is not None:
            begin, end = orbit.leg_arcs(0)
            swing = max((end - begin) / orbit.site_arc - (chain.number_of_rotors - 1), 0.0)
        self._tracker = WallTracker(self.line, 1 / chain.time_unit, arc, swing, settings)
        # Made before the first frame comes: it takes as long as hundreds of them.
        self._placer: ShapeMeasurementModel | None = None
        with suppress(ValueError, ArithmeticError):
            shifts = WallShifts(orbit) if orbit else None
            self._placer = ShapeMeasurementModel(self.shapes, self.line, settings, shifts)

    @cached_property
    def shapes(self) -> WallShapes:
        """Shapes of single walls, made where they are first asked for; errors as there."""
        return WallShapes(self._chain)

    def restart(self) -> None:
        """Forget all walls, as where a new record begins."""
        self._tracker.restart()
        if self._placer is not None:
            self._placer.restart()

    def on_orbit(self, estimate: OrbitEstimate, frame: WallFrame) -> Walls:
        """The wall on the orbit, none while it is at an edge."""
        inside = self._inside <= estimate.site <= self.line.rotors - 1 - self._inside
        return self._tracker.follow(estimate.time, estimate if inside else None, frame)

    def beside_orbit(self, time: float, state: FrameState, seen: Array, frame: WallFrame) -> Walls:
        """All walls that a frame shows at an instant [s].

        Its angles as they were seen [rad] are of shape (N,), NaN where they were not.
        """
        walls: list[WallMeasurement] = []
        if self._placer is not None:
            walls = self._placer.placed(state, seen, self._borders_of(state))
        return self._tracker.take(time, walls, frame)

    def _borders_of(self, state: FrameState) -> list[tuple[float, int]]:
        """Borders of the domains of a state, with the charges there."""
        first, second = state.first**2, state.second**2
        strength = np.maximum(first + second, np.finfo(np.float64).tiny)
        polarised = (first - second) / (strength * self._uniform)
        found = borders_of_ring if self.line.periodic else domain_borders
        return found(polarised, self._opposite)


def _site_arc(chain: Chain) -> float:
    """Arc from one rotor to the next [rad], 1 where it cannot be told."""
    try:
        return site_arc(chain)
    except (ValueError, ArithmeticError):
        return 1.0


_NO_WIDTH = math.nan, math.nan


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
        self._walls = WallReporter(chain, self._filter.orbit if self._filter else None, settings)
        self._widths: WidthReporter | None = None
        if self._filter is not None and chain.deviations == NO_DEVIATIONS:
            self._widths = WidthReporter(self._walls.shapes, settings.width)
        self._wobbles = WobbleReporter(chain, settings.wobble)
        self._rate_noise = RateNoise(chain, settings.noise)
        self._theory_width = TheoryWidth(chain, settings.width)
        self._unwrapper = Unwrapper(chain.number_of_rotors)
        self._clock = FrameClock(settings.tracking.clock_limit)
        self._pushes = ImpulseQueue()

    @property
    def late_impulses(self) -> int:
        """Number of pushes that were told after the frame that they acted from."""
        return self._pushes.late

    def apply_impulse(self, stamp: int | None, impulses: Array) -> None:
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

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame of an instant [ns]; None where it is not later than the one before.

        Angles [rad] and rates [rad/s] are of shape (N,), NaN or infinite where they are not
        known; angles may be wrapped. Where standard deviations of the angles [rad], shape (N,),
        NaN where unknown, are told, one wall is placed by angles that count by them, and the
        noise is that of a usual one. A stamp that goes back by more than a second is that of a
        clock that was set anew, and begins a new record. Raises ValueError for arrays of another
        shape, and for deviations that are infinite or not above 0.
        """
        rotors = self.chain.number_of_rotors
        angles = np.ascontiguousarray(angles, dtype=np.float64)
        check_shape(angles, rotors, 'angle')
        if rates is not None:
            rates = np.ascontiguousarray(rates, dtype=np.float64)
            check_shape(rates, rotors, 'rate')
        if deviations is not None:
            deviations = check_deviations(deviations, rotors)
        if not self._clock.advance(stamp):
            return None
        if self._clock.restarted:
            self._observer.restart()
            self._rate_noise.restart()
            self._walls.restart()
            self._unwrapper = Unwrapper(rotors)
        estimate, frame = self._read(angles, rates, deviations, self._pushes.due(stamp))
        errors = self._errors(estimate, frame)
        unknown = frame.number_filled and np.isnan(frame.angles).any()
        known = None if unknown else frame.angles
        alone = self._is_alone(estimate, frame)
        solitons, events, status = self._solitons(frame, known, estimate, alone, errors)
        report = None if unknown else self._report(frame, estimate, solitons, errors)
        whole = frame.placed or not frame.number_filled
        return Analysis(
            motion=self.chain.motion,
            measured_motion=self._observer.observe(frame.seen, errors.noise),
            status=status,
            estimate=estimate,
            cycle=cycle_phase(estimate, self._filter.orbit if self._filter else None),
            solitons=solitons,
            events=events,
            topology=report.topology if report else None,
            edge_rotors=report.edge_rotors if report else None,
            energies=report.energies if report and whole else None,
            wobble=self._wobble(frame, estimate, errors) if alone and solitons else None,
            unseen=frame.number_filled,
        )

    def _read(
        self,
        angles: Array,
        rates: Array | None,
        deviations: Array | None,
        pushes: list[FrameImpulse],
    ) -> tuple[OrbitEstimate, CompletedFrame]:
        """Estimate where the chain is after pushes, and complete its frame."""
        seen = self._unwrapper.unwrapped(angles)
        fastest = self._settings.report.fastest
        all_known = rates is None or all_within(rates, fastest)
        if rates is not None:
            if not all_known:
                rates = np.where(np.abs(rates) < fastest, rates, np.nan)
            self._rate_noise.update(self._clock.time, rates)
        if self._filter is None:
            estimate = lost(self._clock.time, self._noise)
            return estimate, complete(self.chain, seen, rates, None, self._unwrapper.last)
        self._filter.update(self._clock.time, seen, deviations)
        for each in pushes:
            self._filter.apply_impulse(each)
        estimate, view = self._filter.estimate, self._filter.view
        corrected = seen - self.offsets
        expected = None
        if estimate.status is not TrackingStatus.LOST:
            whole = None
            if all_known and view is not None:
                whole = whole_frame(self.chain, corrected, rates, view.largest)
            if whole is not None:
                return estimate, whole
            residuals = np.full(len(seen), np.nan) if view is None else view.residuals
            expected = on_orbit(self._filter.orbit, estimate, residuals)
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

    def _soliton(self, track: WallTrack, width: tuple[float, float]) -> AnalysedSoliton:
        """A wall that is followed, with its width and the deviation of that [m]."""
        spacing = self.chain.spacing
        velocity = track.site_rate * spacing
        return AnalysedSoliton(
            id=track.id,
            rotor=track.rotor,
            position=track.rotor * spacing,
            velocity=velocity,
            width=width[0],
            theory_width=self._theory_width(velocity),
            charge=track.charge,
            position_deviation=track.deviation * spacing,
            velocity_deviation=track.rate_deviation * spacing,
            width_deviation=width[1],
        )

    def _width(self, estimate: OrbitEstimate, frame: CompletedFrame) -> tuple[float, float]:
        """Width of the wall on the orbit and its deviation [m], by the rotors that were seen."""
        if frame.others or self._widths is None:
            return _NO_WIDTH
        angles = math.pi - frame.seen if estimate.upside_down else frame.seen
        noise = max(estimate.noise, self._settings.width.least_noise)
        return self._widths.update(angles, estimate.site, estimate.leg, noise)

    def _is_alone(self, estimate: OrbitEstimate, frame: CompletedFrame) -> bool:
        """Whether a frame shows one wall at most, where it is on the orbit."""
        if estimate.status is TrackingStatus.LOST:
            return False
        on_it = estimate.status in (TrackingStatus.ACQUIRED, TrackingStatus.TRACKING)
        return on_it or not frame.others or frame.number_filled == len(frame.filled)

    def _solitons(
        self,
        frame: CompletedFrame,
        known: Array | None,
        estimate: OrbitEstimate,
        alone: bool,
        errors: FrameErrors,
    ) -> tuple[tuple[AnalysedSoliton, ...], tuple[SolitonEvent, ...], TrackingStatus]:
        """Walls of a frame, of which one that is alone is placed on the orbit, events, status."""
        seen = WallFrame(self._reporter, self._walls.line, known, frame.rates, errors)
        if alone:
            tracks, events = self._walls.on_orbit(estimate, seen)
            found = [self._soliton(track, self._width(estimate, frame)) for track in tracks]
            return tuple(found), tuple(events), estimate.status
        if known is None or frame.number_filled == len(frame.filled):
            return (), (), estimate.status
        state = FrameState(self.chain, known)
        tracks, events = self._walls.beside_orbit(self._clock.time, state, frame.seen, seen)
        status = tracks[0].status if tracks else estimate.status
        found = [
            self._soliton(each, each.seen.of_width if each.seen else _NO_WIDTH) for each in tracks
        ]
        return tuple(found), tuple(events), status

    def _report(
        self,
        frame: CompletedFrame,
        estimate: OrbitEstimate,
        solitons: tuple[AnalysedSoliton, ...],
        errors: FrameErrors,
    ) -> StateReport:
        """What a frame shows of which all angles are known."""
        rates: Array | ArcRate | None = frame.rates
        known = frame.placed and estimate.rate_deviation < abs(estimate.rate)
        if rates is None and known and self._filter is not None:
            free = self._filter.orbit.free_rate(estimate.arc)
            rates = ArcRate(estimate.rate / free, estimate.rate_deviation / free)
        places = [each.rotor for each in solitons]
        return self._reporter.report(frame.angles, places, rates, errors)

    def _wobble(
        self, frame: CompletedFrame, estimate: OrbitEstimate, errors: FrameErrors
    ) -> Wobble | None:
        if self._filter is None or frame.others:
            return None
        about = self._filter.orbit.segment(estimate.arc)
        wall = RestingWall(about.first, about.angles, estimate.site)
        return self._wobbles.wobble(frame.angles, wall, errors.noise, errors.lasting)
