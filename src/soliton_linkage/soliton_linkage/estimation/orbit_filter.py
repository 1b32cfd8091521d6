# SPDX-License-Identifier: Apache-2.0
"""Where on its cycle a chain is and how fast it goes round, from all frames so far.

A frame measures the arc s at the predicted point of the orbit, phi = Phi(s) + noise, so that with
t = dPhi/ds the measurement is z = s + t . (phi - Phi(s)) / t^2, with variance sigma^2 / t^2: near
the truth it is linear in the noise. `MultipleModelFilter` takes it in, `FrameNoise` tells sigma
and what else there is beside the orbit, and `EncoderOffsets` what encoders add to their angles.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets, FarRotors
from soliton_linkage.estimation.frame_noise import BEYOND_CHANCE, FrameNoise, FrameView
from soliton_linkage.estimation.leg_evidence import LegEvidence
from soliton_linkage.estimation.loops.filter_arrays import filter_loops
from soliton_linkage.estimation.loops.frame_arrays import frame_loops
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.nearest_point import fit_anywhere
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Motion, check_shape, wrapped
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit

_ITERATIONS = 8
_CLOSE = 0.01
_LONGEST_STEP = 0.5
_UNKNOWN = 1.0
_STRANGEST = 0.6
_STRANGE_SHARE = 0.1
_STRANGE_RATIO = 9.0
_ELASTIC_SHARES = (0.03, 0.06)
_MOST_OUTLIERS = 0.3
_GAIN = 25.0
_SAME_PLACE = 2.0
_ROTORS_AT_EDGE = 2.0
_DEPTHS_BESIDE = 3.0
_BESIDE = 0.08
_EVEN = 0.004
_MOST_ALIKE = 1000.0
_WAY_BESIDE = 0.5


class TrackingStatus(enum.Enum):
    """What an estimate rests on."""

    LOST = 'lost'
    """On nothing: no frame has been recognised."""
    ACQUIRED = 'acquired'
    """On one frame, searched along the whole cycle; of the rate only its scale is known."""
    TRACKING = 'tracking'
    """On this frame and those before."""
    COASTING = 'coasting'
    """On frames before; this one was empty or could not be."""


@dataclass(frozen=True)
class OrbitEstimate:
    """Where a chain is on its cycle; NaN, and leg -1, while it is lost."""

    time: float
    """Instant of the estimate [s]."""
    status: TrackingStatus
    """What it rests on."""
    arc: float
    """Arc length along the orbit [rad], which counts cycles."""
    rate: float
    """Rate of the arc length [rad/s]."""
    arc_deviation: float
    """Standard deviation of the arc length [rad]."""
    rate_deviation: float
    """Standard deviation of the rate [rad/s]."""
    covariance: float
    """Covariance of arc length and rate [rad^2/s]."""
    place: float
    """Place of the wall [rotor spacings]."""
    velocity: float
    """Velocity of the wall [rotor spacings / s], 0 while it waits at an edge."""
    place_deviation: float
    """Standard deviation of the place [rotor spacings]."""
    velocity_deviation: float
    """Standard deviation of the velocity [rotor spacings / s]."""
    leg: int
    """Leg of the cycle."""
    leg_known: bool
    """Whether it can be no other leg with the wall at the same place.

    A flipper whose edge rotors were not seen may be on two legs or on four, of which leg, arc,
    rate and phase follow one.
    """
    phase: float
    """Phase of the cycle [rad], 2 pi arc / length from 0 to 2 pi."""
    orbits: int
    """Whole cycles gone round; the phase grows on by 2 pi with each."""
    noise: float
    """Standard deviation of the angles' noise in use [rad], given or estimated."""
    misfit: float
    """Root mean square of what the orbit leaves of the rotors about the wall, of late [rad]."""
    frame_misfit: float
    """The same of this frame alone [rad], NaN for one that was empty."""
    upside_down: bool
    """Whether the chain is the image phi -> pi - phi of the cycle's."""


class OrbitFilter:
    """Recursive estimate of a chain's arc and rate, from frames as they come.

    Frames that repeat a stamp or come late are ignored; a stamp that goes back by more than the
    clock limit [s] starts anew, and so do frames that cannot be where the chain is expected. The
    offsets of encoders are learnt on the way, and outlive a new start.
    """

    def __init__(
        self,
        orbit: Orbit,
        noise: float | None = None,
        clock_limit: float = 1.0,
        rest_angle_deviation: float = 0.05,
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
        self.offsets = EncoderOffsets(chain.number_of_rotors, rest_angle_deviation)
        self.ignored = 0
        self.rejected = 0
        self.starts = 0
        self._given_noise = noise
        self._clock_limit = clock_limit
        self._depth = penetration_depth(chain) / chain.spacing
        self._legs = LegEvidence(orbit)
        filter_loops()  # they are loaded now, rather than while a frame waits
        self._deviates = chain.deviations != NO_DEVIATIONS
        self._backgrounds = [
            orbit.background(orbit.arc_at(orbit.middle, leg))
            for leg in range(orbit.number_of_legs)
        ]
        swing = math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle
        self._tolerated = (_STRANGE_SHARE * swing) ** 2
        self._elastic = [(share * swing) ** 2 for share in _ELASTIC_SHARES]
        margin = 1 + _DEPTHS_BESIDE * self._depth
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
        if not math.isfinite(time) or -self._clock_limit <= elapsed <= 0:
            self.ignored += 1
            return self._estimate
        if elapsed < 0:
            self._forget(time)
        seen = np.ascontiguousarray(angles, dtype=np.float64)
        if not frame_loops().all_within(seen, math.inf):
            seen = np.where(np.isfinite(seen), seen, np.nan)
        if self._motion is not None:
            self._follow(self._motion, time, elapsed, seen)
        elif not self._acquire(time, seen):
            self._forget(time)
        return self._estimate

    def _forget(self, time: float) -> None:
        self._motion: MultipleModelFilter | None = None
        self._seen_as: FrameView | None = None
        self._noise = FrameNoise(self._given_noise)
        self._doubted = self._strange_running = 0
        self._estimate = lost(time, self._noise.deviation)

    def _acquire(self, time: float, seen: Array) -> bool:
        """Search a frame for the chain; say whether it is there."""
        place = self._searched_both(seen)
        if not place.misfit < _STRANGEST:
            return False
        self._start_at(place, time, seen)
        return True

    def _start_at(self, place: _Place, time: float, seen: Array) -> None:
        self.starts += 1
        self._upside_down = place.turned
        self._doubted = self._strange_running = 0
        self._noise = FrameNoise(self._given_noise)
        self._far.forget()
        view = self._view(seen, place.arc)
        view = self._view(seen, place.arc, view.robust_limit)
        self._noise.update(view, 0.0)
        self._legs.forget()
        self._legs.update(view, max(self._noise.variance, view.mean_square))
        scale = 1 / self.orbit.chain.time_unit
        variance = self._noise.variance / view.information
        self._motion = MultipleModelFilter(view.arc, variance, scale, self.orbit.site_arc)
        self._seen_as = view
        self._report(time, TrackingStatus.ACQUIRED, self._motion)

    def _searched_both(self, seen: Array) -> _Place:
        """Nearest point of the orbit, as it is and upside down."""
        places = [self._searched(seen, turned) for turned in (False, True)]
        return min(places, key=lambda place: place.misfit)

    def _searched(self, seen: Array, turned: bool) -> _Place:
        """Nearest point of the orbit, or of its image upside down."""
        angles = seen - self.offsets.corrections
        angles = math.pi - angles if turned else angles
        fit = fit_anywhere(self.orbit, angles) if np.isfinite(angles).any() else None
        if fit is None or fit.information == 0:
            return _Place(math.nan, turned, math.inf)
        left = wrapped(angles - self.orbit.configuration(fit.arc))
        return _Place(fit.arc, turned, math.sqrt(float(np.nanmean(left**2))))

    def _follow(
        self, motion: MultipleModelFilter, time: float, elapsed: float, seen: Array
    ) -> None:
        self._predict(motion, elapsed)
        if 4 * math.sqrt(motion.expected_variance) > self.orbit.length:
            self._forget(time)
            self._acquire(time, seen)
            return
        view = self._recognised(motion, seen)
        if view.information == 0:
            self._seen_as = view if np.isfinite(view.residuals).any() else None
            self._report(time, TrackingStatus.COASTING, motion)
            return
        self._seen_as = view
        limit = _STRANGE_RATIO * self._noise.scatter + self._tolerated
        strange = view.mean_square > limit or view.share_of_outliers > _MOST_OUTLIERS
        self._strange_running = self._strange_running + 1 if strange else 0
        if (strange or view.any_outlying) and self._is_elsewhere(view, strange, time, seen):
            return
        if strange and not view.mean_square_of_all < _STRANGEST**2:
            self.rejected += 1
            self._report(time, TrackingStatus.COASTING, motion)
            return
        self._tolerated = max(self._tolerated, view.mean_square if strange else 0.0)
        self._correct(motion, seen, view, elapsed)
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
        return to_edge < _ROTORS_AT_EDGE + self._depth

    def _is_elsewhere(self, view: FrameView, strange: bool, time: float, seen: Array) -> bool:
        """Start anew where a frame that is not as expected fits far better than it does there.

        The whole cycle is searched the first, second, fourth, eighth, ... time. Where the wall
        is as expected, it may be on another leg, but not at another place.
        """
        self._doubted += not strange
        times = self._strange_running if strange else self._doubted
        if times & (times - 1):
            return False
        place = self._searched_both(seen)
        known = np.count_nonzero(np.isfinite(view.residuals))
        gained = known * (view.mean_square_of_all - place.misfit**2)
        if not (place.misfit < _STRANGEST and gained > _GAIN * self._noise.scatter):
            return False
        orbit = self.orbit
        apart = abs(math.remainder(place.arc - view.arc, orbit.length))
        moved = apart > _UNKNOWN or place.turned != self._upside_down
        if not strange:
            apart = abs(orbit.place(place.arc) - orbit.place(view.arc))
            moved = orbit.leg(place.arc) != orbit.leg(view.arc) and apart < _SAME_PLACE
        if moved:
            self._start_at(place if strange else self._on_this_turn(place), time, seen)
        return moved

    def _on_this_turn(self, place: _Place) -> _Place:
        """The same point of the orbit, with as many cycles gone round as the wall has."""
        length = self.orbit.length
        turns = round((self._estimate.arc - place.arc) / length)
        return replace(place, arc=place.arc + turns * length)

    def _correct(
        self, motion: MultipleModelFilter, seen: Array, view: FrameView, elapsed: float
    ) -> None:
        noise = self._noise
        motion.correct(view.arc, self._variance(motion, view, elapsed), noise.freedoms)
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
        return variance + self._noise.excess * missing * min(frames, _MOST_ALIKE)

    def _recognised(self, motion: MultipleModelFilter, seen: Array) -> FrameView:
        """View of a frame from the likeliest arc, by the frame and by what went before.

        Where what went before does not tell on which slope, the whole cycle is searched.
        """
        expected, spread = motion.expected, motion.expected_variance
        if spread > _UNKNOWN:
            place = self._searched(seen, self._upside_down)
            if place.misfit < _STRANGEST:
                turns = round((expected - place.arc) / self.orbit.length)
                return self._view(seen, place.arc + turns * self.orbit.length)
        arc = expected
        limit = BEYOND_CHANCE**2 * (self._noise.scatter + self._noise.excess)
        limit += self._elastic[self._at_edge()]
        for _ in range(_ITERATIONS):
            view = self._view(seen, arc, limit, spread)
            if view.information == 0:
                break
            gain = spread / (spread + self._noise.variance / view.information)
            step = expected + gain * (view.arc - expected) - arc
            if abs(step) < _CLOSE:
                break
            arc += min(max(step, -_LONGEST_STEP), _LONGEST_STEP)
        return view

    def _view(
        self, seen: Array, arc: float, limit: float = math.inf, spread: float = 0
    ) -> FrameView:
        """View from an arc; rotors beyond the limit [rad^2] and the arc's spread are left out."""
        about = self.orbit.stretch(arc)
        before, beyond = self._backgrounds[self.orbit.leg(arc)]
        left = np.empty_like(before)
        frame_loops().compare(
            seen,
            self.offsets.corrections,
            self._upside_down,
            before,
            about.angles,
            beyond,
            about.first,
            left,
        )
        doubtful = None
        if self._doubts:
            doubtful = self._far.doubtful
            left[self._far.stuck] = np.nan
        return FrameView(arc, about.first, about.tangent, left, limit, spread, doubtful)

    def _learn_offsets(self, seen: Array, view: FrameView) -> None:
        known = np.count_nonzero(self.offsets.corrections)
        self._far.learn(-1 if self._upside_down else 1, self._noise.variance)
        self._far.look_for_doubtful(seen, view.outlying)
        self._doubts = bool(self._far.doubtful.any())
        self._disorder = max(self.offsets.typical - _EVEN, 0.0)
        if np.count_nonzero(self.offsets.corrections) != known:
            self._noise.forget_what_lasted()

    def _report(self, time: float, status: TrackingStatus, motion: MultipleModelFilter) -> None:
        orbit = self.orbit
        arc, rate, arc_variance, covariance, rate_variance = motion.summary
        leg, place = orbit.leg(arc), orbit.place(arc)
        inside = 0 < place < orbit.chain.number_of_rotors - 1
        direction = (1 if leg % 2 == 0 else -1) if inside else 0
        orbits, within = divmod(arc, orbit.length)
        site_arc = orbit.site_arc_at(arc)
        # The nearest point of the orbit is not to be told better than the frame is on it, nor
        # than the chain is that of the cycle: what rotors are off by, the arc is too.
        beside = _BESIDE**2 * self._noise.excess + self._disorder**2
        way = rate / (_WAY_BESIDE * orbit.site_arc)
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
            velocity=direction * rate / site_arc,
            place_deviation=arc_deviation / site_arc,
            velocity_deviation=rate_deviation / site_arc,
            leg=leg,
            leg_known=self._legs.known,
            phase=2 * math.pi * within / orbit.length,
            orbits=int(orbits),
            noise=self._noise.deviation,
            misfit=math.sqrt(self._noise.scatter),
            frame_misfit=math.sqrt(seen.mean_square) if seen else math.nan,
            upside_down=self._upside_down,
        )


@dataclass(frozen=True)
class _Place:
    """A point of the orbit, or of its image, that a frame may show."""

    arc: float
    turned: bool
    misfit: float
    """Root mean square of what is left of all rotors that are known [rad]."""


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
        velocity=nan,
        place_deviation=nan,
        velocity_deviation=nan,
        leg=-1,
        leg_known=False,
        phase=nan,
        orbits=0,
        noise=noise,
        misfit=nan,
        frame_misfit=nan,
        upside_down=False,
    )
