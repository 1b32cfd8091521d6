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
from functools import cached_property
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets, FarRotors
from soliton_linkage.estimation.frame_noise import FrameNoise
from soliton_linkage.estimation.loops import frame_loops
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.places.frame_view import NO_FLAGS, FrameLikelihood, FrameView
from soliton_linkage.estimation.places.place_hypotheses import Hypotheses, Hypothesis
from soliton_linkage.estimation.places.place_search import Place, PlaceSearch, ScanBudget
from soliton_linkage.estimation.pushes import Push, pushed_rate, yielding
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


class OrbitEstimate(NamedTuple):
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
        self._search = PlaceSearch(orbit, settings.likelihood, settings.scan)
        self._budget = ScanBudget(settings.scan)
        self._depth = penetration_depth(chain) / chain.spacing
        self._deviates = chain.deviations != NO_DEVIATIONS
        self._backgrounds = [
            orbit.background(orbit.arc_at(orbit.middle, leg))
            for leg in range(orbit.number_of_legs)
        ]
        swing = math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle
        self._likelihood = FrameLikelihood(swing, settings.likelihood)
        self._elastic = (settings.likelihood.elastic_share * swing) ** 2
        self._gross = settings.likelihood.gross_share * swing
        self._largest_field = (settings.likelihood.field_share * swing) ** 2
        self._most_about_wall = (settings.likelihood.wall_share * swing) ** 2
        margin = 1 + settings.offsets.depths_beside * self._depth
        self._far = FarRotors(self.offsets, margin, chain.time_unit, self._elastic)
        self._none_off = np.zeros(chain.number_of_rotors, dtype=np.bool_)
        self._never = np.zeros(chain.number_of_rotors, dtype=np.int64)
        shifts = settings.offsets.wall_shifts
        self._shift = shifts[1] if chain.motion is Motion.SPINNER else shifts[0]
        self._doubts = False
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
            self._budget.restart()
        seen = np.ascontiguousarray(angles, dtype=np.float64)
        if not frame_loops.all_within(seen, math.inf):
            seen = np.where(np.isfinite(seen), seen, np.nan)
        if self._places.all:
            self._follow(time, elapsed, seen)
        elif not self._acquire(time, seen):
            self._forget(time)
        return self._estimate

    def push(self, push: Push) -> None:
        """Take in a push that acts from the latest frame on.

        How far a wall went on since the push is left to that frame to tell, and unsure by it.
        """
        for each in self._places.all:
            rigid, rate = self._pushed_by(push.impulses, each), each.motion.rate
            change = pushed_rate(rate, rigid, self._yielding) - rate
            doubt = self._tracking.yielding_doubt * (rigid - change)
            each.motion.push(change, doubt**2, (change * push.ago) ** 2)
        if self._places.all:
            self._report(self._estimate.time, self._estimate.status)

    @cached_property
    def _yielding(self) -> float:
        return yielding(self.orbit.chain)

    def _pushed_by(self, impulses: Array, hypothesis: Hypothesis) -> float:
        """Change of the rate by impulses, were bars rigid, t . J / sum(I t^2) [rad/s]."""
        about = self.orbit.stretch(hypothesis.motion.arc)
        within = slice(about.first, about.first + len(about.tangent))
        inertia = self.orbit.chain.moments_of_inertia[within] @ about.tangent**2
        change = float(about.tangent @ impulses[within] / inertia)
        return -change if hypothesis.upside_down else change

    def _forget(self, time: float) -> None:
        self._places = Hypotheses(self.orbit, self._settings.hypotheses)
        self._seen_as: FrameView | None = None
        self._noise = FrameNoise(self._given_noise, self._settings.noise, self._gross)
        self._unexplained_since = math.nan
        self._unexplained = 0
        self._beyond = self._edge = False
        self._off = self._none_off
        self._strained = self._never
        self._way = math.inf
        self._frames = 0
        self._estimate = lost(time, self._given_noise or math.nan)

    def _acquire(self, time: float, seen: Array) -> bool:
        """Search a frame for the chain; say whether it is there."""
        if not np.isfinite(seen).any() or not self._budget.spend(time):
            return False
        places = self._found(seen)
        if not places:
            return False
        self._start_at(places, time, seen)
        return True

    def _found(self, seen: Array) -> list[Place]:
        """Places of a frame that compete, none where it does not tell any."""
        angles = seen - self.offsets.corrections
        competition = self._search.find(angles, self._given_noise or 0.0)
        if competition.told < self._settings.scan.told:
            return []
        best = competition.places[0]
        if not self._likelihood.explains(best.view, best.variance):
            return []
        least = best.evidence - self._settings.hypotheses.evidence
        return [each for each in competition.places if each.evidence > least]

    def _start_at(self, places: list[Place], time: float, seen: Array) -> None:
        self.starts += 1
        self._unexplained, self._unexplained_since = 0, math.nan
        self._frames = 0
        best = places[0]
        self._noise = FrameNoise(self._given_noise, self._settings.noise, self._gross)
        self._noise.update(best.view, 0.0)
        self._far.forget()
        scale = 1 / self.orbit.chain.time_unit
        self._places = Hypotheses(self.orbit, self._settings.hypotheses)
        for place in places:
            variance = (self._noise.variance + self._seen_field(place)) / place.view.information
            motion = MultipleModelFilter(
                place.arc, variance, scale, self.orbit.site_arc, self._settings.filter
            )
            evidence = place.evidence - best.evidence
            self._places.all.append(Hypothesis(motion, place.upside_down, place.view, evidence))
        self._seen_as = best.view
        self._report(time, TrackingStatus.ACQUIRED)

    def _seen_field(self, place: Place) -> float:
        """Variance of a rotor beside noise [rad^2], where one frame shows any beyond chance."""
        left, shares = place.view.left, place.view.tangent**2
        free = float(np.sum(shares - shares**2))
        seen = float(shares @ left**2) / max(free, 1e-12)
        return seen if seen > self._tracking.field_beyond_chance * self._noise.variance else 0.0

    def _follow(self, time: float, elapsed: float, seen: Array) -> None:
        self._edge = self._at_edge()
        for each in self._places.all:
            self._predict(each.motion, elapsed)
        best = self._places.leader.motion
        if self._tracking.lost_deviations * math.sqrt(best.expected_variance) > self.orbit.length:
            self._forget(time)
            self._acquire(time, seen)
            return
        self._way = abs(best.expected_rate) * elapsed / self.orbit.site_arc
        variance = self._looked_at(seen, elapsed)
        self._weigh(variance)
        view = self._places.leader.view
        if not view.known:
            self._seen_as = None
            self._report(time, TrackingStatus.COASTING)
            return
        self._seen_as = view
        explained = self._is_explained(view, variance)
        if not explained and self._doubted(time, seen):
            return
        self._unexplained_since = math.nan if explained else self._unexplained_since
        if explained:
            self._unexplained = 0
        untold = view.information < self._settings.search.least_information
        if untold or not (explained or self._is_believed(view)):
            self.rejected += not explained
            self._report(time, TrackingStatus.COASTING)
            return
        for each in self._places.all:
            self._update_by(each, elapsed)
        self._learn(seen, view, elapsed)
        self._places.suppose_toggled()
        self._report(time, TrackingStatus.TRACKING if explained else TrackingStatus.COASTING)

    def _looked_at(self, seen: Array, elapsed: float) -> float:
        """See a frame from each place; return the variance of a rotor that it was seen with.

        A wall that was pushed is on before where it is expected, and what springs do to it is not
        that of before: it is looked for as one that was found now.
        """
        variance = self._see(seen, 0.0)
        if not self._is_strained(self._places.leader.view):
            return variance
        views, frames = [each.view for each in self._places.all], self._frames
        self._frames = 0
        widened = self._see(seen, (elapsed / self.orbit.chain.time_unit) ** 2)
        if self._is_believed(self._places.leader.view):
            return widened
        self._frames = frames
        for each, view in zip(self._places.all, views, strict=True):
            each.view = view
        return variance

    def _is_strained(self, view: FrameView) -> bool:
        """Whether a wall is off as by a push: several rotors side by side, or one for a while.

        They are no further off than springs could have them, and most of the wall is seen.
        """
        seen = view.information_of_all > self._settings.likelihood.believed
        if self._is_believed(view) or not seen:
            self._strained = self._never
            return False
        off = view.outlying & (np.abs(view.residuals) < self._gross)
        self._strained = np.where(off, self._strained + 1, 0)
        run = off[:-2] & off[1:-1] & off[2:]
        return bool(run.any() or (self._strained >= self._tracking.strained_frames).any())

    def _see(self, seen: Array, pushed: float) -> float:
        """See a frame from places that pushes may have moved by a variance [rad^2]."""
        variance = self._variance_of_a_rotor()
        for each in self._places.all:
            each.view = self._recognised(each, seen, variance, pushed)
        return variance

    def _is_believed(self, view: FrameView) -> bool:
        """Whether most of what the rotors about the wall tell is believed."""
        believed = self._settings.likelihood.believed
        return view.information >= believed * view.information_of_all

    def _is_explained(self, view: FrameView, variance: float) -> bool:
        """Whether a frame is that of a wall, of rotors of a variance [rad^2].

        Readings that are wrong at random are so in one frame; rotors that are far off in two
        running are elsewhere.
        """
        off, staying = self._none_off, 0
        if view.off:
            off = view.outlying & (np.abs(view.residuals) > self._gross) & ~self._far.doubtful
            staying = int(np.count_nonzero(off & self._off))
        self._off = off
        largest = variance + self._largest_field
        few = staying <= self._settings.likelihood.most_staying
        return few and not self._beyond and self._likelihood.explains(view, largest)

    def _variance_of_a_rotor(self) -> float:
        """Variance of a rotor from the orbit, by noise and the field beside it [rad^2].

        The field is that of late, and what it may have changed by since the last frame.
        """
        noise = self._noise
        about = self._tracking.field_ratio * max(noise.excess, noise.field)
        field = max(noise.scatter - noise.variance, 0.0) + about
        self._beyond = noise.about_wall > self._most_about_wall
        changed = max(min(self._way, 1.0), math.exp(-self._frames / self._tracking.settled))
        at_edge = self._tracking.edge_ratio if self._edge else 1.0
        field += self._elastic * changed * at_edge
        return noise.variance + min(field, self._largest_field)

    def _doubted(self, time: float, seen: Array) -> bool:
        """Start anew where a frame that is not explained is by another place; say whether.

        Where it is by none for long, the chain is lost.
        """
        if self._unexplained == 0:
            self._unexplained_since = time
        self._unexplained += 1
        if self._unexplained >= self._tracking.jump_frames and self._budget.spend(time):
            places = self._found(seen)
            view = self._places.leader.view
            if places and self._gain(places[0], view, seen) > self._tracking.gain:
                self._start_at([self._on_this_turn(each) for each in places], time, seen)
                return True
        tracking = self._tracking
        long = time - self._unexplained_since > tracking.doubted_time
        view = self._places.leader.view
        hopeless = self._beyond or not self._is_believed(view)
        if long and self._unexplained > tracking.doubted_frames and hopeless:
            self._forget(time)
            return True
        return False

    def _gain(self, place: Place, view: FrameView, seen: Array) -> float:
        """How much likelier a frame is at another place than where it was expected [log]."""
        there = self._view(
            seen,
            self._places.leader.motion.expected,
            place.variance,
            0.0,
            self._places.leader.upside_down,
        )
        same = self._view(seen, view.arc, place.variance, 0.0, self._places.leader.upside_down)
        return place.view.likelihood - max(there.likelihood, same.likelihood)

    def _predict(self, motion: MultipleModelFilter, elapsed: float) -> None:
        """Go on by a time [s]; where rotors deviate, the rate varies along the orbit."""
        before = self.orbit.free_rate(motion.arc) if self._deviates else 1.0
        motion.predict(elapsed, self._edge)
        if self._deviates:
            motion.change_rate(self.orbit.free_rate(motion.arc) / before)

    def _at_edge(self) -> bool:
        """Whether the wall was so near to an edge that springs take up or give back energy."""
        last = self.orbit.chain.number_of_rotors - 1
        to_edge = min(self._estimate.place, last - self._estimate.place)
        return bool(to_edge < self._tracking.edge_rotors + self._depth)

    def _on_this_turn(self, place: Place) -> Place:
        """The same point of the orbit, with as many cycles gone round as the wall has."""
        length = self.orbit.length
        turns = round((self._estimate.arc - place.arc) / length)
        return place._replace(arc=place.arc + turns * length)

    def _weigh(self, variance: float) -> None:
        """Weigh the places by how likely each made the frame, of rotors of a variance [rad^2].

        What springs do to a frame lasts while the wall moves on by about half a rotor: so many
        frames, of which each shows the same, are to count as one.
        """
        if len(self._places.all) > 1:
            alike = self._tracking.way_beside / max(self._way, 1e-9)
            variance += self._elastic * min(max(alike, 1.0), self._tracking.most_alike)
            views = [each.view for each in self._places.all]
            self._places.weigh([self._likelihood.of_residuals(view, variance) for view in views])

    def _update_by(self, hypothesis: Hypothesis, elapsed: float) -> None:
        """Update a filter by its view of a frame, a time [s] after the last."""
        view, motion = hypothesis.view, hypothesis.motion
        if view.information > self._settings.search.least_information:
            variance = self._variance(motion, view, elapsed)
            motion.update(view.arc, variance, self._noise.degrees_of_freedom)

    def _learn(self, seen: Array, view: FrameView, elapsed: float) -> None:
        """Learn noise, field and offsets from what the likeliest place leaves of a frame."""
        self._noise.update(view, elapsed)
        self._frames += 1
        place = self.orbit.place(view.arc)
        outlying = view.outlying if view.unbelieved else None
        if self._far.add(view.residuals, outlying, place, elapsed):
            self._learn_offsets(seen, view)

    def _variance(self, motion: MultipleModelFilter, view: FrameView, elapsed: float) -> float:
        """Variance of the arc that a frame shows [rad^2].

        Rotors of which some are not seen have another nearest point than all of them, by what
        the frame is beside the orbit, for as long as the wall takes to pass a rotor; those of
        which some are not believed only in this frame.
        """
        known = max(view.information_of_all, view.information)
        unseen, unbelieved = max(1 / known - 1, 0.0), 1 / view.information - 1 / known
        frames = max(self.orbit.site_arc / max(abs(motion.expected_rate) * elapsed, 1e-9), 1.0)
        noise = self._noise
        field = noise.excess + (self._elastic if self._edge else 0.0)
        lasting = field * unseen * min(frames, self._tracking.most_alike)
        fleeting = max(noise.scatter - noise.variance, field) * unbelieved
        return noise.variance / view.information + lasting + fleeting

    def _recognised(
        self, hypothesis: Hypothesis, seen: Array, variance: float, pushed: float
    ) -> FrameView:
        """View of a frame from the likeliest arc, by the frame and by what went before."""
        motion, tracking = hypothesis.motion, self._tracking
        expected, spread = motion.expected, motion.expected_variance + pushed
        arc, unsure = expected, spread
        for _ in range(tracking.iterations):
            view = self._view(seen, arc, variance, unsure, hypothesis.upside_down)
            if view.information == 0:
                break
            of_frame = variance / view.information
            unsure = spread * of_frame / (spread + of_frame)
            step = expected + spread / (spread + of_frame) * (view.arc - expected) - arc
            if abs(step) < tracking.close:
                break
            arc += min(max(step, -tracking.longest_step), tracking.longest_step)
        return view

    def _view(
        self, seen: Array, arc: float, variance: float, spread: float, upside_down: bool
    ) -> FrameView:
        """View from an arc that is unsure by a spread [rad^2], of rotors of a variance [rad^2]."""
        about = self.orbit.stretch(arc)
        before, beyond = self._backgrounds[self.orbit.leg(arc)]
        left = np.empty(len(before))
        frame_loops.compare(
            seen,
            self.offsets.corrections,
            upside_down,
            before,
            about.angles,
            beyond,
            about.first,
            left,
        )
        doubtful = NO_FLAGS
        if self._doubts:
            doubtful = self._far.doubtful
            left[self._far.stuck] = np.nan
        return self._likelihood.view(
            arc, about.first, about.tangent, left, variance, spread, doubtful
        )

    def _learn_offsets(self, seen: Array, view: FrameView) -> None:
        """Learn offsets from the block that this frame fills."""
        known = np.count_nonzero(self.offsets.corrections)
        turned = self._places.leader.upside_down
        self._far.learn(-1 if turned else 1, self._noise.variance)
        self._far.look_for_doubtful(seen, view.outlying)
        self._doubts = bool(self._far.doubtful.any())
        uneven = max(self.offsets.typical - self._settings.offsets.evenness, 0.0)
        self._disorder = self._shift * uneven
        if np.count_nonzero(self.offsets.corrections) != known:
            self._noise.forget_what_lasted()

    def _report(self, time: float, status: TrackingStatus) -> None:
        orbit = self.orbit
        leader = self._places.leader
        arc, rate, arc_variance, covariance, rate_variance = leader.motion.summary
        completed, within = divmod(arc, orbit.length)
        # The nearest point of the orbit is not to be told better than the frame is on it, nor
        # than the chain is that of the orbit: what rotors are off by, the arc is too.
        beside = self._tracking.beside_share**2 * self._noise.excess + self._disorder**2
        of_rate = beside * (rate / (self._tracking.way_beside * orbit.site_arc)) ** 2
        wall = self._places.wall(beside, of_rate)
        seen = self._seen_as if status is not TrackingStatus.COASTING else None
        self._estimate = OrbitEstimate(
            time=time,
            status=status,
            arc=arc,
            rate=rate,
            arc_deviation=math.sqrt(arc_variance + beside),
            rate_deviation=math.sqrt(rate_variance + of_rate),
            covariance=covariance,
            place=wall.place,
            place_rate=wall.place_rate,
            place_deviation=wall.place_deviation,
            place_rate_deviation=wall.place_rate_deviation,
            leg=orbit.leg(arc),
            leg_known=self._places.leg_is_known(),
            phase=2 * math.pi * within / orbit.length,
            completed_cycles=int(completed),
            noise=self._noise.deviation,
            misfit=math.sqrt(self._noise.scatter),
            frame_misfit=math.sqrt(seen.mean_square) if seen else math.nan,
            upside_down=leader.upside_down,
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
