# SPDX-License-Identifier: Apache-2.0
"""Recursive estimator of the arc length s of a chain along its orbit, and of the rate ds/dt.

The orbit Phi(s) gives the angles of all rotors at the arc length s. Let s_0 be the predicted arc
length, and t = dPhi/ds the tangent at s_0. Angles phi, whose noise has the standard deviation
sigma, give the measurement

    z = s_0 + t . (phi - Phi(s_0)) / t^2    with the variance sigma^2 / t^2.

Each measurement updates a `MultipleModelFilter`.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.dynamics.motor_controllers import feedback_torques
from soliton_linkage.dynamics.terms import of_chain, term_table, torques_of
from soliton_linkage.estimation.encoder_offsets import EDGE_ROTORS, EncoderOffsets
from soliton_linkage.estimation.estimates import OrbitEstimate, TrackingStatus, lost
from soliton_linkage.estimation.frames import FrameImpulse, check_noise, rotor_swing
from soliton_linkage.estimation.hypotheses import Hypotheses, Hypothesis
from soliton_linkage.estimation.measurement import (
    LEAST_INFORMATION,
    FrameLikelihood,
    InnovationGate,
    LinearisedMeasurement,
    ReadingScales,
)
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter, slope_variance
from soliton_linkage.estimation.noise import ResidualVariance, StampJitter
from soliton_linkage.estimation.orbit_model import ComplianceCorrection, OrbitMeasurementModel
from soliton_linkage.estimation.relocalisation import Candidate, Relocaliser, ScanBudget
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings
from soliton_linkage.linear.bands import gap, penetration_depth, speed_of_sound
from soliton_linkage.linkage.chain import Array, check_shape
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit

_LEAST_PROBABILITY = 0.9
"""A search finds candidates for the position of the chain on its orbit. The chain is acquired only
if the sum of the probabilities of all candidates is at least this [1]. The alternative is any
other position on the orbit."""


def largest_deformation(orbit: Orbit) -> float:
    """Return an upper bound of the deformation of a resting wall by external torques [rad].

    External torques are all torques except the spring torques, for example the torques of motor
    controllers. The bound is the largest torque on a rotor divided by the stiffness I w^2 of the
    slowest phonon, because this phonon is the softest deformation. I is the moment of inertia of a
    rotor, and w is the frequency of the phonon.
    """
    chain, angles = orbit.chain, orbit.configuration(orbit.arc_at(orbit.middle, 0))
    torques = feedback_torques(chain, angles, 0 * angles)
    torques_of(angles, 0 * angles, *term_table(of_chain(chain), len(angles)), torques)
    largest = float(np.abs(torques).max())
    return largest / (chain.moment_of_inertia * gap(chain) ** 2) if largest else 0.0


class OrbitFilter:
    """Recursive estimator of the arc length s of a chain along its orbit, and of the rate ds/dt.

    Frames with repeated or late stamps are ignored. The filter restarts after a reset of the
    clock. It also restarts if several successive frames do not match its estimate, and the last of
    them matches another position much better. A restart keeps the encoder offsets.
    """

    def __init__(
        self, orbit: Orbit, noise: float | None = None, settings: EstimationSettings = DEFAULTS
    ) -> None:
        """Start without a position; `noise` is the standard deviation of the angles [rad].

        If `noise` is None, the filter estimates it. Raises ValueError if `noise` is infinite or
        not above 0.
        """
        check_noise(noise)
        chain = orbit.chain
        self.orbit = orbit
        self.rejected = self.starts = 0
        """Number of rejected frames, and number of successful searches for the chain."""
        self.bandwidth = 0.0
        """Bandwidth of the estimator of `disturbance` [rad/s]."""
        self._given_noise = noise
        self._settings, self._tracking = settings, settings.tracking
        swing, rotors = rotor_swing(chain), chain.number_of_rotors
        self._relocaliser = Relocaliser(orbit, settings.likelihood)
        self._budget = ScanBudget(settings.tracking)
        self.compliance = ComplianceCorrection(orbit)
        self._forces = [
            term_table([each for each in of_chain(chain) if each.active is active], rotors)
            for active in (False, True)
        ]
        self._phonon_period = 2 * math.pi / gap(chain)
        self._sound = speed_of_sound(chain) / chain.spacing * orbit.site_arc
        self._edge = EDGE_ROTORS + penetration_depth(chain) / chain.spacing
        self._deviates = chain.deviations != NO_DEVIATIONS
        self._likelihood = FrameLikelihood(swing, settings.likelihood)
        self._scales = ReadingScales(noise)
        self.jitter = StampJitter(settings.noise)
        self._variance = ResidualVariance(swing, noise, settings)
        self._model = OrbitMeasurementModel(
            orbit, self._likelihood, self._variance.elastic, settings
        )
        self._gate = InnovationGate(rotors, self._likelihood, settings)
        self._lose(math.nan)

    @property
    def offsets(self) -> EncoderOffsets:
        """Estimator of the offsets of the encoders."""
        return self._model.offsets

    @property
    def disturbance(self) -> float:
        """Estimated unmodelled acceleration [rad/s^2]; 0 if disabled by settings, NaN if lost."""
        return self._hypotheses.leader.motion.disturbance if self._hypotheses.all else math.nan

    def update(
        self,
        time: float,
        angles: Array,
        deviations: Array | None = None,
        torques: Array | None = None,
    ) -> OrbitEstimate:
        """Update the estimate with the angles [rad], shape (N,), at a time [s].

        Unknown angles are NaN. `deviations` are the standard deviations of the angles [rad], and
        `torques` the mean motor torques since the last frame [N m], shape (N,) each. Raises
        ValueError for angles of another shape.
        """
        check_shape(angles, self.orbit.chain.number_of_rotors)
        elapsed = time - self.estimate.time
        if not math.isfinite(time) or -self._tracking.clock_limit <= elapsed <= 0:
            return self.estimate
        if elapsed < 0:
            self._lose(time)
            self._budget.restart()
        seen = np.ascontiguousarray(angles, dtype=np.float64)
        self._scales.set_deviations(deviations)
        if self._hypotheses.all:
            self._track(time, elapsed, seen, torques)
        elif not self._acquire(time, seen):
            self._lose(time)
        return self.estimate

    def apply_impulse(self, impulse: FrameImpulse) -> None:
        """Add the rate change by an impulse, and the variance of this change, to the estimate."""
        for each in self._hypotheses.all:
            rigid, rate = self._rate_change(impulse.impulses, each), each.motion.rate
            change = self.compliance.rate_after_impulse(rate, rigid) - rate
            each.motion.apply_impulse(change, (rigid - change) ** 2, (change * impulse.ago) ** 2)
        if self._hypotheses.all:
            self._report(self.estimate.time, self.estimate.status)

    def restart(self) -> None:
        """Discard all frames but keep the offsets of the encoders."""
        self._lose(math.nan)
        self._budget.restart()

    def _rate_change(self, impulses: Array, hypothesis: Hypothesis) -> float:
        """Return the rate change t . J / sum(I t^2) [rad/s] by impulses J [N m s].

        The springs are treated as rigid bars. t is the tangent, and I are the moments of inertia.
        If J are torques [N m], the result is an acceleration [rad/s^2].
        """
        about = self.orbit.segment(hypothesis.motion.arc)
        within = slice(about.first, about.first + len(about.tangent))
        inertia = self.orbit.chain.moments_of_inertia[within] @ about.tangent**2
        change = float(about.tangent @ impulses[within] / inertia)
        return -change if hypothesis.upside_down else change

    def _lose(self, time: float) -> None:
        self._hypotheses = Hypotheses(self.orbit, self._settings)
        self.view: LinearisedMeasurement | None = None
        """Measurement from the latest frame; None if the chain is lost or no angle is known."""
        self._unexplained, self._unexplained_since = 0, math.nan
        self._variance.restart()
        self.jitter.restart()
        self._gate.restart()
        self.estimate: OrbitEstimate = lost(time, self._given_noise or math.nan)

    def _acquire(self, time: float, seen: Array) -> bool:
        if not np.isfinite(seen).any() or not self._budget.spend(time):
            return False
        candidates = self._find(seen)
        if candidates:
            self._start_at(candidates, time, seen)
        return bool(candidates)

    def _find(self, seen: Array) -> list[Candidate]:
        angles = seen - self.offsets.corrections
        found = self._relocaliser.find(angles, self._given_noise or 0.0)
        if found.probability < _LEAST_PROBABILITY:
            return []
        best = found.candidates[0]
        explained = self._likelihood.explains(best.view, best.variance)
        site = self.orbit.site(best.view.arc)
        fits = self._likelihood.fits(best.view.residuals, 0, site, self._given_noise or 0.0)
        if not (explained and fits):
            return []
        least = best.evidence - self._settings.filter.decisive_odds
        return [each for each in found.candidates if each.evidence > least]

    def _start_at(self, candidates: list[Candidate], time: float, seen: Array) -> None:
        self.starts += 1
        self._unexplained, self._unexplained_since = 0, math.nan
        best = candidates[0]
        self._variance.restart()
        self._variance.noise.update(best.view)
        self.jitter.restart()
        self._model.far.restart()
        scale = 1 / self.orbit.chain.time_unit
        self._hypotheses = Hypotheses(self.orbit, self._settings)
        for each in candidates:
            motion = MultipleModelFilter(
                each.arc,
                self._variance.noise.variance / each.view.information,
                scale,
                self.orbit.site_arc,
                self._settings.filter,
            )
            evidence = each.evidence - best.evidence
            self._hypotheses.all.append(Hypothesis(motion, each.upside_down, each.view, evidence))
        self.view = best.view
        self._model.learn(seen, best.view, 0.0, self._variance.noise, best.upside_down)
        self._report(time, TrackingStatus.ACQUIRED)

    def _track(self, time: float, elapsed: float, seen: Array, torques: Array | None) -> None:
        self._variance.at_edge = self._at_edge()
        for each in self._hypotheses.all:
            acceleration = 0.0 if torques is None else self._rate_change(torques, each)
            self._predict(each.motion, elapsed, acceleration)
        best = self._hypotheses.leader.motion
        limit = (self.orbit.length / self._settings.noise.significance) ** 2
        if not best.expected_variance <= limit:
            self._lose(time)
            self._acquire(time, seen)
            return
        self._hypotheses.drop_unknown(limit)
        self._variance.way = abs(best.expected_rate) * elapsed / self.orbit.site_arc
        variance, noise = self._measure(seen, elapsed), self._variance.noise
        self._hypotheses.weigh([each.view.likelihood for each in self._hypotheses.all])
        view = self._hypotheses.leader.view
        if not view.known:
            self.view = None
            self._report(time, TrackingStatus.COASTING)
            return
        self.view = view
        largest = variance + self._variance.largest_field
        explained = self._gate.accepts(view, largest, self._model.far.doubtful)
        site = self.orbit.site(view.arc)
        fits = self._likelihood.fits(view.residuals, 0, site, noise.deviation)
        explained &= fits
        if explained:
            self._unexplained, self._unexplained_since = 0, math.nan
        elif self._relocated(time, seen, fits):
            return
        informative = view.information >= LEAST_INFORMATION
        if not (informative and fits and (explained or self._gate.is_informative(view))):
            self.rejected += not explained
            self._report(time, TrackingStatus.COASTING)
            return
        for each in self._hypotheses.all:
            self._update_hypothesis(each)
        leading = self._hypotheses.leader.motion
        if self._settings.noise.significance * leading.rate_deviation < abs(leading.rate):
            self.jitter.update(time, view.arc, self._variance.of_arc(view), leading.rate)
        self._variance.learn(view)
        self._variance.learn_outliers(view)
        turned = self._hypotheses.leader.upside_down
        self._model.learn(seen, view, elapsed, noise, turned)
        self._hypotheses.add_toggled()
        self._report(time, TrackingStatus.TRACKING if explained else TrackingStatus.COASTING)

    def _measure(self, seen: Array, elapsed: float) -> float:
        variance = self._linearise(seen, 0.0)
        if not self._gate.is_strained(self._hypotheses.leader.view):
            return variance
        views, frames = [each.view for each in self._hypotheses.all], self._variance.frames
        self._variance.frames = 0
        widened = self._linearise(seen, (elapsed / self.orbit.chain.time_unit) ** 2)
        if self._gate.is_informative(self._hypotheses.leader.view):
            return widened
        self._variance.frames = frames
        for each, view in zip(self._hypotheses.all, views, strict=True):
            each.view = view
        return variance

    def _linearise(self, seen: Array, impulse_variance: float) -> float:
        variance, noise = self._variance.of_rotor(), self._variance.noise.variance
        self._likelihood.scales = self._scales.of_frame(noise, variance)
        self._model.noise = noise
        for each in self._hypotheses.all:
            each.view = self._model.measure(
                each.motion, seen, variance, impulse_variance, each.upside_down
            )
        return variance

    def _relocated(self, time: float, seen: Array, fits: bool) -> bool:
        """Count a mismatched frame; return whether the filter restarts or its status gets LOST."""
        tracking, view = self._tracking, self._hypotheses.leader.view
        decisive = self._settings.filter.decisive_odds
        if self._unexplained == 0:
            self._unexplained_since = time
        self._unexplained += 1
        if self._unexplained >= tracking.confirming_frames and self._budget.spend(time):
            candidates = self._find(seen)
            if candidates and self._log_odds(candidates[0], view, seen) > decisive:
                self._start_at([self._on_this_cycle(each) for each in candidates], time, seen)
                return True
        late = time - self._unexplained_since > tracking.loss_time
        enough = self._unexplained > tracking.confirming_frames
        if late and enough and not (fits and self._gate.is_informative(view)):
            self._lose(time)
            return True
        return False

    def _log_odds(self, candidate: Candidate, view: LinearisedMeasurement, seen: Array) -> float:
        leader = self._hypotheses.leader
        expected = max(
            self._model.linearise(
                seen, arc, candidate.variance, 0.0, leader.upside_down
            ).likelihood
            for arc in (leader.motion.expected, view.arc)
        )
        return candidate.view.likelihood - expected

    def _predict(self, motion: MultipleModelFilter, elapsed: float, acceleration: float) -> None:
        arc, rate, of_arc, _, of_rate = motion.summary
        ahead = arc + rate * elapsed
        ratio = self.compliance.rate_ratio(ahead, rate, arc)
        if self._deviates:
            ratio *= self.orbit.free_rate(ahead) / self.orbit.free_rate(arc)
        acceleration += self._acceleration(arc + rate * elapsed / 2, rate, elapsed)
        # If a line is fitted over the time T, the standard deviation of its slope is sqrt(3) / T
        # times the standard deviation of its end.
        duration = math.sqrt(3 * of_arc / of_rate)
        ripple = self.compliance.ripple_bias(rate, duration) * self.orbit.site_arc**2
        exchange = self.compliance.edge_exchange(rate) if self._variance.at_edge else 0.0
        motion.predict(elapsed, exchange, ratio, acceleration, self.bandwidth, ripple)

    def _acceleration(self, arc: float, rate: float, elapsed: float) -> float:
        """Return the acceleration sum(tau t) / (c sum(I t^2)) along the orbit [rad/s^2].

        tau are all torques except the spring torques, t is the tangent, and I are the moments of
        inertia. gamma and c are the two results of `ComplianceCorrection.contraction`. The motion
        contracts a wall by the factor gamma. Its rotors turn faster by this factor, so that the
        rates in friction torques are multiplied by gamma. The coordinates of adjacent rotors
        differ more by the same factor. Therefore, the torques are computed with these rates and
        differences. Their power is the speed of the wall, multiplied by the integral of tau over
        the rotor angle. The contraction does not change the limits of this integral. Therefore, t
        is the tangent of the wall at rest. A torque that depends only on the angle of the rotor
        itself, such as the torque of a potential, does not change.
        """
        chain, (passive, active) = self.orbit.chain, self._forces
        if not (len(passive.kinds) or len(active.kinds) or chain.feedback.acts):
            return 0.0
        gamma, inertia = self.compliance.contraction(rate)
        tangent, angles = self.orbit.tangent(arc), self.orbit.configuration(arc)
        torques, rates = np.zeros(len(tangent)), gamma * rate * tangent
        # Active terms are proportional to differences of coordinates.
        torques_of(angles, rates, *active, torques)
        torques *= gamma
        torques_of(angles, rates, *passive, torques)
        if chain.feedback.acts:
            measured = arc - (chain.feedback.delay + 0.5) * rate * elapsed
            earlier = self.orbit.configuration(measured)
            torques += feedback_torques(chain, earlier, rates, gamma)
        return float(tangent @ torques / (chain.moments_of_inertia @ tangent**2)) / inertia

    def _at_edge(self) -> bool:
        last = self.orbit.chain.number_of_rotors - 1
        return min(self.estimate.site, last - self.estimate.site) < self._edge

    def _on_this_cycle(self, candidate: Candidate) -> Candidate:
        length = self.orbit.length
        turns = round((self.estimate.arc - candidate.arc) / length)
        return candidate._replace(arc=candidate.arc + turns * length)

    def _update_hypothesis(self, hypothesis: Hypothesis) -> None:
        view, motion, noise = hypothesis.view, hypothesis.motion, self._variance.noise
        if view.information > LEAST_INFORMATION:
            late = motion.expected_rate**2 * self.jitter.variance
            variance = self._variance.of_arc(view) + late
            scale = 1 / self.orbit.chain.time_unit
            calm = self._variance.allow_waves(motion, scale, self._phonon_period)
            motion.update(view.arc, variance, noise.degrees_of_freedom, calm)
            hypothesis.update_rate_shift(self._variance.way, variance)

    def _report(self, time: float, status: TrackingStatus) -> None:
        orbit, noise = self.orbit, self._variance.noise
        leader = self._hypotheses.leader
        arc, rate, arc_variance, covariance, rate_variance = leader.motion.summary
        # Add the variances of errors that unknown disorder, waves and wrong stamps cause.
        by_disorder, rate_disorder = self._model.disorder_deviations(arc)
        # Waves of the rms amplitude x exert oscillating forces on a wall of the speed v. The
        # arc length of a slow wall oscillates with the amplitude x v / c. Fast walls have a larger
        # inertia. Large variances already contain this oscillation.
        square = min((rate / self._sound) ** 2, 1.0)
        field = square * (1 - square) ** 3 * noise.waves
        field += max(self._variance.excluded, 0.0)
        by_springs = self.compliance.unpredicted_change(rate, arc)
        added = field**2 / (field + arc_variance) + by_disorder**2 + rate**2 * self.jitter.variance
        added += leader.rate_shift**2 * rate_variance * (4 * rate**2 + 2 * rate_variance)
        correlation = self._settings.filter.bias_way * orbit.site_arc
        frequency = math.hypot(2 * math.pi / self._phonon_period, rate / correlation)
        rate_added = (rate_disorder**2 + by_springs**2) * rate**2
        rate_added += field * slope_variance(rate_variance / arc_variance, frequency)
        wall = self._hypotheses.mixture(added, rate_added)
        seen = self.view if status is not TrackingStatus.COASTING else None
        self.estimate = OrbitEstimate(
            time=time,
            status=status,
            arc=arc,
            rate=rate,
            arc_deviation=math.sqrt(arc_variance + added),
            rate_deviation=math.sqrt(rate_variance + rate_added),
            covariance=covariance,
            site=wall.site,
            site_rate=wall.site_rate,
            site_deviation=wall.site_deviation,
            site_rate_deviation=wall.site_rate_deviation,
            leg=orbit.leg(arc),
            leg_known=self._hypotheses.leg_is_known(),
            noise=noise.deviation,
            misfit=math.sqrt(noise.scatter),
            frame_misfit=math.sqrt(seen.mean_square) if seen else math.nan,
            upside_down=leader.upside_down,
        )
