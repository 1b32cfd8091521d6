# SPDX-License-Identifier: Apache-2.0
"""Where on its orbit a chain is and how fast it goes round, from all frames so far.

A frame measures the arc s at the predicted point of the orbit, phi = Phi(s) + noise, so that with
t = dPhi/ds the measurement is z = s + t . (phi - Phi(s)) / t^2, with variance sigma^2 / t^2: near
the truth it is linear in the noise. It updates a `MultipleModelFilter`; `FrameNoise` tells sigma
and what else there is beside the orbit, and `EncoderOffsets` what encoders add to their angles.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets, FarRotors
from soliton_linkage.estimation.frame_noise import FrameNoise, FrameView
from soliton_linkage.estimation.leg_evidence import LegEvidence
from soliton_linkage.estimation.loops import frame_loops
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.nearest_point import Recognition, recognise
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Motion, check_shape
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit


class TrackingStatus(enum.Enum):
    """What an estimate rests on."""

    LOST = 'lost'
    """On nothing: no frame has been recognised."""
    ACQUIRED = 'acquired'
    """On one frame, searched along the whole orbit; of the rate only its scale is known."""
    TRACKING = 'tracking'
    """On this frame and those before."""
    COASTING = 'coasting'
    """On frames before; this one was empty or could not be."""


@dataclass(frozen=True)
class OrbitEstimate:
    """Where a chain is on its orbit; NaN, and leg -1, while it is lost.

    time: instant of the estimate [s].
    status: what it rests on.
    arc: arc length along the orbit [rad], which counts cycles.
    rate: rate of the arc length [rad/s].
    arc_deviation: standard deviation of the arc length [rad].
    rate_deviation: standard deviation of the rate [rad/s].
    covariance: covariance of arc length and rate [rad^2/s].
    place: place of the wall [rotor spacings].
    place_rate: rate of the place [rotor spacings / s], 0 while the wall waits at an edge.
    place_deviation: standard deviation of the place [rotor spacings].
    place_rate_deviation: standard deviation of that rate [rotor spacings / s].
    leg: leg of the orbit.
    leg_known: whether it can be no other leg with the wall at the same place. A flipper whose edge
        rotors were not seen may be on two legs or on four, of which leg, arc, rate and phase
        follow one.
    phase: phase of the cycle [rad], 2 pi arc / length from 0 to 2 pi.
    completed_cycles: whole cycles gone round; the phase grows on by 2 pi with each.
    noise: standard deviation of the angles' noise in use [rad], given or estimated.
    misfit: root mean square of what the orbit leaves of the rotors about the wall, of late [rad].
    frame_misfit: the same of this frame alone [rad], NaN for one that was empty.
    upside_down: whether the chain is the image phi -> pi - phi of the orbit's.
    """

    time: float
    status: TrackingStatus
    arc: float
    rate: float
    arc_deviation: float
    rate_deviation: float
    covariance: float
    place: float
    place_rate: float
    place_deviation: float
    place_rate_deviation: float
    leg: int
    leg_known: bool
    phase: float
    completed_cycles: int
    noise: float
    misfit: float
    frame_misfit: float
    upside_down: bool


class OrbitFilter:
    """Recursive estimate of a chain's arc and rate, from frames as they come.

    Frames that repeat a stamp or come late are ignored; a stamp that goes back by more than the
    clock limit of the settings starts anew, and so do frames that cannot be where the chain is
    expected. The offsets of encoders are learnt on the way, and outlive a new start.
    """

    def __init__(
        self,
        orbit: Orbit,
        noise: float | None = None,
        settings: EstimationSettings = DEFAULTS,
    ) -> None:
        """Wait for the first frame; with the noise of the angles [rad], where it is known.

        Raises ValueError for a noise that is not above 0.
        """
        if noise is not None and not (math.isfinite(noise) and noise > 0):
            raise ValueError(
                f'noise = {noise} rad must be a finite number above 0; leave it out to have it '
                'estimated'
            )
        chain = orbit.chain
        self.orbit = orbit
        self.offsets = EncoderOffsets(chain.number_of_rotors, settings.offsets)
        self.ignored = 0
        self.rejected = 0
        self.starts = 0
        self._given_noise = noise
        self._settings = settings
        self._tracking = settings.tracking
        self._depth = penetration_depth(chain) / chain.spacing
        self._legs = LegEvidence(orbit, settings.tracking)
        self._deviates = chain.deviations != NO_DEVIATIONS
        self._backgrounds = [
            orbit.background(orbit.arc_at(orbit.middle, leg))
            for leg in range(orbit.number_of_legs)
        ]
        swing = math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle
        self._tolerated = (settings.tracking.strange_share * swing) ** 2
        self._elastic = [(share * swing) ** 2 for share in settings.tracking.elastic_shares]
        margin = 1 + settings.offsets.depths_beside * self._depth
        self._far = FarRotors(self.offsets, margin, chain.time_unit, self._elastic[0])
        self._upside_down = self._doubts = False
        self._disorder = 0.0
        self._forget(math.nan)

    @property
    def estimate(self) -> OrbitEstimate:
        """The latest estimate."""
        return self._estimate

    @property
    def view(self) -> FrameView | None:
        """The latest frame beside the orbit; None while lost, and for an empty frame."""
        return self._seen_as

    def update(self, time: float, angles: Array) -> OrbitEstimate:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        Raises ValueError for angles that are not one a rotor; all else it takes as it comes.
        """
        check_shape(angles, self.orbit.chain.number_of_rotors)
        elapsed = time - self._estimate.time
        if not math.isfinite(time) or -self._tracking.clock_limit <= elapsed <= 0:
            self.ignored += 1
            return self._estimate
        if elapsed < 0:
            self._forget(time)
        seen = np.ascontiguousarray(angles, dtype=np.float64)
        if not frame_loops.all_within(seen, math.inf):
            seen = np.where(np.isfinite(seen), seen, np.nan)
        if self._motion is not None:
            self._follow(self._motion, time, elapsed, seen)
        elif not self._acquire(time, seen):
            self._forget(time)
        return self._estimate

    def _forget(self, time: float) -> None:
        self._motion: MultipleModelFilter | None = None
        self._seen_as: FrameView | None = None
        self._noise = FrameNoise(self._given_noise, self._settings.noise)
        self._doubted = self._strange_running = 0
        self._estimate = lost(time, self._noise.deviation)

    def _acquire(self, time: float, seen: Array) -> bool:
        """Search a frame for the chain; say whether it is there."""
        place = self._searched(seen)
        if not place.misfit < self._tracking.worst_misfit:
            return False
        self._start_at(place, time, seen)
        return True

    def _start_at(self, place: Recognition, time: float, seen: Array) -> None:
        self.starts += 1
        self._upside_down = place.upside_down
        self._doubted = self._strange_running = 0
        self._noise = FrameNoise(self._given_noise, self._settings.noise)
        self._far.forget()
        view = self._view(seen, place.arc)
        view = self._view(seen, place.arc, view.robust_limit)
        self._noise.update(view, 0.0)
        self._legs.forget()
        self._legs.update(view, max(self._noise.variance, view.mean_square))
        scale = 1 / self.orbit.chain.time_unit
        variance = self._noise.variance / view.information
        self._motion = MultipleModelFilter(
            view.arc, variance, scale, self.orbit.site_arc, self._settings.filter
        )
        self._seen_as = view
        self._report(time, TrackingStatus.ACQUIRED, self._motion)

    def _searched(self, seen: Array, upside_down: tuple[bool, ...] = (False, True)) -> Recognition:
        """Nearest point of the orbit, or of its image upside down."""
        angles = seen - self.offsets.corrections
        return recognise(self.orbit, angles, upside_down, self._settings.search)

    def _follow(
        self, motion: MultipleModelFilter, time: float, elapsed: float, seen: Array
    ) -> None:
        self._predict(motion, elapsed)
        if (
            self._tracking.lost_deviations * math.sqrt(motion.expected_variance)
            > self.orbit.length
        ):
            self._forget(time)
            self._acquire(time, seen)
            return
        view = self._recognised(motion, seen)
        if view.information == 0:
            self._seen_as = view if np.isfinite(view.residuals).any() else None
            self._report(time, TrackingStatus.COASTING, motion)
            return
        self._seen_as = view
        limit = self._tracking.strange_ratio * self._noise.scatter + self._tolerated
        many = view.share_of_outliers > self._tracking.most_outliers
        strange = view.mean_square > limit or many
        self._strange_running = self._strange_running + 1 if strange else 0
        if (strange or view.any_outlying) and self._is_elsewhere(view, strange, time, seen):
            return
        if strange and not view.mean_square_of_all < self._tracking.worst_misfit**2:
            self.rejected += 1
            self._report(time, TrackingStatus.COASTING, motion)
            return
        self._tolerated = max(self._tolerated, view.mean_square if strange else 0.0)
        self._update_by(motion, seen, view, elapsed)
        self._report(time, TrackingStatus.TRACKING, motion)

    def _predict(self, motion: MultipleModelFilter, elapsed: float) -> None:
        """Go on by a time [s]; where rotors deviate, the rate varies along the orbit."""
        before = self.orbit.free_rate(motion.arc) if self._deviates else 1.0
        motion.predict(elapsed, self._at_edge())
        if self._deviates:
            motion.change_rate(self.orbit.free_rate(motion.arc) / before)

    def _at_edge(self) -> bool:
        """Whether the wall was so near to an edge that springs take up or give back energy."""
        last = self.orbit.chain.number_of_rotors - 1
        to_edge = min(self._estimate.place, last - self._estimate.place)
        return bool(to_edge < self._tracking.edge_rotors + self._depth)

    def _is_elsewhere(self, view: FrameView, strange: bool, time: float, seen: Array) -> bool:
        """Start anew where a frame that is not as expected fits far better than it does there.

        The whole orbit is searched the first, second, fourth, eighth, ... time. Where the wall
        is as expected, it may be on another leg, but not at another place.
        """
        self._doubted += not strange
        times = self._strange_running if strange else self._doubted
        if times & (times - 1):
            return False
        place = self._searched(seen)
        known = np.count_nonzero(np.isfinite(view.residuals))
        gained = known * (view.mean_square_of_all - place.misfit**2)
        orbit, tracking = self.orbit, self._tracking
        enough = gained > tracking.gain * self._noise.scatter
        if not (enough and place.misfit < tracking.worst_misfit):
            return False
        apart = abs(math.remainder(place.arc - view.arc, orbit.length))
        moved = apart > tracking.elsewhere or place.upside_down != self._upside_down
        if not strange:
            apart = abs(orbit.place(place.arc) - orbit.place(view.arc))
            moved = orbit.leg(place.arc) != orbit.leg(view.arc) and apart < tracking.same_place
        if moved:
            self._start_at(place if strange else self._on_this_turn(place), time, seen)
        return moved

    def _on_this_turn(self, place: Recognition) -> Recognition:
        """The same point of the orbit, with as many cycles gone round as the wall has."""
        length = self.orbit.length
        turns = round((self._estimate.arc - place.arc) / length)
        return place._replace(arc=place.arc + turns * length)

    def _update_by(
        self, motion: MultipleModelFilter, seen: Array, view: FrameView, elapsed: float
    ) -> None:
        """Update the filter, the noise and the offsets by a frame, a time [s] after the last."""
        noise = self._noise
        variance = self._variance(motion, view, elapsed)
        motion.update(view.arc, variance, noise.degrees_of_freedom)
        noise.update(view, elapsed)
        self._legs.update(view, max(noise.variance, view.mean_square))
        if self._far.add(view.residuals, self.orbit.place(view.arc), elapsed):
            self._learn_offsets(seen, view)

    def _variance(self, motion: MultipleModelFilter, view: FrameView, elapsed: float) -> float:
        """Variance of the arc that a frame shows [rad^2].

        Rotors of which some are not seen have another nearest point than all of them, by what
        the frame is beside the orbit, for as long as the wall takes to pass a rotor.
        """
        missing = max(1 / view.information - 1, 0.0)
        frames = max(self.orbit.site_arc / max(abs(motion.expected_rate) * elapsed, 1e-9), 1.0)
        variance = self._noise.variance / view.information
        return variance + self._noise.excess * missing * min(frames, self._tracking.most_alike)

    def _recognised(self, motion: MultipleModelFilter, seen: Array) -> FrameView:
        """View of a frame from the likeliest arc, by the frame and by what went before.

        Where what went before does not tell on which slope, the whole orbit is searched.
        """
        expected, spread = motion.expected, motion.expected_variance
        tracking = self._tracking
        if spread > tracking.unknown_variance:
            place = self._searched(seen, (self._upside_down,))
            if place.misfit < tracking.worst_misfit:
                turns = round((expected - place.arc) / self.orbit.length)
                return self._view(seen, place.arc + turns * self.orbit.length)
        arc = expected
        limit = self._settings.noise.beyond_chance**2 * (self._noise.scatter + self._noise.excess)
        limit += self._elastic[self._at_edge()]
        for _ in range(tracking.iterations):
            view = self._view(seen, arc, limit, spread)
            if view.information == 0:
                break
            gain = spread / (spread + self._noise.variance / view.information)
            step = expected + gain * (view.arc - expected) - arc
            if abs(step) < tracking.close:
                break
            arc += min(max(step, -tracking.longest_step), tracking.longest_step)
        return view

    def _view(
        self, seen: Array, arc: float, limit: float = math.inf, spread: float = 0
    ) -> FrameView:
        """View from an arc; rotors beyond the limit [rad^2] and the arc's spread are left out."""
        about = self.orbit.stretch(arc)
        before, beyond = self._backgrounds[self.orbit.leg(arc)]
        left = np.empty_like(before)
        frame_loops.compare(
            angles=seen,
            corrections=self.offsets.corrections,
            upside_down=self._upside_down,
            before=before,
            about=about.angles,
            beyond=beyond,
            first=about.first,
            differences=left,
        )
        doubtful = None
        if self._doubts:
            doubtful = self._far.doubtful
            left[self._far.stuck] = np.nan
        given = self._settings.noise
        return FrameView(arc, about.first, about.tangent, left, limit, spread, doubtful, given)

    def _learn_offsets(self, seen: Array, view: FrameView) -> None:
        """Learn offsets from the block that this frame fills."""
        known = np.count_nonzero(self.offsets.corrections)
        self._far.learn(-1 if self._upside_down else 1, self._noise.variance)
        self._far.look_for_doubtful(seen, view.outlying)
        self._doubts = bool(self._far.doubtful.any())
        self._disorder = max(self.offsets.typical - self._settings.offsets.evenness, 0.0)
        if np.count_nonzero(self.offsets.corrections) != known:
            self._noise.forget_what_lasted()

    def _report(self, time: float, status: TrackingStatus, motion: MultipleModelFilter) -> None:
        orbit = self.orbit
        arc, rate, arc_variance, covariance, rate_variance = motion.summary
        leg, place = orbit.leg(arc), orbit.place(arc)
        inside = 0 < place < orbit.chain.number_of_rotors - 1
        direction = (1 if leg % 2 == 0 else -1) if inside else 0
        completed, within = divmod(arc, orbit.length)
        site_arc = orbit.site_arc_at(arc)
        # The nearest point of the orbit is not to be told better than the frame is on it, nor
        # than the chain is that of the orbit: what rotors are off by, the arc is too.
        beside = self._tracking.beside_share**2 * self._noise.excess + self._disorder**2
        way = rate / (self._tracking.way_beside * orbit.site_arc)
        arc_deviation = math.sqrt(arc_variance + beside)
        rate_deviation = math.sqrt(rate_variance + beside * way**2)
        seen = self._seen_as if status is not TrackingStatus.COASTING else None
        self._estimate = OrbitEstimate(
            time=time,
            status=status,
            arc=arc,
            rate=rate,
            arc_deviation=arc_deviation,
            rate_deviation=rate_deviation,
            covariance=covariance,
            place=place,
            place_rate=direction * rate / site_arc,
            place_deviation=arc_deviation / site_arc,
            place_rate_deviation=rate_deviation / site_arc,
            leg=leg,
            leg_known=self._legs.known,
            phase=2 * math.pi * within / orbit.length,
            completed_cycles=int(completed),
            noise=self._noise.deviation,
            misfit=math.sqrt(self._noise.scatter),
            frame_misfit=math.sqrt(seen.mean_square) if seen else math.nan,
            upside_down=self._upside_down,
        )


def lost(time: float, noise: float = math.nan) -> OrbitEstimate:
    """Estimate of an instant [s] at which nothing is known, but for the noise [rad]."""
    nan = math.nan
    return OrbitEstimate(
        time=time,
        status=TrackingStatus.LOST,
        arc=nan,
        rate=nan,
        arc_deviation=nan,
        rate_deviation=nan,
        covariance=nan,
        place=nan,
        place_rate=nan,
        place_deviation=nan,
        place_rate_deviation=nan,
        leg=-1,
        leg_known=False,
        phase=nan,
        completed_cycles=0,
        noise=noise,
        misfit=nan,
        frame_misfit=nan,
        upside_down=False,
    )
