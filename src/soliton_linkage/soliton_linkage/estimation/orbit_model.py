# SPDX-License-Identifier: Apache-2.0
"""Measurement model of a wall on the orbit.

The model includes corrections for encoder offsets, for unseen rotors, and for the compliance of
the springs.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets, FarFieldResiduals
from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.likelihood import compare
from soliton_linkage.estimation.measurement import (
    NO_FLAGS,
    FrameLikelihood,
    LinearisedMeasurement,
    search_arc,
)
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.noise import FrameNoise
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.linear.bands import band_edges, gap
from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linear.statics import gram_matrix_bands
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.orbit.wall_shifts import WallShifts

_CLOSE = 0.01
"""Threshold of a step along the orbit [rad]: after a shorter step the linearisation is not
repeated."""
_LARGE_SCALE = 1.5
"""Threshold of the scale of a reading [1]: a reading with a larger scale is not used to estimate
encoder offsets."""


class OrbitMeasurementModel:
    """Model that measures the arc length along the orbit, corrected for encoder offsets."""

    def __init__(
        self,
        orbit: Orbit,
        likelihood: FrameLikelihood,
        elastic: float,
        settings: EstimationSettings,
    ) -> None:
        """Start with zero offsets.

        A mean square residual above `elastic` [rad^2] counts as a wave.
        """
        chain = orbit.chain
        self._orbit, self._likelihood = orbit, likelihood
        self._backgrounds = [
            orbit.background(orbit.arc_at(orbit.middle, leg))
            for leg in range(orbit.number_of_legs)
        ]
        self.offsets = EncoderOffsets(chain.number_of_rotors, settings.offsets)
        self.far = FarFieldResiduals(self.offsets, chain, elastic)
        self._shifts = WallShifts(orbit)
        self._unseen = UnseenRotorCorrection(orbit)
        self.noise = 0.0
        """Variance of the noise of an angle [rad^2]."""
        self._any_doubtful = False

    def linearise(
        self,
        seen: Array,
        arc: float,
        variance: float,
        spread: float,
        upside_down: bool,
        rate: float = 0.0,
    ) -> LinearisedMeasurement:
        """Return the measurement of a frame, linearised at an arc length along the orbit [rad].

        `seen` are the measured angles [rad], shape (N,), NaN if unknown. `variance` is the
        variance of a rotor [rad^2], and `spread` the variance of the arc length [rad^2]. The rate
        of the arc length [rad/s] determines the inertial forces on unseen rotors.
        """
        about = self._orbit.segment(arc)
        before, beyond = self._backgrounds[self._orbit.leg(arc)]
        residuals = np.empty(len(before))
        compare(
            seen,
            self.offsets.corrections,
            upside_down,
            before,
            about.angles,
            beyond,
            about.first,
            residuals,
        )
        doubtful = NO_FLAGS
        if self._any_doubtful:
            doubtful = self.far.doubtful
            residuals[self.far.stuck] = np.nan
        view = self._likelihood.linearise(
            arc, about.first, about.tangent, residuals, variance, spread, doubtful
        )
        if math.isfinite(view.largest) or not view.known:
            return view
        field = variance - self.noise
        shift = self._unseen.shift(arc, rate, view.residuals, field, self.noise)
        if not shift:
            return view
        return view._replace(arc=view.arc + shift, unseen_share=self._unseen.remaining)

    def measure(
        self,
        motion: MultipleModelFilter,
        seen: Array,
        variance: float,
        impulse_variance: float,
        upside_down: bool,
    ) -> LinearisedMeasurement:
        """Return the measurement of a frame, linearised at the likeliest arc length.

        This arc length along the orbit combines the frame with the prediction of the filters.
        `variance` is the variance of a rotor [rad^2]. `impulse_variance` is an additional variance
        of the predicted arc length [rad^2], due to a possible unmodelled impulse.
        """
        expected, spread = motion.expected, motion.expected_variance + impulse_variance
        views: list[LinearisedMeasurement] = []

        def likeliest(arc: float) -> float:
            uncertain = spread
            if views:
                of_frame = variance / views[-1].information
                uncertain *= of_frame / (spread + of_frame)
            view = self.linearise(
                seen, arc, variance, uncertain, upside_down, motion.expected_rate
            )
            views.append(view)
            if view.information == 0:
                return arc
            gain = spread / (spread + variance / view.information)
            return expected + gain * (view.arc - expected)

        search_arc(expected, likeliest, _CLOSE)
        return views[-1]

    def disorder_deviations(self, arc: float) -> tuple[float, float]:
        """Return the standard deviations of arc length and rate that disorder causes.

        The standard deviation of the arc length along the orbit is in rad. That of the rate is
        relative to the rate [1].
        """
        disorder = self.far.disorder
        if not disorder:
            return 0.0, 0.0
        shifts = self._shifts.at(self._orbit.site(arc), self._orbit.leg(arc))
        return disorder * shifts.arc, disorder * shifts.rate

    def learn(
        self,
        seen: Array,
        view: LinearisedMeasurement,
        elapsed: float,
        noise: FrameNoise,
        upside_down: bool,
    ) -> bool:
        """Update the encoder offsets with a frame.

        `elapsed` is the time since the last frame [s]. Returns whether the number of corrected
        offsets has changed.
        """
        outlying = view.outlying if view.outliers else None
        residuals = view.residuals
        if self._likelihood.scales is not None:
            residuals = np.where(self._likelihood.scales > _LARGE_SCALE, np.nan, residuals)
        site = self._orbit.site(view.arc)
        if not self.far.add(residuals, outlying, site, elapsed, noise.least):
            return False
        known = np.count_nonzero(self.offsets.corrections)
        self.far.learn(-1 if upside_down else 1, noise.variance)
        self.far.find_doubtful(seen, view.outlying)
        self._any_doubtful = bool(self.far.doubtful.any())
        return bool(np.count_nonzero(self.offsets.corrections) != known)


_NEGLIGIBLE = 0.01
"""Threshold of the variance that unseen rotors cause, relative to the noise variance [1]: a
smaller variance is neglected."""
_LEAST_SEEN = 1e-6
"""Threshold of the sum of t^2 over the seen rotors [1]: with a smaller sum, the seen rotors do not
determine the arc length along the orbit."""


class UnseenRotorCorrection:
    """Correction of the measured arc length along the orbit for unseen rotors.

    The springs between seen and unseen rotors determine the positions of the unseen rotors.
    """

    def __init__(self, orbit: Orbit) -> None:
        self._orbit = orbit
        lower, upper = (edge**2 for edge in band_edges(orbit.chain))
        self.remaining = (2 * lower / (lower + upper)) ** 2
        """Share of the variance due to unseen rotors that remains after the correction [1]."""

    def shift(
        self, arc: float, rate: float, residuals: Array, field: float, noise: float
    ) -> float:
        """Return the correction of the arc length along the orbit [rad].

        `rate` is the rate of the arc length [rad/s]. Residuals [rad] have shape (N,), NaN for
        unseen rotors. The variance of a rotor has two parts [rad^2]: `field` due to waves and
        springs, and `noise`. The correction is 0 if it would add more noise than it removes.
        """
        unseen = np.isnan(residuals)
        tangent = self._orbit.tangent(arc)
        hidden = float(tangent[unseen] @ tangent[unseen])
        shown = 1 - hidden
        if hidden * field <= _NEGLIGIBLE * noise or shown <= _LEAST_SEEN:
            return 0.0
        held, pull = self._balanced(arc, unseen, tangent)
        amplified = shown * pull[~unseen] + hidden * tangent[~unseen]
        if hidden * field * shown**2 < float(amplified @ amplified) * noise:
            return 0.0
        turning = self._orbit.chain.moments_of_inertia * self._orbit.curvature(arc) * rate**2
        return -float(held @ turning + pull[~unseen] @ residuals[~unseen])

    def _balanced(self, arc: float, unseen: Flags, tangent: Array) -> tuple[Array, Array]:
        """Return a displacement V of the rotors and the torques K V, shape (N,) each.

        K is the stiffness matrix, and t the tangent of the orbit. V is 0 for seen rotors, and K V
        is t for unseen rotors.
        """
        chain = self._orbit.chain
        first, second = rigidity_bands(chain, self._orbit.configuration(arc))
        rotors = np.flatnonzero(unseen)
        pulled = np.zeros((len(rotors), len(unseen)))
        pulled[np.arange(len(rotors)), rotors] = 1.0
        tensions = chain.stiffnesses * (first * pulled[:, :-1] + second * pulled[:, 1:])
        stiffness = chain.gathered(first * tensions, second * tensions)
        held = np.zeros_like(tangent)
        held[rotors] = np.linalg.solve(stiffness[:, rotors], tangent[rotors])
        return held, held[rotors] @ stiffness


_SAMPLES = 32
"""Number of samples of the compliance per rotor spacing [1]. In wobbling flippers, linear
interpolation between these samples has an error of 2 %."""
_LOWEST_ORDER = 0.2
"""Threshold of 3 mu w^2, the share of the energy that is due to the springs [1]: the lowest order
in w^2 is accurate enough up to this threshold."""
_PERIOD = 2
"""Period of the shape of a wall [rotor spacings]; even and odd rotors have different shapes."""
_SLOW = 0.25
"""Threshold of the number of rotors that a wall passes per period of the slowest phonon [1]: a
wall is slow up to this threshold. The third harmonic of this motion is below the phonon band."""
_SECOND_ORDER = 0.5
"""Square root of the relative error of the predicted change of the rate, for the fastest slow wall
[1]. The error was measured with d = 0.7 d_c, at the speed of this wall and at half of this speed.
"""
_LONGEST_RESOLVED = 4 / 3
"""Threshold of the speed of a wall, relative to the fastest slow wall [1]: a faster wall
passes at least one rotor in three phonon periods. Then the forces of the springs average out."""


class ComplianceCorrection:
    """Correction of the rate of a wall for the compliance of the springs.

    The compliance depends on the site of the wall between two rotors.
    """

    def __init__(self, orbit: Orbit) -> None:
        """Sample the compliance for walls in the middle of a uniform chain.

        The uniform chain has the same parameters as the chain of the orbit, but no deviations.
        """
        self._orbit = even = orbit
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        if orbit.chain != chain:
            even = UniformOrbit(chain)
        begin = _PERIOD * math.floor(even.middle / _PERIOD)
        sites = begin + np.arange(_PERIOD * _SAMPLES) / _SAMPLES
        sites = np.minimum(sites, chain.number_of_rotors - 1.0)
        self._mu = [[_mu(even, even.arc_at(site, leg)) for site in sites] for leg in (0, 1)]
        self._mean = float(np.mean(self._mu))
        self._spread = float(np.std(self._mu))
        self._adiabatic = _SLOW * gap(chain) * orbit.site_arc / (2 * math.pi)
        lowest_order = math.sqrt(_LOWEST_ORDER / (3 * np.max(self._mu)))
        self._fastest = min(self._adiabatic, lowest_order)

    def mu(self, arc: float) -> float:
        """Return the compliance mu [s^2] at an arc length along the orbit [rad]."""
        samples = self._mu[self._orbit.leg(arc) % 2]
        whole, beyond = divmod(self._orbit.site(arc) * _SAMPLES, 1.0)
        number, count = int(whole), len(samples)
        here = samples[number % count]
        return here + beyond * (samples[(number + 1) % count] - here)

    def rate_after_impulse(self, rate: float, momentum: float) -> float:
        """Return the rate [rad/s] after a change of the momentum, for the mean compliance.

        `momentum` is the change of the momentum divided by the moment of inertia [rad/s].
        """
        return rate_after_impulse(rate, momentum, self._mean)

    def damped(self, rate: float) -> float:
        """Return the deceleration due to damping, divided by the decay rate of the momentum.

        The result is in rad/s. The momentum is p / I = w + 2 mu w^3 for the rate w [rad/s].
        """
        square = 2 * self._mean * rate * rate
        return rate * (1 + square) / (1 + 3 * square)

    def rate_ratio(self, arc: float, rate: float, before: float) -> float:
        """Return the factor by which springs change the rate of a slow wall [1].

        The wall moves from the arc length `before` to the arc length `arc` along the orbit [rad].
        The factor is 1 for fast walls.
        """
        if abs(rate) > self._fastest:
            return 1.0
        square = 3 * rate * rate
        return math.sqrt((1 + square * self.mu(before)) / (1 + square * self.mu(arc)))

    def unpredicted_change(self, rate: float) -> float:
        """Return the relative standard deviation of the unpredicted change of a rate [1].

        `rate_ratio` does not predict this change while a wall moves by one site. The change
        depends on the ratio of two frequencies: the rate at which the wall passes sites, and the
        frequency of the slowest phonon. For slow walls the change is of second order in this
        ratio. For fast walls the change decreases with the fourth power of this ratio, because of
        the average over three phonon periods and of the inertia of the rotors.
        """
        square = 3 * rate * rate
        change = 0.5 * square * self._spread / (1 + square * self._mean)
        relative = abs(rate) / self._adiabatic
        if abs(rate) <= self._fastest:
            return change * (_SECOND_ORDER * relative) ** 2
        return change * min(_LONGEST_RESOLVED / relative, 1.0) ** 4


def _mu(orbit: Orbit, arc: float) -> float:
    chain = orbit.chain
    bend = orbit.curvature(arc)
    first, second = rigidity_bands(chain, orbit.configuration(arc))
    pulled = first * bend[:-1] + second * bend[1:]
    tensions: Array = solveh_banded(gram_matrix_bands(first, second), pulled)
    return float(tensions @ tensions) * chain.moment_of_inertia / chain.stiffness


def rate_after_impulse(rate: float, momentum: float, mu: float) -> float:
    """Return the rate [rad/s] after a change of the momentum, for a compliance mu [s^2].

    `momentum` is the change of the momentum divided by the moment of inertia [rad/s].
    """
    total = rate + 2 * mu * rate**3 + momentum
    scale = math.sqrt(6 * mu)
    return 2 / scale * math.sinh(math.asinh(1.5 * scale * total) / 3)
