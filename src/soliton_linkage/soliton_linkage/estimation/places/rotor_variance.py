# SPDX-License-Identifier: Apache-2.0
"""How far a rotor may be from the orbit: the variance that a frame is seen with.

It is that of the noise, of the field beside the orbit as frames of late have it, and of what
springs do to a wall that has not yet shown it or is at an edge.
"""

from __future__ import annotations

import math

from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.places.frame_noise import FrameNoise
from soliton_linkage.estimation.places.frame_view import FrameView
from soliton_linkage.estimation.settings import EstimationSettings


class RotorVariance:
    """Variance of a rotor from the orbit, and with it that of the arc that a frame shows."""

    def __init__(self, swing: float, noise: float | None, settings: EstimationSettings) -> None:
        """Begin with the swing that a rotor makes as a wall passes [rad] and its noise [rad]."""
        given = settings.likelihood
        self._given_noise, self._settings = noise, settings
        self._tracking = settings.tracking
        self.elastic = (given.elastic_share * swing) ** 2
        """What springs may do to a wall before it is known [rad^2]."""
        self.largest_field = (given.field_share * swing) ** 2
        """Largest variance beside noise that a frame may have [rad^2]."""
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.way = math.inf
        """How far the wall went since the last frame [rotor spacings]."""
        self.frames = 0
        """Frames of which it was learnt."""
        self.at_edge = False
        """Whether springs take up or give back energy."""

    def begin(self, best: FrameView) -> None:
        """Begin anew with the likeliest view of a frame; the way is that of before."""
        self.frames = 0
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.noise.update(best, 0.0)

    def learn(self, view: FrameView, elapsed: float) -> None:
        """Learn from a view of a frame, a time [s] after the last."""
        self.noise.update(view, elapsed)
        self.frames += 1

    def of_rotor(self) -> float:
        """Variance of a rotor from the orbit, by noise and the field beside it [rad^2].

        The field is that of late, and what it may have changed by since the last frame.
        """
        noise = self.noise
        field = max(noise.scatter - noise.variance, 0.0)
        field += self._tracking.field_ratio * noise.excess
        changed = max(min(self.way, 1.0), math.exp(-self.frames / self._tracking.settled))
        edge_ratio = self._tracking.edge_ratio if self.at_edge else 1.0
        field += self.elastic * changed * edge_ratio
        return noise.variance + min(field, self.largest_field)

    def of_arc(self, motion: MultipleModelFilter, view: FrameView, elapsed: float) -> float:
        """Variance of the arc that a frame shows [rad^2], a time [s] after the last.

        Rotors of which some are not seen have another nearest point than all of them, by what
        the frame is beside the orbit and springs do not tell, for as long as the wall takes to
        pass a rotor; those of which some are not believed only in this frame.
        """
        known = max(view.information_of_all, view.information)
        unseen, unbelieved = max(1 / known - 1, 0.0), 1 / view.information - 1 / known
        way = abs(motion.expected_rate) * elapsed
        frames = max(motion.site_arc / max(way, 1e-9), 1.0)
        noise = self.noise
        field = noise.excess + (self.elastic if self.at_edge else 0.0)
        lasting = field * unseen * view.untold * min(frames, self._tracking.most_alike)
        fleeting = max(noise.scatter - noise.variance, field) * unbelieved
        return noise.variance / view.information + lasting + fleeting

    def calm(self, rate: float) -> float:
        """How little the field beside the orbit disturbs a wall of an arc rate [1], from 0 to 1.

        Waves of an angle phi change the rate w of a wall by a share of about phi / w, in units of
        the chain's time; the field tells that there are any by its share of the noise.
        """
        noise = self.noise
        field = max(noise.scatter - noise.variance, noise.excess, 0.0)
        steady = rate**2 * noise.variance
        disturbed = self._tracking.wave_doubt * field * (noise.variance + field)
        return steady / (steady + disturbed) if disturbed else 1.0
