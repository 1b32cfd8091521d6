# SPDX-License-Identifier: Apache-2.0
"""Where on its cycle a chain is and how fast it goes round, from all frames so far.

A frame measures the arc s at the predicted point of the orbit, phi = Phi(s) + noise, so that with
t = dPhi/ds the measurement is z = s + t . (phi - Phi(s)) / t^2, with variance sigma^2 / t^2: near
the truth it is linear in the noise. `CycleMotion` takes it in, `FrameNoise` tells sigma and what
else there is beside the orbit, and `EncoderOffsets` what encoders add to their angles.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.chain import Array, Motion
from soliton_linkage.cycle import Cycle
from soliton_linkage.cycle_fit import fit_anywhere
from soliton_linkage.cycle_motion import CycleMotion
from soliton_linkage.encoder_offsets import EncoderOffsets
from soliton_linkage.frame_noise import BEYOND_CHANCE, FrameNoise, FrameView, wrapped

_ITERATIONS = 8
_CLOSE = 0.01
_LONGEST_STEP = 0.5
_UNKNOWN = 1.0
_STRANGEST = 0.6
_STRANGE_SHARE = 0.1
_STRANGE_RATIO = 9.0
_MOST_OUTLIERS = 0.3
_GAIN = 25.0
_BESIDE = 0.1


class Status(enum.Enum):
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
class CycleEstimate:
    """Where a chain is on its cycle; NaN, and leg -1, while it is lost."""

    time: float
    """Instant of the estimate [s]."""
    status: Status
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
    phase: float
    """Phase of the cycle [rad], 2 pi arc / length from 0 to 2 pi."""
    cycles: int
    """Whole cycles gone round; the phase grows on by 2 pi with each."""
    noise: float
    """Standard deviation of the angles' noise in use [rad], given or estimated."""
    misfit: float
    """Root mean square of what the orbit leaves of the rotors about the wall [rad]."""
    upside_down: bool
    """Whether the chain is the image phi -> pi - phi of the cycle's."""


class CycleFilter:
    """Recursive estimate of a chain's arc and rate, from frames as they come.

    Frames that repeat a stamp or come late are ignored; a stamp that goes back by more than the
    clock limit [s] starts anew, and so do frames that cannot be where the chain is expected. The
    offsets of encoders are learnt on the way, and outlive a new start.
    """

    def __init__(
        self,
        cycle: Cycle,
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
        self.cycle = cycle
        self.offsets = EncoderOffsets(cycle.chain.number_of_rotors, rest_angle_deviation)
        self.ignored = 0
        self.rejected = 0
        self.starts = 0
        self._given_noise = noise
        self._clock_limit = clock_limit
        self._backgrounds = [
            cycle.background(cycle.arc_at(cycle.middle, leg))
            for leg in range(cycle.number_of_legs)
        ]
        spinner = cycle.chain.motion is Motion.SPINNER
        swing = math.pi if spinner else 2 * cycle.chain.rest_angle
        self._tolerated = (_STRANGE_SHARE * swing) ** 2
        self._upside_down = False
        self._forget(math.nan)

    @property
    def estimate(self) -> CycleEstimate:
        """The latest estimate."""
        return self._estimate

    def update(self, time: float, angles: Array) -> CycleEstimate:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        Raises ValueError for angles that are not one a rotor; all else it takes as it comes.
        """
        rotors = self.cycle.chain.number_of_rotors
        if np.shape(angles) != (rotors,):
            raise ValueError(
                f'angles of shape {np.shape(angles)} do not fit a chain of {rotors} rotors; give '
                'one angle a rotor, NaN where it is unknown'
            )
        elapsed = time - self._estimate.time
        if not math.isfinite(time) or -self._clock_limit <= elapsed <= 0:
            self.ignored += 1
            return self._estimate
        if elapsed < 0:
            self._forget(time)
        seen = np.where(np.isfinite(angles), angles, np.nan)
        if self._motion is not None:
            self._follow(self._motion, time, elapsed, seen)
        elif not self._acquire(time, seen):
            self._forget(time)
        return self._estimate

    def _forget(self, time: float) -> None:
        self._motion: CycleMotion | None = None
        self._noise = FrameNoise(self._given_noise)
        self._doubted = self._strange_running = 0
        self._estimate = _lost(time, self._noise.deviation)

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
        view = self._view(seen, place.arc)
        view = self._view(seen, place.arc, view.robust_limit)
        self._noise.update(view)
        scale = 1 / self.cycle.chain.time_unit
        variance = self._noise.variance / view.information
        self._motion = CycleMotion(view.arc, variance, scale, self.cycle.site_arc)
        self._report(time, Status.ACQUIRED, self._motion)

    def _searched_both(self, seen: Array) -> _Place:
        """Nearest point of the orbit, as it is and upside down."""
        places = [self._searched(seen, turned) for turned in (False, True)]
        return min(places, key=lambda place: place.misfit)

    def _searched(self, seen: Array, turned: bool) -> _Place:
        """Nearest point of the orbit, or of its image upside down."""
        angles = seen - self.offsets.corrections
        angles = math.pi - angles if turned else angles
        fit = fit_anywhere(self.cycle, angles) if np.isfinite(angles).any() else None
        if fit is None or fit.information == 0:
            return _Place(math.nan, turned, math.inf)
        left = wrapped(angles - self.cycle.configuration(fit.arc))
        return _Place(fit.arc, turned, math.sqrt(float(np.nanmean(left**2))))

    def _follow(self, motion: CycleMotion, time: float, elapsed: float, seen: Array) -> None:
        motion.predict(elapsed, self._noise.excess)
        if 4 * motion.arc_deviation > self.cycle.length:
            self._forget(time)
            self._acquire(time, seen)
            return
        view = self._recognised(motion, seen)
        if view.information == 0:
            self._report(time, Status.COASTING, motion)
            return
        limit = _STRANGE_RATIO * self._noise.scatter + self._tolerated
        strange = view.mean_square > limit or view.share_of_outliers > _MOST_OUTLIERS
        self._strange_running = self._strange_running + 1 if strange else 0
        if (strange or view.has_outliers) and self._is_elsewhere(view, strange, time, seen):
            return
        if strange and not view.root_mean_square_of_all < _STRANGEST:
            self.rejected += 1
            self._report(time, Status.COASTING, motion)
            return
        self._tolerated = max(self._tolerated, view.mean_square if strange else 0.0)
        self._correct(motion, seen, view, elapsed)
        self._report(time, Status.TRACKING, motion)

    def _is_elsewhere(self, view: FrameView, strange: bool, time: float, seen: Array) -> bool:
        """Start anew where a frame that is not as expected fits far better than it does there.

        The whole cycle is searched the first, second, fourth, eighth, ... time.
        """
        self._doubted += not strange
        times = self._strange_running if strange else self._doubted
        if times & (times - 1):
            return False
        place = self._searched_both(seen)
        known = np.count_nonzero(np.isfinite(view.residuals))
        gained = known * (view.root_mean_square_of_all**2 - place.misfit**2)
        apart = abs(math.remainder(place.arc - view.arc, self.cycle.length))
        moved = apart > _UNKNOWN or place.turned != self._upside_down
        if place.misfit < _STRANGEST and moved and gained > _GAIN * self._noise.scatter:
            self._start_at(place, time, seen)
            return True
        return False

    def _correct(self, motion: CycleMotion, seen: Array, view: FrameView, elapsed: float) -> None:
        if motion.surprised(view.arc, self._noise.variance / view.information, elapsed):
            view = self._recognised(motion, seen)
        motion.correct(view.arc, self._noise.variance / view.information)
        motion.reach = self.cycle.site_arc / view.concentration
        self._noise.update(view)
        self._learn_offsets(view, elapsed)

    def _recognised(self, motion: CycleMotion, seen: Array) -> FrameView:
        """View of a frame from the likeliest arc, by the frame and by what went before.

        Where what went before does not tell on which slope, the whole cycle is searched.
        """
        expected, spread = motion.expected
        if spread > _UNKNOWN:
            place = self._searched(seen, self._upside_down)
            if place.misfit < _STRANGEST:
                turns = round((expected - place.arc) / self.cycle.length)
                return self._view(seen, place.arc + turns * self.cycle.length)
        arc = expected
        for _ in range(_ITERATIONS):
            view = self._view(seen, arc, BEYOND_CHANCE**2 * self._noise.scatter, spread)
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
        angles = seen - self.offsets.corrections
        angles = math.pi - angles if self._upside_down else angles
        about = self.cycle.stretch(arc)
        before, beyond = self._backgrounds[self.cycle.leg(arc)]
        end = about.first + len(about.angles)
        expected = np.concatenate([before[: about.first], about.angles, beyond[end:]])
        left = wrapped(angles - expected)
        return FrameView(arc, about.first, about.tangent, left, limit, spread)

    def _learn_offsets(self, view: FrameView, elapsed: float) -> None:
        rotors = np.arange(len(view.residuals))
        sides = np.where(rotors < self.cycle.place(view.arc), 1, -1)
        about = slice(view.first, view.first + len(view.tangent))
        sides[about][np.abs(view.tangent) > _BESIDE] = 0
        residuals = -view.residuals if self._upside_down else view.residuals
        waves = 10 * self.cycle.chain.time_unit / elapsed
        variance = self._noise.variance + self._noise.lasting * max(waves, 1.0)
        known = np.count_nonzero(self.offsets.corrections)
        self.offsets.update(residuals + self.offsets.corrections, sides, variance)
        if np.count_nonzero(self.offsets.corrections) != known:
            self._noise.forget_what_lasted()

    def _report(self, time: float, status: Status, motion: CycleMotion) -> None:
        cycle, arc = self.cycle, motion.arc
        leg, place = cycle.leg(arc), cycle.place(arc)
        inside = 0 < place < cycle.chain.number_of_rotors - 1
        direction = (1 if leg % 2 == 0 else -1) if inside else 0
        cycles, within = divmod(arc, cycle.length)
        self._estimate = CycleEstimate(
            time=time,
            status=status,
            arc=arc,
            rate=motion.rate,
            arc_deviation=motion.arc_deviation,
            rate_deviation=motion.rate_deviation,
            covariance=motion.covariance,
            place=place,
            velocity=direction * motion.rate / cycle.site_arc,
            place_deviation=motion.arc_deviation / cycle.site_arc,
            velocity_deviation=motion.rate_deviation / cycle.site_arc,
            leg=leg,
            phase=2 * math.pi * within / cycle.length,
            cycles=int(cycles),
            noise=self._noise.deviation,
            misfit=math.sqrt(self._noise.scatter),
            upside_down=self._upside_down,
        )


@dataclass(frozen=True)
class _Place:
    """A point of the orbit, or of its image, that a frame may show."""

    arc: float
    turned: bool
    misfit: float
    """Root mean square of what is left of all rotors that are known [rad]."""


def _lost(time: float, noise: float) -> CycleEstimate:
    nan = math.nan
    return CycleEstimate(
        time=time,
        status=Status.LOST,
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
        phase=nan,
        cycles=0,
        noise=noise,
        misfit=nan,
        upside_down=False,
    )
