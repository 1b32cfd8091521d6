# SPDX-License-Identifier: Apache-2.0
"""Frames beside an orbit: what encoders add is taken off, and the likeliest arc is found."""

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
"""Step of the arc that is not worth another linearisation [rad]."""


class OrbitMeasurementModel:
    """Compares frames with an orbit, and learns offsets of encoders from them."""

    def __init__(
        self,
        orbit: Orbit,
        likelihood: FrameLikelihood,
        elastic: float,
        settings: EstimationSettings,
    ) -> None:
        """Begin without offsets; waves of a mean square [rad^2] tell nothing of encoders."""
        chain = orbit.chain
        self._orbit, self._likelihood = orbit, likelihood
        self._tracking = settings.tracking
        self._backgrounds = [
            orbit.background(orbit.arc_at(orbit.middle, leg))
            for leg in range(orbit.number_of_legs)
        ]
        self.offsets = EncoderOffsets(chain.number_of_rotors, settings.offsets)
        self.far = FarFieldResiduals(self.offsets, chain, elastic)
        self._shifts = WallShifts(orbit)
        self._unseen = UnseenRotorCorrection(orbit)
        self.noise = 0.0
        """Variance of a reading, of that of a rotor from the orbit [rad^2]."""
        self._doubts = False
        self._bound, self._elastic = settings.likelihood.bound, elastic
        self.deformation = 0.0
        """Variance of the arc by rotors that stay off, in a chain that is not even [rad^2]."""

    def view(
        self,
        seen: Array,
        arc: float,
        variance: float,
        spread: float,
        upside_down: bool,
        rate: float = 0.0,
    ) -> LinearisedMeasurement:
        """View from an arc that is unsure by a spread [rad^2], of rotors of a variance [rad^2].

        The rate of the arc [rad/s] tells where springs have rotors that are not seen.
        """
        about = self._orbit.segment(arc)
        before, beyond = self._backgrounds[self._orbit.leg(arc)]
        left = np.empty(len(before))
        compare(
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
            doubtful = self.far.doubtful
            left[self.far.stuck] = np.nan
        view = self._likelihood.view(
            arc, about.first, about.tangent, left, variance, spread, doubtful
        )
        if math.isfinite(view.largest) or not view.known:
            return view
        field = variance - self.noise
        shift = self._unseen.shift(arc, rate, view.residuals, field, self.noise)
        if not shift:
            return view
        return view._replace(arc=view.arc + shift, untold=self._unseen.left)

    def recognised(
        self,
        motion: MultipleModelFilter,
        seen: Array,
        variance: float,
        pushed: float,
        upside_down: bool,
    ) -> LinearisedMeasurement:
        """View of a frame from the likeliest arc, by the frame and by what went before.

        Pushes may have moved the arc by a variance [rad^2].
        """
        expected, spread = motion.expected, motion.expected_variance + pushed
        views: list[LinearisedMeasurement] = []

        def likeliest(arc: float) -> float:
            unsure = spread
            if views:
                of_frame = variance / views[-1].information
                unsure *= of_frame / (spread + of_frame)
            view = self.view(seen, arc, variance, unsure, upside_down, motion.expected_rate)
            views.append(view)
            if view.information == 0:
                return arc
            share = spread / (spread + variance / view.information)
            return expected + share * (view.arc - expected)

        search_arc(expected, likeliest, _CLOSE)
        return views[-1]

    def shifts(self, arc: float) -> tuple[float, float]:
        """Deviations of an arc [rad] and of its rate, relative, by rotors that nobody told."""
        uneven = self.far.unevenness
        if not uneven:
            return 0.0, 0.0
        shifts = self._shifts.at(self._orbit.site(arc), self._orbit.leg(arc))
        return uneven * shifts.arc, uneven * shifts.rate

    def look_for_deformation(
        self, view: LinearisedMeasurement, before: LinearisedMeasurement
    ) -> None:
        """Find rotors about the wall that are far off in a frame and in the one before.

        Where deviations may be, what they and springs do not explain is no wrong reading, but of a
        wall that is not that of the orbit, and as unsure as these rotors are off.
        """
        self.deformation = 0.0
        if self.far.unevenness:
            field = (1 + self._tracking.field_ratio) * self.far.unevenness**2 + self._elastic
            left = np.minimum(np.abs(view.residuals), np.abs(before.residuals))
            off = self.far.is_near(self._orbit.site(view.arc)) & ~self.far.doubtful
            off &= left > self._bound * math.sqrt(field)
            self.deformation = float(left[off] @ left[off])

    def learn(
        self,
        seen: Array,
        view: LinearisedMeasurement,
        elapsed: float,
        noise: FrameNoise,
        upside_down: bool,
    ) -> bool:
        """Learn offsets from what a view leaves; whether others are known than before.

        The frame is a time [s] after the last.
        """
        outlying = view.outlying if view.unbelieved else None
        site = self._orbit.site(view.arc)
        residuals = view.residuals
        if self._likelihood.scales is not None:
            unsure = self._likelihood.scales > 1.5
            residuals = np.where(unsure, np.nan, residuals)
        if not self.far.add(residuals, outlying, site, elapsed, noise.least):
            return False
        known = np.count_nonzero(self.offsets.corrections)
        self.far.learn(-1 if upside_down else 1, noise.variance)
        self.far.look_for_doubtful(seen, view.outlying)
        self._doubts = bool(self.far.doubtful.any())
        return bool(np.count_nonzero(self.offsets.corrections) != known)


_NEGLIGIBLE = 0.01
"""Of the variance by noise, below which unseen rotors make no difference [1]."""
_UNTOLD = 1e-6
"""Share of the arc that the others have, below which they tell nothing of it [1]."""


class UnseenRotorCorrection:
    """Tells what unseen rotors do to the nearest point of an orbit."""

    def __init__(self, orbit: Orbit) -> None:
        """Work out how well slow waves leave springs in balance."""
        self._orbit = orbit
        lower, upper = (edge**2 for edge in band_edges(orbit.chain))
        self.left = (2 * lower / (lower + upper)) ** 2
        """Share of the variance by unseen rotors that springs leave [1]."""

    def shift(
        self, arc: float, rate: float, residuals: Array, field: float, noise: float
    ) -> float:
        """Shift of the nearest point to residuals from it [rad], shape (N,), NaN of unseen rotors.

        It is 0 where noise hides it. The rate is that of the arc [rad/s], the variances are those
        of a rotor by what is beside the orbit and by noise [rad^2].
        """
        unseen = np.isnan(residuals)
        tangent = self._orbit.tangent(arc)
        untold = float(tangent[unseen] @ tangent[unseen])
        told = 1 - untold
        if untold * field <= _NEGLIGIBLE * noise or told <= _UNTOLD:
            return 0.0
        held, pull = self._balanced(arc, unseen, tangent)
        shown = told * pull[~unseen] + untold * tangent[~unseen]
        if untold * field * told**2 < float(shown @ shown) * noise:
            return 0.0
        turning = self._orbit.chain.moments_of_inertia * self._orbit.curvature(arc) * rate**2
        return -float(held @ turning + pull[~unseen] @ residuals[~unseen])

    def _balanced(self, arc: float, unseen: Flags, tangent: Array) -> tuple[Array, Array]:
        """V, which is 0 of seen rotors, and K V, which is t of unseen ones, shape (N,) each."""
        chain = self._orbit.chain
        first, second = rigidity_bands(chain, self._orbit.configuration(arc))
        rotors = np.flatnonzero(unseen)
        pulled = np.zeros((len(rotors), len(unseen)))
        for row, rotor in enumerate(rotors):
            pulled[row, rotor] = 1.0
        extensions = first * pulled[:, :-1] + second * pulled[:, 1:]
        tensions = chain.stiffnesses * extensions
        stiffness = chain.gathered(first * tensions, second * tensions)
        held = np.zeros_like(tangent)
        held[rotors] = np.linalg.solve(stiffness[:, rotors], tangent[rotors])
        return held, held[rotors] @ stiffness


_SAMPLES = 32
"""Places in a rotor spacing [1]: a straight line between two is right to 2 % in wobblers."""
_LOWEST_ORDER = 0.2
"""Share 3 mu w^2 of the energy that springs may take for the lowest order to hold [1]."""
_ALIKE = 2
"""Rotor spacings after which the chain about a wall is the same [1], as rotors stagger."""
_SLOW = 0.25
"""Rotors that a slow wall passes in a period of the slowest phonon, at most [1]: the third of its
harmonics is below it."""


class ComplianceCorrection:
    """How much springs yield to a wall of a chain, by its place between two rotors."""

    def __init__(self, orbit: Orbit) -> None:
        """Work it out in the middle of an orbit; deviations of the rotors count for nothing."""
        self._orbit = even = orbit
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        if orbit.chain != chain:
            even = UniformOrbit(chain)
        begin = _ALIKE * math.floor(even.middle / _ALIKE)
        places = begin + np.arange(_ALIKE * _SAMPLES) / _SAMPLES
        places = np.minimum(places, chain.number_of_rotors - 1.0)
        self._mu = [[_mu(even, even.arc_at(site, leg)) for site in places] for leg in (0, 1)]
        self._mean = float(np.mean(self._mu))
        adiabatic = _SLOW * gap(chain) * orbit.site_arc / (2 * math.pi)
        self._fastest = min(adiabatic, math.sqrt(_LOWEST_ORDER / (3 * np.max(self._mu))))

    def mu(self, arc: float) -> float:
        """Mu at an arc of the orbit [s^2]."""
        samples = self._mu[self._orbit.leg(arc) % 2]
        whole, beyond = divmod(self._orbit.site(arc) * _SAMPLES, 1.0)
        number = int(whole)
        here, there = (samples[each % len(samples)] for each in (number, number + 1))
        return here + beyond * (there - here)

    def pushed_rate(self, rate: float, momentum: float) -> float:
        """Rate after a momentum p / I [rad/s] was added, of a wall between any two rotors."""
        return pushed_rate(rate, momentum, self._mean)

    def change(self, arc: float, rate: float, before: float) -> float:
        """What springs make of the rate of a slow wall on its way to an arc, from one before."""
        if abs(rate) > self._fastest:
            return 1.0
        square = 3 * rate * rate
        return math.sqrt((1 + square * self.mu(before)) / (1 + square * self.mu(arc)))


def _mu(orbit: Orbit, arc: float) -> float:
    """Mu at an arc of the orbit of a chain without deviations [s^2]."""
    chain = orbit.chain
    bend = orbit.curvature(arc)
    first, second = rigidity_bands(chain, orbit.configuration(arc))
    pulled = first * bend[:-1] + second * bend[1:]
    tensions: Array = solveh_banded(gram_matrix_bands(first, second), pulled)
    return float(tensions @ tensions) * chain.moment_of_inertia / chain.stiffness


def pushed_rate(rate: float, momentum: float, mu: float) -> float:
    """Rate after a momentum p / I [rad/s] was added, of a wall that yields by mu [s^2]."""
    whole = rate + 2 * mu * rate**3 + momentum
    scale = math.sqrt(6 * mu)
    return 2 / scale * math.sinh(math.asinh(1.5 * scale * whole) / 3)
