# SPDX-License-Identifier: Apache-2.0
"""Analyser of a chain with known parameters.

An orbit filter locates a single wall, and fits of wall shapes locate several walls.
"""

from __future__ import annotations

import math
from contextlib import suppress
from functools import cached_property

import numpy as np

from soliton_linkage.estimation.analysis import AnalyserDiagnostics, Analysis, cycle_phase
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
    check_noise,
    complete,
    on_orbit,
    rotor_swing,
)
from soliton_linkage.estimation.motion_class import MotionObserver
from soliton_linkage.estimation.noise import RateNoise
from soliton_linkage.estimation.orbit_filter import OrbitFilter, largest_deformation
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings
from soliton_linkage.estimation.shape_model import ShapeMeasurementModel
from soliton_linkage.estimation.state_report import (
    ArcRate,
    FrameErrors,
    StateReport,
    StateReporter,
)
from soliton_linkage.estimation.wall_shapes import WallShapes
from soliton_linkage.estimation.wall_track import (
    LatticeCoordinates,
    WallFrame,
    WallMeasurement,
    WallTrack,
)
from soliton_linkage.estimation.wall_tracker import WallTracker
from soliton_linkage.estimation.wall_width import ContractionEstimator, TheoryWidth
from soliton_linkage.estimation.wobble import Wobble, WobbleReporter
from soliton_linkage.linkage.chain import Array, Chain, check_shape
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.static_wall import site_arc

_FASTEST = 1e9
"""Largest valid rate of a rotor [rad/s]; larger rates count as unknown."""
_UNKNOWN_WIDTH = math.nan, math.nan


class Analyser:
    """Analyser of a chain with known parameters; it receives frames in the order of their time.

    If the orbit cannot be computed, `limitation` gives the reason, and the analyser locates walls
    only by fits of their shapes.
    """

    def __init__(
        self, chain: Chain, noise: float | None = None, settings: EstimationSettings = DEFAULTS
    ) -> None:
        """Compute the orbit of the chain.

        `noise` is the standard deviation of the noise of an angle [rad]; if it is None, the
        analyser estimates it. Raises ValueError if `noise` is infinite or not above 0.
        """
        check_noise(noise)
        self.chain = chain
        self._settings = settings
        self._noise = math.nan if noise is None else noise
        self.limitation = ''
        self._filter: OrbitFilter | None = None
        self._orbit: Orbit | None = None
        try:
            self._orbit = orbit_of(chain)
            self._filter = OrbitFilter(self._orbit, noise, settings)
        except (ValueError, ArithmeticError) as error:
            self._orbit, self.limitation = None, str(error)
        deformation = 0.0 if self._orbit is None else largest_deformation(self._orbit)
        self._observer = MotionObserver(settings.motion, deformation)
        self._reporter = StateReporter(chain)
        self._line = LatticeCoordinates(chain)
        arc, swing = 1.0, 2 * self._line.width
        with suppress(ValueError, ArithmeticError):
            arc = site_arc(chain)
        if self._orbit is not None:
            begin, end = self._orbit.leg_arcs(0)
            swing = max((end - begin) / self._orbit.site_arc - (chain.number_of_rotors - 1), 0.0)
        compliance = None if self._filter is None else self._filter.compliance
        scale = 1 / chain.time_unit
        self._tracker = WallTracker(self._line, scale, arc, swing, settings, compliance)
        # Compute the shapes before any frame: this takes as long as hundreds of frames.
        self._shape_model: ShapeMeasurementModel | None = None
        with suppress(ValueError, ArithmeticError):
            self._shape_model = ShapeMeasurementModel(
                self._shapes, self._line, arc, noise, settings
            )
        self._contraction: ContractionEstimator | None = None
        if self._orbit is not None and chain.deviations == NO_DEVIATIONS:
            self._contraction = ContractionEstimator(self._shapes, settings.width)
        self._wobbles = WobbleReporter(chain)
        self._rate_noise = RateNoise(chain, settings.noise)
        self._theory_width = TheoryWidth(chain)
        self._unwrapper = Unwrapper(chain.number_of_rotors)
        self._clock = FrameClock(settings.tracking.clock_limit)
        self._impulses = ImpulseQueue()
        self._half_swing = rotor_swing(chain) / 2
        self._none = np.zeros(chain.number_of_rotors, dtype=np.bool_)

    @cached_property
    def _shapes(self) -> WallShapes:
        return WallShapes(self.chain)

    def apply_impulse(self, stamp: int | None, impulses: Array) -> None:
        """Apply angular impulses [N m s], shape (N,), in the first frame at or after `stamp` [ns].

        If `stamp` is None, the impulses act in the next frame. If `stamp` is not after the last
        frame, the impulses are ignored and counted as late. Raises ValueError if `impulses` have
        another shape or contain a value that is not finite.
        """
        self._impulses.add(stamp, self.chain.check_angles(impulses, 'impulse'))

    @property
    def diagnostics(self) -> AnalyserDiagnostics:
        """Counters of the analyser, and estimated errors of the readings."""
        late, made = (self._clock.late, self._impulses.late), self._filter
        if made is None:
            rotors = self.chain.number_of_rotors
            return AnalyserDiagnostics(np.zeros(rotors), np.full(rotors, math.nan), *late)
        error = made.offsets.rest_angle_error
        return AnalyserDiagnostics(
            made.offsets.corrections,
            made.offsets.deviations,
            *late,
            made.starts,
            math.sqrt(made.jitter.variance),
            -error if made.estimate.upside_down else error,
        )

    def analyse(
        self,
        stamp: int,
        angles: Array,
        rates: Array | None = None,
        deviations: Array | None = None,
    ) -> Analysis | None:
        """Analyse a frame that was measured at a time `stamp` [ns]; return None if it is late.

        A frame is late if its stamp equals the stamp of the last analysed frame or is up to
        `clock_limit` [s] earlier. If the stamp is even earlier, the analyser restarts with this
        frame. `angles` [rad], wrapped or unwrapped, and `rates` [rad/s] have shape (N,); unknown
        values are NaN or infinite. `deviations` are the standard deviations of the angles [rad],
        shape (N,), NaN if unknown; fits of wall shapes ignore them. Raises ValueError if an array
        has another shape, or if a standard deviation is infinite or not above 0.
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
            self._tracker.restart()
            if self._shape_model is not None:
                self._shape_model.restart()
            self._unwrapper = Unwrapper(rotors)
        estimate, frame = self._read(angles, rates, deviations, self._impulses.due(stamp))
        errors = self._errors(estimate, frame)
        unknown = frame.number_filled and np.isnan(frame.angles).any()
        known = None if unknown else frame.angles
        single = self._is_alone(estimate, frame)
        solitons, events, status = self._solitons(frame, known, estimate, single, errors)
        report = None if unknown else self._report(frame, estimate, solitons, errors)
        whole = frame.from_orbit or not frame.number_filled
        return Analysis(
            motion=self.chain.motion,
            measured_motion=self._observer.observe(frame.seen, errors.noise),
            status=status,
            estimate=estimate,
            cycle=cycle_phase(estimate, self._orbit),
            solitons=solitons,
            events=events,
            topology=report.topology if report else None,
            edge_rotors=report.edge_rotors if report else None,
            energies=report.energies if report and whole else None,
            wobble=self._wobble(frame, estimate, errors) if single and solitons else None,
            unseen=frame.number_filled,
        )

    def _read(
        self,
        angles: Array,
        rates: Array | None,
        deviations: Array | None,
        impulses: list[FrameImpulse],
    ) -> tuple[OrbitEstimate, CompletedFrame]:
        seen = self._unwrapper.unwrapped(angles)
        all_known = rates is None or all_within(rates, _FASTEST)
        if rates is not None:
            if not all_known:
                rates = np.where(np.abs(rates) < _FASTEST, rates, np.nan)
            self._rate_noise.update(self._clock.time, rates)
        if self._filter is None:
            estimate = lost(self._clock.time, self._noise)
            return estimate, complete(self.chain, seen, rates, None, self._unwrapper.last)
        self._filter.update(self._clock.time, seen, deviations)
        for impulse in impulses:
            self._filter.apply_impulse(impulse)
        estimate, view = self._filter.estimate, self._filter.view
        corrected = seen - self._filter.offsets.corrections
        expected = None
        if estimate.status is not TrackingStatus.LOST:
            if all_known and view is not None and view.largest <= self._half_swing:
                return estimate, CompletedFrame(corrected, rates, self._none, True, False, 0)
            residuals = np.full(len(seen), np.nan) if view is None else view.residuals
            expected = on_orbit(self._filter.orbit, estimate, residuals)
        last = self._unwrapper.last - self._filter.offsets.corrections
        return estimate, complete(self.chain, corrected, rates, expected, last)

    def _errors(self, estimate: OrbitEstimate, frame: CompletedFrame) -> FrameErrors:
        noise = estimate.noise if math.isfinite(estimate.noise) else 0.0
        misfit = estimate.misfit if math.isfinite(estimate.misfit) else 0.0
        return FrameErrors(
            noise=noise,
            rate_noise=self._rate_noise.deviation,
            persistent=math.sqrt(max(misfit**2 - noise**2, 0.0)),
            unseen=frame.filled if frame.number_filled else None,
        )

    def _is_alone(self, estimate: OrbitEstimate, frame: CompletedFrame) -> bool:
        if estimate.status is TrackingStatus.LOST:
            return False
        on_it = estimate.status in (TrackingStatus.ACQUIRED, TrackingStatus.TRACKING)
        return on_it or not frame.others or frame.number_filled == len(frame.filled)

    def _solitons(
        self,
        frame: CompletedFrame,
        known: Array | None,
        estimate: OrbitEstimate,
        single: bool,
        errors: FrameErrors,
    ) -> tuple[tuple[AnalysedSoliton, ...], tuple[SolitonEvent, ...], TrackingStatus]:
        scene = WallFrame(self._reporter, self._line, known, frame.rates, errors)
        seen: list[WallMeasurement] = []
        if single:
            inside = self._settings.walls.inside
            if inside <= estimate.site <= self._line.rotors - 1 - inside:
                site, deviation = estimate.site, estimate.site_deviation
                width = self._width(estimate, frame)
                seen = [WallMeasurement(site, deviation, 1, width, estimate=estimate)]
        elif known is None or frame.number_filled == len(frame.filled):
            return (), (), estimate.status
        elif self._shape_model is not None:
            seen = self._shape_model.measure(known, frame.seen)
        confirming = 1 if single else self._settings.tracking.confirming_frames
        tracks, events = self._tracker.update(self._clock.time, seen, scene, confirming)
        status = estimate.status if single or not tracks else tracks[0].status
        return tuple(map(self._soliton, tracks)), tuple(events), status

    def _soliton(self, track: WallTrack) -> AnalysedSoliton:
        spacing = self.chain.spacing
        velocity = track.rate * spacing
        return AnalysedSoliton(
            id=track.id,
            rotor=track.rotor,
            position=track.rotor * spacing,
            velocity=velocity,
            width=track.width[0],
            theory_width=self._theory_width(velocity),
            charge=track.charge,
            position_deviation=track.deviation * spacing,
            velocity_deviation=track.rate_deviation * spacing,
            width_deviation=track.width[1],
        )

    def _width(self, estimate: OrbitEstimate, frame: CompletedFrame) -> tuple[float, float]:
        if frame.others or self._contraction is None:
            return _UNKNOWN_WIDTH
        angles = math.pi - frame.seen if estimate.upside_down else frame.seen
        found = self._contraction.update(angles, estimate.site, estimate.leg, estimate.noise)
        width = self._theory_width(0.0) / found.factor
        return width, width * found.deviation

    def _report(
        self,
        frame: CompletedFrame,
        estimate: OrbitEstimate,
        solitons: tuple[AnalysedSoliton, ...],
        errors: FrameErrors,
    ) -> StateReport:
        rates: Array | ArcRate | None = frame.rates
        known = frame.from_orbit and estimate.rate_deviation < abs(estimate.rate)
        if rates is None and known and self._orbit is not None:
            free = self._orbit.free_rate(estimate.arc)
            rates = ArcRate(estimate.rate / free, estimate.rate_deviation / free)
        sites = [each.rotor for each in solitons]
        return self._reporter.report(frame.angles, sites, rates, errors)

    def _wobble(
        self, frame: CompletedFrame, estimate: OrbitEstimate, errors: FrameErrors
    ) -> Wobble | None:
        if self._orbit is None or frame.others:
            return None
        about = self._orbit.segment(estimate.arc)
        wall = about.first, about.angles, estimate.site
        return self._wobbles.wobble(frame.angles, *wall, errors.noise, errors.persistent)
