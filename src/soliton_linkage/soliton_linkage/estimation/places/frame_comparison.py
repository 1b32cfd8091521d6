# SPDX-License-Identifier: Apache-2.0
"""Frames beside an orbit: what encoders add is taken off, and the likeliest arc is found."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.loops import frame_loops
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.places.encoder_offsets import EncoderOffsets, FarRotors
from soliton_linkage.estimation.places.frame_noise import FrameNoise
from soliton_linkage.estimation.places.frame_view import NO_FLAGS, FrameLikelihood, FrameView
from soliton_linkage.estimation.places.unseen_rotors import UnseenRotors
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.wall_shifts import WallShifts


class FrameComparison:
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
        self.far = FarRotors(self.offsets, chain, elastic)
        self._largest_scale = settings.offsets.largest_scale
        self._shifts = WallShifts(orbit)
        self._unseen = UnseenRotors(orbit)
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
    ) -> FrameView:
        """View from an arc that is unsure by a spread [rad^2], of rotors of a variance [rad^2].

        The rate of the arc [rad/s] tells where springs have rotors that are not seen.
        """
        about = self._orbit.stretch(arc)
        before, beyond = self._backgrounds[self._orbit.leg(arc)]
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
    ) -> FrameView:
        """View of a frame from the likeliest arc, by the frame and by what went before.

        Pushes may have moved the arc by a variance [rad^2].
        """
        tracking = self._tracking
        expected, spread = motion.expected, motion.expected_variance + pushed
        arc, unsure = expected, spread
        for _ in range(tracking.iterations):
            view = self.view(seen, arc, variance, unsure, upside_down, motion.expected_rate)
            if view.information == 0:
                break
            of_frame = variance / view.information
            unsure = spread * of_frame / (spread + of_frame)
            step = expected + spread / (spread + of_frame) * (view.arc - expected) - arc
            if abs(step) < tracking.close:
                break
            arc += min(max(step, -tracking.longest_step), tracking.longest_step)
        return view

    def shifts(self, arc: float) -> tuple[float, float]:
        """Deviations of an arc [rad] and of its rate, relative, by rotors that nobody told."""
        uneven = self.far.unevenness
        if not uneven:
            return 0.0, 0.0
        shifts = self._shifts.at(self._orbit.place(arc), self._orbit.leg(arc))
        return uneven * shifts.arc, uneven * shifts.rate

    def look_for_deformation(self, view: FrameView, before: FrameView) -> None:
        """Find rotors about the wall that are far off in a frame and in the one before.

        Where deviations may be, what they and springs do not explain is no wrong reading, but of a
        wall that is not that of the orbit, and as unsure as these rotors are off.
        """
        self.deformation = 0.0
        if self.far.unevenness:
            field = (1 + self._tracking.field_ratio) * self.far.unevenness**2 + self._elastic
            left = np.minimum(np.abs(view.residuals), np.abs(before.residuals))
            off = self.far.is_near(self._orbit.place(view.arc)) & ~self.far.doubtful
            off &= left > self._bound * math.sqrt(field)
            self.deformation = float(left[off] @ left[off])

    def learn(
        self, seen: Array, view: FrameView, elapsed: float, noise: FrameNoise, upside_down: bool
    ) -> bool:
        """Learn offsets from what a view leaves; whether others are known than before.

        The frame is a time [s] after the last.
        """
        outlying = view.outlying if view.unbelieved else None
        place = self._orbit.place(view.arc)
        residuals = view.residuals
        if self._likelihood.scales is not None:
            unsure = self._likelihood.scales > self._largest_scale
            residuals = np.where(unsure, np.nan, residuals)
        if not self.far.add(residuals, outlying, place, elapsed, noise.least):
            return False
        known = np.count_nonzero(self.offsets.corrections)
        self.far.learn(-1 if upside_down else 1, noise.variance)
        self.far.look_for_doubtful(seen, view.outlying)
        self._doubts = bool(self.far.doubtful.any())
        return bool(np.count_nonzero(self.offsets.corrections) != known)
