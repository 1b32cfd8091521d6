# SPDX-License-Identifier: Apache-2.0
"""Measurement model of the orbit, corrected for encoder offsets, unseen rotors and compliance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets, FarFieldResiduals
from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.measurement import (
    LEAST_INFORMATION,
    NO_FLAGS,
    FrameLikelihood,
    LinearisedMeasurement,
    OrbitComparison,
    search_arc,
)
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.noise import FrameNoise
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.linear.bands import band_edges, gap
from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linear.statics import gram_matrix_bands
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.orbit.wall_shifts import WallShifts

_CLOSE = 0.01
"""The search for the likeliest arc length ends when a step is shorter than this [rad]."""
_LARGE_SCALE = 1.5
"""Angles with a scale (see `ReadingScales`) above this [1] do not affect encoder offsets."""


class OrbitMeasurementModel:
    """Model that derives the arc length from angles; it estimates and corrects encoder offsets."""

    def __init__(
        self,
        orbit: Orbit,
        likelihood: FrameLikelihood,
        elastic: float,
        settings: EstimationSettings,
    ) -> None:
        """Start without encoder offsets.

        `elastic` is the variance of a residual due to the deformation of walls by springs [rad^2].
        """
        chain = orbit.chain
        self._orbit, self._likelihood = orbit, likelihood
        self._comparison = OrbitComparison(orbit)
        self.offsets = EncoderOffsets(chain.number_of_rotors, settings.offsets)
        self.far = FarFieldResiduals(self.offsets, chain, elastic)
        self._shifts = WallShifts(orbit)
        self._unseen = UnseenRotorCorrection(orbit)
        self.noise = 0.0
        """Variance of the noise of an angle [rad^2]."""
        self._any_doubtful = False
        self._learning: Iterator[None] = iter(())

    def linearise(
        self,
        seen: Array,
        arc: float,
        variance: float,
        spread: float,
        upside_down: bool,
        rate: float = 0.0,
    ) -> LinearisedMeasurement:
        """Return the measurement of angles [rad], shape (N,), linearised at an arc length [rad].

        `variance` is the variance of a residual, and `spread` is the variance of `arc` [rad^2].
        `rate` is the rate of the arc length [rad/s].
        """
        about, residuals = self._comparison.at(arc, seen, self.offsets.corrections, upside_down)
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
        by_residuals, rate_shift = self._unseen.shift(arc, view.residuals, field, self.noise)
        if not by_residuals:
            return view
        shifted = view.arc + by_residuals + rate_shift * rate**2
        share = self._unseen.remaining
        return view._replace(arc=shifted, unseen_share=share, rate_shift=rate_shift)

    def measure(
        self,
        motion: MultipleModelFilter,
        seen: Array,
        variance: float,
        impulse_variance: float,
        upside_down: bool,
    ) -> LinearisedMeasurement:
        """Return the measurement of a frame, linearised at the posterior mode of the arc length.

        `variance` is the variance of a residual [rad^2]. `impulse_variance` [rad^2] is added to
        the variance of the predicted arc length.
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
        """Return standard deviations of arc length [rad] and relative rate [1] due to disorder."""
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
    ) -> None:
        """Update the encoder offsets; the work on a full block is spread over several frames."""
        outlying = view.outlying if view.outliers else None
        residuals = view.residuals
        if self._likelihood.scales is not None:
            residuals = np.where(self._likelihood.scales > _LARGE_SCALE, np.nan, residuals)
        site = self._orbit.site(view.arc)
        if self.far.add(residuals, outlying, site, elapsed, noise.least):
            for _ in self._learning:
                pass
            sign = -1 if upside_down else 1
            self._learning = self._learn(sign, noise.variance, seen.copy(), view.outlying.copy())
        next(self._learning, None)

    def _learn(self, sign: int, variance: float, seen: Array, outlying: Flags) -> Iterator[None]:
        yield from self.far.learn(sign, variance)
        self.far.find_doubtful(seen, outlying)
        self._any_doubtful = bool(self.far.doubtful.any())


_NEGLIGIBLE = 0.01
"""The arc length is not corrected for unseen rotors if the variance that they cause in it is at
most this fraction of the variance that noise causes in it [1]."""


class UnseenRotorCorrection:
    """Correction of the arc length for unseen rotors; their angles follow from spring forces."""

    def __init__(self, orbit: Orbit) -> None:
        self._orbit = orbit
        lower, upper = (edge**2 for edge in band_edges(orbit.chain))
        self.remaining = (2 * lower / (lower + upper)) ** 2
        """Fraction of the variance of the arc length due to unseen rotors that remains after the
        correction [1]."""

    def shift(
        self, arc: float, residuals: Array, field: float, noise: float
    ) -> tuple[float, float]:
        """Return two corrections of the arc length; zeros if they would increase its variance.

        The first correction [rad] is for the deflections of unseen rotors by springs, which follow
        from the residuals of the seen rotors. The second one is for their deflections by inertial
        forces, and is divided by the squared rate of the arc length [s^2/rad]. The variance of an
        angle is `field` due to waves and springs, and `noise` due to noise [rad^2]. `residuals`
        [rad] are NaN for unseen rotors.
        """
        unseen = np.isnan(residuals)
        tangent = self._orbit.tangent(arc)
        hidden = float(tangent[unseen] @ tangent[unseen])
        shown = 1 - hidden
        if hidden * field <= _NEGLIGIBLE * noise or shown <= LEAST_INFORMATION:
            return 0.0, 0.0
        held, pull = self._balanced(arc, unseen, tangent)
        amplified = shown * pull[~unseen] + hidden * tangent[~unseen]
        if hidden * field * shown**2 < float(amplified @ amplified) * noise:
            return 0.0, 0.0
        turning = self._orbit.chain.moments_of_inertia * self._orbit.curvature(arc)
        return -float(pull[~unseen] @ residuals[~unseen]), -float(held @ turning)

    def _balanced(self, arc: float, unseen: Flags, tangent: Array) -> tuple[Array, Array]:
        """Return V and K V, with the stiffness matrix K.

        V is 0 for seen rotors, and K V equals `tangent` for unseen rotors.
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
"""Number of samples per rotor spacing of the compliance mu, which `ComplianceCorrection` defines
[1]. The interpolation error is 2 %."""
_LOWEST_ORDER = 0.2
"""`rate_ratio` corrects the rate w of the arc length only to lowest order in mu w^2, and therefore
only if 3 mu w^2 is at most this [1]."""
_PERIOD = 2
"""A moving wall has the same shape again after this distance [rotor spacings], because even and
odd rotors differ."""
_SLOW = 0.25
"""A slow wall passes at most this many rotors per period of the slowest phonon [1]."""
_SECOND_ORDER = 0.5
"""The rate change that `rate_ratio` predicts has a relative error of (`_SECOND_ORDER` x)^2. Here x
is the speed of the wall divided by the limit `_SLOW` [1]. The error was measured at x = 1."""

_SHAPE_MODE = math.sqrt(3) / 2
"""Frequency of the shape mode of a wall of the phi^4 equation, divided by the frequency of the
slowest phonon [1]. Walls of the sine-Gordon equation, and thus spinners, have no shape mode."""
_RADIATION = 0.5
"""Relative bandwidth of the resonance of a wall with the ripple of its rate, if the wall is fast
[1]; `ComplianceCorrection` defines the ripple. The bandwidth is not 0, because
the wall radiates phonons. With this value, the standard deviations of the site from `ripple` and
from simulations of five wobbling flippers and a spinner agree within a factor of 2 at speeds from
0.13 to 0.32 times the speed of sound."""
_RIPPLE_SHARE, _CORRELATED = 0.15, 1.5
"""Constants c and 3 L in the variance m^2 = c (s P)^2 / (x - 3 L) of the bias of `ripple_bias`
[1/rotor spacing, rotor spacings]. L = 0.5 is the correlation length of the bias, and c is
3 / (4 pi^2 L). A line is fitted while the wall moves by x in the time T. A ripple of variance s^2
and period P then causes the variance 18 (s P / (pi x T))^2 of the slope, averaged over all phases.
The bias causes the variance 24 m^2 L (1 - 3 L / x) / (x T^2). Both are equal for this m^2."""


class ComplianceCorrection:
    """Correction of the rate w of a wall for the compliance mu of the chain.

    The compliance mu [s^2] is defined by the momentum I (w + 2 mu w^3) of a moving wall, with the
    rate w of the arc length and the moment of inertia I of a rotor. If the bars were rigid, mu
    would be 0.

    The compliance depends periodically on the site of the wall, with a period of one or two rotor
    spacings. Therefore, the rate of a moving wall has a periodic part, the ripple. A wall is slow
    if its speed is below the limits that `_SLOW` and `_LOWEST_ORDER` state, and otherwise fast.
    `rate_ratio` predicts the ripple of slow walls. For fast walls, `ripple` and `ripple_bias`
    estimate the size of the ripple.
    """

    def __init__(self, orbit: Orbit) -> None:
        """Sample the compliance for walls in the middle of the chain.

        The samples neglect that single rotors and springs deviate from the nominal parameters.
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
        odd, even = (
            np.std([mu[:_SAMPLES] + sign * mu[_SAMPLES:] for mu in np.array(self._mu)])
            for sign in (-1, 1)
        )
        self._site_period = 2 if odd > even else 1
        self._resonance = gap(chain) * self._site_period * orbit.site_arc / (2 * math.pi)
        if chain.motion is not Motion.SPINNER:
            self._resonance *= _SHAPE_MODE
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
        """Return the rate [rad/s] after an impulse, for the mean mu.

        `momentum` is the impulse along the orbit divided by the inertia of a rotor [rad/s].
        """
        total = rate + 2 * self._mean * rate**3 + momentum
        scale = math.sqrt(6 * self._mean)
        return 2 / scale * math.sinh(math.asinh(1.5 * scale * total) / 3)

    def contraction(self, rate: float) -> tuple[float, float]:
        """Return p / (I w) and (dp / dw) / I [1] for the mean mu and the momentum p.

        w is `rate` [rad/s]. The first number is also the factor by which the motion contracts a
        wall.
        """
        square = 2 * self._mean * rate * rate
        return 1 + square, 1 + 3 * square

    def rate_ratio(self, arc: float, rate: float, before: float) -> float:
        """Return the factor by which springs change the rate of a wall [1]; 1 for fast walls.

        The wall moves from the arc length `before` to the arc length `arc` [rad]. Its rate at the
        start is `rate` [rad/s].
        """
        if abs(rate) > self._fastest:
            return 1.0
        square = 3 * rate * rate
        return math.sqrt((1 + square * self.mu(before)) / (1 + square * self.mu(arc)))

    def edge_exchange(self, rate: float) -> float:
        """Return the random relative change of the rate per rotor spacing at an edge [1].

        The springs of a wall store the fraction 3 mu w^2 / (1 + 3 mu w^2) of its energy, and
        exchange energy with the motion while an edge reflects the wall. Without this energy, the
        rate would change by half of the fraction. Independent changes per rotor spacing add up to
        this change over the four rotor spacings of a reflection. Simulated walls below 0.2 times
        the speed of sound change their rate by 0.3 to 0.8 times this change.
        """
        square = 3 * self._mean * rate * rate
        return 0.25 * square / (1 + square)

    def unpredicted_change(self, rate: float, arc: float) -> float:
        """Return the relative standard deviation [1] of a rate that `rate_ratio` has corrected.

        `arc` is the arc length along the orbit [rad].
        """
        square = 3 * rate * rate
        change = 0.5 * square * self._spread / (1 + square * self._mean)
        relative = abs(rate) / self._adiabatic
        if abs(rate) <= self._fastest:
            # `rate_ratio` omits terms of this order, which are large at some sites only.
            higher_order = (square * self.mu(arc)) ** 2
            return math.hypot(change * (_SECOND_ORDER * relative) ** 2, higher_order)
        # Inertia reduces the change. So does the window of the published velocity: three phonon
        # periods, or three passages of a rotor if this time is shorter.
        window = min(max(relative, 1.0), 1 / _SLOW)
        return change / (max(relative, 1.0) * window) ** 2

    def ripple(self, rate: float) -> float:
        """Return the variance of the site of a wall due to the ripple of its rate [spacings^2].

        The deformation of the wall responds to the ripple like a driven oscillator, with the
        frequency of the slowest phonon for a spinner, and of the shape mode for other walls. The
        result is 0 for slow walls, because `rate_ratio` predicts their rate.
        """
        if abs(rate) <= self._fastest:
            return 0.0
        square, ratio = 3 * rate * rate, abs(rate) / self._resonance
        change = 0.5 * square * self._spread / (1 + square * self._mean)
        change /= math.hypot(1 - ratio * ratio, _RADIATION * ratio)
        return (change * self._site_period / (2 * math.pi)) ** 2

    def ripple_bias(self, rate: float, duration: float = 0.0) -> float:
        """Return the variance of a bias of the site that replaces the ripple [spacings^2].

        A bias is an error of the site that is constant over a correlation length. With the
        returned variance, the bias and the ripple cause equal errors of the slope of a line that
        is fitted over the time `duration` [s]. For shorter times, the result is the value for the
        time in which the wall moves by 1.5 rotor spacings plus half a period of the ripple.
        """
        way, period = abs(rate) * duration / self._orbit.site_arc, self._site_period
        periods = max((way - _CORRELATED) / period, 0.5)
        return _RIPPLE_SHARE / periods * period * self.ripple(rate)


def _mu(orbit: Orbit, arc: float) -> float:
    chain = orbit.chain
    bend = orbit.curvature(arc)
    first, second = rigidity_bands(chain, orbit.configuration(arc))
    pulled = first * bend[:-1] + second * bend[1:]
    tensions: Array = solveh_banded(gram_matrix_bands(first, second), pulled)
    return float(tensions @ tensions) * chain.moment_of_inertia / chain.stiffness
