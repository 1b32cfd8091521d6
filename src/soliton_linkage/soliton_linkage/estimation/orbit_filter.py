# SPDX-License-Identifier: Apache-2.0
"""Where on its orbit a chain is and how fast it goes round, from all frames so far.

A frame measures the arc s at the predicted point of the orbit, phi = Phi(s) + noise, so that with
t = dPhi/ds the measurement is z = s + t . (phi - Phi(s)) / t^2, with variance sigma^2 / t^2: near
the truth it is linear in the noise. It updates a `MultipleModelFilter`; `FrameNoise` tells sigma
and what else there is beside the orbit, and `EncoderOffsets` what encoders add to their angles.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets
from soliton_linkage.estimation.estimates import OrbitEstimate, TrackingStatus, lost
from soliton_linkage.estimation.frames import FrameImpulse, rotor_swing
from soliton_linkage.estimation.hypotheses import Hypotheses, Hypothesis
from soliton_linkage.estimation.measurement import (
    LEAST_INFORMATION,
    FrameLikelihood,
    InnovationGate,
    LinearisedMeasurement,
    ReadingScales,
)
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.noise import ResidualVariance
from soliton_linkage.estimation.orbit_model import ComplianceCorrection, OrbitMeasurementModel
from soliton_linkage.estimation.relocalisation import Candidate, Relocaliser, ScanBudget
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, check_shape
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit


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
        self.ignored = 0
        self.rejected = 0
        self.starts = 0
        self._given_noise = noise
        self._settings = settings
        self._tracking = settings.tracking
        self._search = Relocaliser(orbit, settings.likelihood, settings.scan)
        self._budget = ScanBudget(settings.scan)
        self._yielding = ComplianceCorrection(orbit)
        self._depth = penetration_depth(chain) / chain.spacing
        self._deviates = chain.deviations != NO_DEVIATIONS
        swing = rotor_swing(chain)
        self._likelihood = FrameLikelihood(swing, settings.likelihood)
        self._scales = ReadingScales(noise)
        self._variance = ResidualVariance(swing, noise, settings)
        self._beside = OrbitMeasurementModel(
            orbit, self._likelihood, self._variance.elastic, settings
        )
        self._trust = InnovationGate(chain.number_of_rotors, self._likelihood, settings)
        self.bandwidth = 0.0
        """With which the disturbance is followed [rad/s]."""
        self._forget(math.nan)

    @property
    def offsets(self) -> EncoderOffsets:
        """Offsets of the encoders as far as they are known."""
        return self._beside.offsets

    @property
    def estimate(self) -> OrbitEstimate:
        """The latest estimate."""
        return self._estimate

    @property
    def disturbance(self) -> float:
        """Acceleration of the arc that no torque explains [rad/s^2].

        It is 0 where the settings look for none, NaN while the chain is lost.
        """
        return self._hypotheses.leader.motion.disturbance if self._hypotheses.all else math.nan

    @property
    def view(self) -> LinearisedMeasurement | None:
        """The latest frame beside the orbit; None while lost, and for an empty frame."""
        return self._seen_as

    def update(
        self,
        time: float,
        angles: Array,
        deviations: Array | None = None,
        torques: Array | None = None,
    ) -> OrbitEstimate:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        Readings count by their standard deviations [rad], shape (N,), above 0, where these are
        told and not NaN. Torques [N m], shape (N,), are those that acted since the last frame.
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
        self._scales.take(deviations)
        if self._hypotheses.all:
            self._follow(time, elapsed, seen, torques)
        elif not self._acquire(time, seen):
            self._forget(time)
        return self._estimate

    def apply_impulse(self, impulse: FrameImpulse) -> None:
        """Take in a push that acts from the latest frame on.

        How far a wall went on since the push is left to that frame to tell, and unsure by it.
        """
        for each in self._hypotheses.all:
            rigid, rate = self._pushed_by(impulse.impulses, each), each.motion.rate
            change = self._yielding.pushed_rate(rate, rigid) - rate
            doubt = rigid - change
            each.motion.apply_impulse(change, doubt**2, (change * impulse.ago) ** 2)
        if self._hypotheses.all:
            self._report(self._estimate.time, self._estimate.status)

    def forget(self) -> None:
        """Know of no frame, as at first, but for the offsets of encoders."""
        self._forget(math.nan)
        self._budget.restart()

    def _pushed_by(self, impulses: Array, hypothesis: Hypothesis) -> float:
        """Change of the rate by impulses, were bars rigid, t . J / sum(I t^2) [rad/s]."""
        about = self.orbit.segment(hypothesis.motion.arc)
        within = slice(about.first, about.first + len(about.tangent))
        inertia = self.orbit.chain.moments_of_inertia[within] @ about.tangent**2
        change = float(about.tangent @ impulses[within] / inertia)
        return -change if hypothesis.upside_down else change

    def _forget(self, time: float) -> None:
        self._hypotheses = Hypotheses(self.orbit, self._settings)
        self._seen_as: LinearisedMeasurement | None = None
        self._unexplained_since = math.nan
        self._unexplained = 0
        self._variance.forget()
        self._trust.forget()
        self._estimate = lost(time, self._given_noise or math.nan)

    def _acquire(self, time: float, seen: Array) -> bool:
        """Search a frame for the chain; say whether it is there."""
        if not np.isfinite(seen).any() or not self._budget.spend(time):
            return False
        candidates = self._found(seen)
        if not candidates:
            return False
        self._start_at(candidates, time, seen)
        return True

    def _found(self, seen: Array) -> list[Candidate]:
        """Places of a frame that compete, none where it does not tell any."""
        angles = seen - self.offsets.corrections
        found = self._search.find(angles, self._given_noise or 0.0)
        if found.probability < self._settings.scan.told:
            return []
        best = found.candidates[0]
        if not self._likelihood.explains(best.view, best.variance):
            return []
        least = best.evidence - self._tracking.decisive_odds
        return [each for each in found.candidates if each.evidence > least]

    def _start_at(self, candidates: list[Candidate], time: float, seen: Array) -> None:
        self.starts += 1
        self._unexplained, self._unexplained_since = 0, math.nan
        best = candidates[0]
        self._variance.begin(best.view)
        self._beside.far.forget()
        scale = 1 / self.orbit.chain.time_unit
        self._hypotheses = Hypotheses(self.orbit, self._settings)
        for candidate in candidates:
            motion = MultipleModelFilter(
                candidate.arc,
                self._variance.noise.variance / candidate.view.information,
                scale,
                self.orbit.site_arc,
                self._settings.filter,
            )
            evidence = candidate.evidence - best.evidence
            self._hypotheses.all.append(
                Hypothesis(motion, candidate.upside_down, candidate.view, evidence)
            )
        self._seen_as = best.view
        self._beside.learn(seen, best.view, 0.0, self._variance.noise, best.upside_down)
        self._beside.look_for_deformation(best.view, best.view)
        self._report(time, TrackingStatus.ACQUIRED)

    def _follow(self, time: float, elapsed: float, seen: Array, torques: Array | None) -> None:
        self._variance.at_edge = self._at_edge()
        for each in self._hypotheses.all:
            acceleration = 0.0 if torques is None else self._pushed_by(torques, each)
            self._predict(each.motion, elapsed, acceleration)
        best = self._hypotheses.leader.motion
        if self._tracking.gate * math.sqrt(best.expected_variance) > self.orbit.length:
            self._forget(time)
            self._acquire(time, seen)
            return
        self._variance.way = abs(best.expected_rate) * elapsed / self.orbit.site_arc
        variance = self._looked_at(seen, elapsed)
        self._hypotheses.weigh([each.view.likelihood for each in self._hypotheses.all])
        view = self._hypotheses.leader.view
        if not view.known:
            self._seen_as = None
            self._report(time, TrackingStatus.COASTING)
            return
        self._beside.look_for_deformation(view, self._seen_as or view)
        self._seen_as = view
        largest = variance + self._variance.largest_field
        explained = self._trust.is_explained(view, largest, self._beside.far.doubtful)
        if not explained and self._doubted(time, seen):
            return
        self._unexplained_since = math.nan if explained else self._unexplained_since
        if explained:
            self._unexplained = 0
        untold = view.information < LEAST_INFORMATION
        if untold or not (explained or self._trust.is_believed(view)):
            self.rejected += not explained
            self._report(time, TrackingStatus.COASTING)
            return
        for each in self._hypotheses.all:
            self._update_by(each, elapsed)
        self._learn(seen, view, elapsed)
        self._hypotheses.suppose_toggled()
        self._report(time, TrackingStatus.TRACKING if explained else TrackingStatus.COASTING)

    def _looked_at(self, seen: Array, elapsed: float) -> float:
        """See a frame from each place; return the variance of a rotor that it was seen with.

        A wall that was pushed is on before where it is expected, and what springs do to it is not
        that of before: it is looked for as one that was found now.
        """
        variance = self._see(seen, 0.0)
        if not self._trust.is_strained(self._hypotheses.leader.view):
            return variance
        views, frames = [each.view for each in self._hypotheses.all], self._variance.frames
        self._variance.frames = 0
        widened = self._see(seen, (elapsed / self.orbit.chain.time_unit) ** 2)
        if self._trust.is_believed(self._hypotheses.leader.view):
            return widened
        self._variance.frames = frames
        for each, view in zip(self._hypotheses.all, views, strict=True):
            each.view = view
        return variance

    def _see(self, seen: Array, pushed: float) -> float:
        """See a frame from places that pushes may have moved by a variance [rad^2]."""
        variance = self._variance.of_rotor()
        noise = self._variance.noise.variance
        self._likelihood.scales = self._scales.of_frame(noise, variance)
        self._beside.noise = noise
        for each in self._hypotheses.all:
            each.view = self._beside.recognised(
                each.motion, seen, variance, pushed, each.upside_down
            )
        return variance

    def _doubted(self, time: float, seen: Array) -> bool:
        """Start anew where a frame that is not explained is by another place; say whether.

        Where it is by none for long, the chain is lost.
        """
        if self._unexplained == 0:
            self._unexplained_since = time
        self._unexplained += 1
        if self._unexplained >= self._tracking.confirming_frames and self._budget.spend(time):
            candidates = self._found(seen)
            view = self._hypotheses.leader.view
            if candidates and self._gain(candidates[0], view, seen) > self._tracking.decisive_odds:
                self._start_at([self._on_this_turn(each) for each in candidates], time, seen)
                return True
        tracking = self._tracking
        long = time - self._unexplained_since > tracking.doubted_time
        view = self._hypotheses.leader.view
        hopeless = not self._trust.is_believed(view)
        if long and self._unexplained > tracking.confirming_frames and hopeless:
            self._forget(time)
            return True
        return False

    def _gain(self, candidate: Candidate, view: LinearisedMeasurement, seen: Array) -> float:
        """How much likelier a frame is at another place than where it was expected [log]."""
        leader = self._hypotheses.leader
        expected = max(
            self._beside.view(seen, arc, candidate.variance, 0.0, leader.upside_down).likelihood
            for arc in (leader.motion.expected, view.arc)
        )
        return candidate.view.likelihood - expected

    def _predict(self, motion: MultipleModelFilter, elapsed: float, acceleration: float) -> None:
        """Go on by a time [s] under torques [rad/s^2], as springs yield and rotors deviate."""
        arc, rate, *_ = motion.summary
        ahead = arc + rate * elapsed
        ratio = self._yielding.change(ahead, rate, arc)
        if self._deviates:
            ratio *= self.orbit.free_rate(ahead) / self.orbit.free_rate(arc)
        motion.predict(elapsed, self._variance.at_edge, ratio, acceleration, self.bandwidth)

    def _at_edge(self) -> bool:
        """Whether the wall was so near to an edge that springs take up or give back energy."""
        last = self.orbit.chain.number_of_rotors - 1
        to_edge = min(self._estimate.site, last - self._estimate.site)
        return bool(to_edge < self._tracking.edge_rotors + self._depth)

    def _on_this_turn(self, candidate: Candidate) -> Candidate:
        """The same point of the orbit, with as many cycles gone round as the wall has."""
        length = self.orbit.length
        turns = round((self._estimate.arc - candidate.arc) / length)
        return candidate._replace(arc=candidate.arc + turns * length)

    def _update_by(self, hypothesis: Hypothesis, elapsed: float) -> None:
        """Update a filter by its view of a frame, a time [s] after the last."""
        view, motion = hypothesis.view, hypothesis.motion
        if view.information > LEAST_INFORMATION:
            variance = self._variance.of_arc(motion, view, elapsed)
            calm = self._variance.calm(motion.expected_rate * self.orbit.chain.time_unit)
            motion.update(view.arc, variance, self._variance.noise.degrees_of_freedom, calm)

    def _learn(self, seen: Array, view: LinearisedMeasurement, elapsed: float) -> None:
        """Learn noise, field and offsets from what the likeliest place leaves of a frame."""
        self._variance.learn(view, elapsed)
        noise, turned = self._variance.noise, self._hypotheses.leader.upside_down
        if self._beside.learn(seen, view, elapsed, noise, turned):
            noise.forget_what_lasted()

    def _report(self, time: float, status: TrackingStatus) -> None:
        orbit, noise = self.orbit, self._variance.noise
        leader = self._hypotheses.leader
        arc, rate, arc_variance, covariance, rate_variance = leader.motion.summary
        completed, within = divmod(arc, orbit.length)
        # The nearest point of the orbit is not to be told better than the frame is on it, nor
        # than the chain is that of the orbit: what rotors are off by, the arc is too.
        leg = orbit.leg(arc)
        of_arc, of_rates = self._beside.shifts(arc)
        off = self._tracking.beside_share**2 * noise.excess + self._beside.deformation
        beside = off + of_arc**2
        changed = of_rates**2 + off / (self._settings.filter.bias_way * orbit.site_arc) ** 2
        of_rate = changed * rate**2
        wall = self._hypotheses.wall(beside, of_rate)
        seen = self._seen_as if status is not TrackingStatus.COASTING else None
        self._estimate = OrbitEstimate(
            time=time,
            status=status,
            arc=arc,
            rate=rate,
            arc_deviation=math.sqrt(arc_variance + beside),
            rate_deviation=math.sqrt(rate_variance + of_rate),
            covariance=covariance,
            site=wall.site,
            site_rate=wall.site_rate,
            site_deviation=wall.site_deviation,
            site_rate_deviation=wall.site_rate_deviation,
            leg=leg,
            leg_known=self._hypotheses.leg_is_known(),
            phase=2 * math.pi * within / orbit.length,
            completed_cycles=int(completed),
            noise=noise.deviation,
            misfit=math.sqrt(noise.scatter),
            frame_misfit=math.sqrt(seen.mean_square) if seen else math.nan,
            upside_down=leader.upside_down,
        )
