# SPDX-License-Identifier: Apache-2.0
"""Lattice coordinates, tracks of single walls over many frames, and encounters of two walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.estimates import EventKind, OrbitEstimate, TrackingStatus
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter, slope_variance
from soliton_linkage.estimation.noise import ResidualVariance
from soliton_linkage.estimation.orbit_model import ComplianceCorrection
from soliton_linkage.estimation.settings import EstimationSettings, WallSettings
from soliton_linkage.estimation.state_report import (
    FrameErrors,
    StateReporter,
    energy_reach,
    polarised_bonds,
)
from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.solitons.tanh_fit import order_field


class LatticeCoordinates:
    """Site coordinates along a chain [rotor spacings], periodic from 0 to N on a ring."""

    def __init__(self, chain: Chain) -> None:
        self.rotors, self.periodic = chain.number_of_rotors, chain.periodic
        self.width = chain.wall_width / chain.spacing
        """Width of a slow wall [rotor spacings]."""
        room, reach = self.rotors - (not chain.periodic), energy_reach(chain)
        self.near = min(reach, room / 3)
        """Distance below which two walls, or a wall and an edge, interact [rotor spacings]."""
        self.parted = min(1.5 * reach, room / 2)
        """Distance above which two walls count as separated [rotor spacings]."""
        self.period = 2 * math.pi / max(gap(chain), 1e-12)
        """Longest period of a phonon [s]."""

    def separation(self, site: float, other: float) -> float:
        """Return the (shorter) displacement from `other` to `site` [rotor spacings]."""
        way = site - other
        return math.remainder(way, self.rotors) if self.periodic else way

    def wrap(self, site: float) -> float:
        """Return the equivalent site between 0 and N on a ring; an open chain keeps the site."""
        return site % self.rotors if self.periodic else site

    def edge_distance(self, site: float) -> float:
        """Return the distance to the nearer edge [rotor spacings], infinite for a ring."""
        return math.inf if self.periodic else min(site, self.rotors - 1 - site)

    def nearest_edge(self, site: float) -> float:
        """Return the site of the edge that is nearer to a given site [rotor spacings]."""
        return 0.0 if site < (self.rotors - 1) / 2 else self.rotors - 1.0

    def rotors_between(self, low: float, high: float, edge: int = 0) -> NDArray[np.int64]:
        """Return the rotors between two sites, without the `edge` outermost rotors of each end."""
        first, last = math.ceil(low), math.floor(high)
        if not self.periodic:
            first, last = max(first, edge), min(last, self.rotors - 1 - edge)
        return np.arange(first, last + 1)

    def midpoint(self, left: float, right: float) -> float:
        """Return the midpoint of the section from `left` to `right` [rotor spacings]."""
        way = right - left
        if self.periodic:
            way %= self.rotors
        return self.wrap(left + way / 2)


class WallFrame:
    """Angles and rates of one frame; methods compute energies and swings near walls."""

    def __init__(
        self,
        reporter: StateReporter,
        line: LatticeCoordinates,
        angles: Array | None,
        rates: Array | None,
        errors: FrameErrors,
    ) -> None:
        """Store angles [rad] and rates [rad/s], shape (N,) each; None means unknown."""
        self._reporter, self._chain, self._line = reporter, reporter.chain, line
        self._angles, self._rates, self._errors = angles, rates, errors

    def energy(self, sites: Sequence[float]) -> float:
        """Return the sum of the energies near the walls at the given sites [J]; NaN if unknown."""
        angles, rates = self._angles, self._rates
        if angles is None or rates is None or not np.isfinite(rates).all():
            return math.nan
        return self._reporter.report(angles, sites, rates, self._errors).energies.wall

    def swing(self, site: float, lean: int) -> float:
        """Return the largest swing of a rotor near a site, divided by a full swing [1].

        The swing of a rotor is its distance from the uniform state that leans right (if `lean` is
        1) or left (if `lean` is -1).
        """
        if self._angles is None:
            return 0.0
        field, _ = order_field(self._chain, self._angles)
        near = self._line.rotors_between(site - self._line.near, site + self._line.near)
        return float(np.abs(field[near % len(field)] - lean).max() / 2)

    def turn(self, left: float, right: float) -> int:
        """Return the sign of the change of the angles across the wall at `left`; 0 for flippers.

        `right` is the site of the next wall. Only rotors up to the midpoint of both walls are
        used.
        """
        chain, line, angles = self._chain, self._line, self._angles
        if angles is None or chain.motion is not Motion.SPINNER:
            return 0
        _, turned = polarised_bonds(chain, angles)
        middle = left + line.separation(line.midpoint(left, right), left)
        rotors = line.rotors_between(left - max(line.near, 2.0), middle) % line.rotors
        steps = np.diff((angles - chain.uniform_state(-1 if turned else 1))[rotors])
        return int(np.sign(np.sum(wrapped(steps))))


_FORCE = 0.6
"""Process noise of the rate of a fast anti-kink, divided by u^4 / v [1]. Here v is its speed, and
u is `WallMeasurement.pinning`. The value is f^2 / 2, with the root mean square force f = pi /
sqrt(8) of a sinusoidal potential for u = 1."""


_CHANCE = 3.0
"""Displacements of a pinned anti-kink from its rest site count as noise if they are smaller than
this number of standard deviations [1]."""


class WallMeasurement(NamedTuple):
    """Measurement of a wall in one frame, from a fit of its shape or from the `OrbitFilter`."""

    rotor: float
    """Site of the centre of the wall [rotor spacings]."""
    deviation: float
    """Standard deviation of the site [rotor spacings], NaN if unknown."""
    charge: int
    """Charge of the wall, +1 or -1."""
    width: tuple[float, float] = (math.nan, math.nan)
    """Width of the wall [m] and standard deviation of the width [m], NaN if unknown."""
    bias: float = 0.0
    """Variance of a persistent error of the site [rotor spacings^2]."""
    pinning: float = 0.0
    """Speed at which the kinetic energy equals the barrier between two sites [spacings / s]; 0 if
    there is no barrier or the barrier is not computed."""
    rest: float = math.nan
    """Site at which a pinned anti-kink rests, modulo 1 [rotor spacings]; NaN for other walls."""
    residual: ResidualVariance | None = None
    """Variance of the residuals of the fitted walls, from which the forces of waves on the walls
    are estimated; None if these forces are not estimated."""
    estimate: OrbitEstimate | None = None
    """Estimate of the `OrbitFilter` if it has measured the wall; None for a fit."""


class WallTrack:
    """State of a wall from frame to frame; for fitted walls, a filter estimates the motion."""

    def __init__(
        self,
        line: LatticeCoordinates,
        charge: int,
        scale: float,
        site_arc: float,
        settings: EstimationSettings,
        compliance: ComplianceCorrection | None = None,
    ) -> None:
        """Start without measurements.

        `scale` is the typical rate [rad/s], and `site_arc` the arc length per rotor spacing [rad].
        `compliance` describes the ripple of the rate; None if there is no ripple.
        """
        self._compliance = compliance
        self._line, self._scale, self._arc, self._settings = line, scale, site_arc, settings
        self.charge = charge
        self.id = 0
        """Identifier of the wall, 1 or more; 0 until the wall is confirmed."""
        self.rotor = self.rate = self.deviation = self.rate_deviation = math.nan
        self.frames = self.missed = 0
        """Number of frames that show this wall, and number of later frames that do not."""
        self.last_seen = math.nan
        """Time of the last frame that has shown this wall [s]."""
        self.width = math.nan, math.nan
        self.energy = math.nan
        """Energy of the wall when it was last far from edges and other walls [J]."""
        self.was_free = False
        """Whether the wall was far from edges and other walls in the preceding frame."""
        self._motion: MultipleModelFilter | None = None
        self._variance = self._pinning = 0.0

    @property
    def is_seen(self) -> bool:
        """Whether the last frame has shown this wall."""
        return self.missed == 0 and self.frames > 0

    @property
    def status(self) -> TrackingStatus:
        """Tracking status of the wall; COASTING if the last frame has not shown it."""
        if not self.is_seen:
            return TrackingStatus.COASTING
        return TrackingStatus.TRACKING if self.frames > 1 else TrackingStatus.ACQUIRED

    def predict(self, elapsed: float) -> tuple[float, float]:
        """Return the predicted site after `elapsed` [s], and its variance [rotor spacings^2]."""
        if self._motion is None:
            rate = self.rate if math.isfinite(self.rate) else 0.0
            spread = 0.0 if rate else self._scale / self._arc * elapsed
            return self._line.wrap(self.rotor + rate * elapsed), spread**2 + self._variance
        ripple = 0.0
        if self._compliance is not None:
            _, rate, of_arc, _, of_rate = self._motion.summary
            duration = math.sqrt(3 * of_arc / of_rate)
            ripple = self._compliance.ripple_bias(rate, duration) * self._arc**2
        near = self._line.edge_distance(self.rotor) < self._line.near
        exchange = self._settings.filter.change_at_edges if near else 0.0
        self._motion.predict(elapsed, exchange, ripple=ripple)
        if self._pinning:
            # The force on a fast wall is correlated over a quarter of a rotor spacing. A slow wall
            # oscillates in a potential well with the angular frequency pi u; the force on it is
            # correlated over a quarter of the oscillation period. Its root mean square is
            # pi u v = sqrt(8) f u v, with u, v and f of `_FORCE`. The factor 8 does not apply to
            # the deviation of the rate: an unknown rate is no evidence of an oscillation.
            speed = math.hypot(self.rate, self.rate_deviation)
            force = min(max(8 * self.rate**2, speed**2), self._pinning**2) * self._pinning**2
            added = _FORCE * force / max(speed, self._pinning) * elapsed * self._arc**2
            self._motion.add_rate_noise(added, elapsed)
        site, variance = self._motion.expected / self._arc, self._motion.expected_variance
        return self._line.wrap(site), variance / self._arc**2 + self._variance

    def update(self, measured: WallMeasurement, time: float) -> None:
        """Update the state with a measurement at a time [s], after `predict` for this time."""
        self.frames += 1
        self.missed, self.last_seen, self.width = 0, time, measured.width
        self._pinning = measured.pinning
        wall = measured.estimate
        if wall is not None:
            self.rotor, self.rate = wall.site, wall.site_rate
            self.deviation, self.rate_deviation = wall.site_deviation, wall.site_rate_deviation
            self._motion, self._variance = None, 0.0
            return
        known = math.isfinite(measured.deviation)
        self._variance = (measured.deviation if known else self._line.width) ** 2
        variance = max(self._variance, 1e-12) * self._arc**2
        if self._motion is None:
            arc, given = measured.rotor * self._arc, self._settings.filter
            self._motion = MultipleModelFilter(arc, variance, self._scale, self._arc, given)
            if math.isfinite(self.rate_deviation):
                self._motion.set_rate(self.rate * self._arc, self.rate_deviation * self._arc)
        else:
            expected = self._motion.expected / self._arc
            apart = self._line.separation(measured.rotor, self._line.wrap(expected))
            calm = 1.0
            if measured.residual is not None:
                calm = measured.residual.allow_waves(self._motion, self._scale, self._line.period)
            self._motion.update((expected + apart) * self._arc, variance, calm=calm)
        arc, rate, of_arc, _, of_rate = self._motion.summary
        self.rotor, self.rate = self._line.wrap(arc / self._arc), rate / self._arc
        # The filter does not include the error due to persistent residuals. This error oscillates
        # with the waves, and changes while the wall moves.
        speed = self.rate / self._settings.filter.bias_way
        frequency = math.hypot(speed, 2 * math.pi / self._line.period)
        bias = measured.bias
        if math.isfinite(measured.rest):
            # Waves deform a pinned anti-kink, which looks like a displacement from its rest site.
            apart = math.remainder(self.rotor - measured.rest, 1.0)
            chance = _CHANCE**2 * (of_arc / self._arc**2 + bias)
            bias += max(apart**2 - chance, 0.0)
        of_rate += bias * self._arc**2 * slope_variance(of_rate / of_arc, frequency)
        self.deviation = math.sqrt(of_arc / self._arc**2 + bias)
        self.rate_deviation = math.sqrt(of_rate) / self._arc

    def stop(self) -> None:
        """Discard the estimated rate of the wall."""
        self._motion, self.frames = None, 0
        self._variance = 0.0
        self.rate = self.rate_deviation = math.nan


class Encounter:
    """Encounter of two neighbouring walls, from their approach to their separation."""

    def __init__(
        self,
        line: LatticeCoordinates,
        settings: WallSettings,
        left: WallTrack,
        right: WallTrack,
        time: float,
        energy: float,
    ) -> None:
        """Start at a time [s], given the energy near both walls [J]."""
        self._line, self._settings = line, settings
        self.left, self.right = left, right
        self.energy = energy
        """Energy near both walls at the start, or energy of the breather when it formed [J]."""
        self.collisions = 0
        """Number of overlaps of the two walls."""
        self.breather = 0
        """Identifier of the breather; 0 if the walls have not formed a breather."""
        self.overlaps = False
        """Whether the two walls overlap, so that the last frame does not show either of them."""
        self.when = self._moved = time
        """when: time of the first overlap [s], or of the smallest distance if there has been no
        overlap. _moved: time of the last frame that shows both walls, or a large swing of a
        rotor near `site` [s]."""
        self.site = line.midpoint(left.rotor, right.rotor)
        """Midpoint between the walls at the time `when` [rotor spacings]."""
        self.passed = False
        """Whether the walls have passed through each other an odd number of times."""
        self._turn = 0
        self._distance = abs(line.separation(right.rotor, left.rotor))
        self._initial = self._closest = self._distance
        self._onset = self._peak = 0.0
        self._overlapped_since = math.nan

    @property
    def both_seen(self) -> bool:
        """Whether the last frame has shown both walls."""
        return self.left.is_seen and self.right.is_seen

    @property
    def ids_before(self) -> tuple[int, ...]:
        """Identifiers of the walls before the encounter, left to right; a breather has one."""
        ids = self.left.id, self.right.id
        return (self.breather,) if self.breather else ids[::-1] if self.passed else ids

    def add_seen(self, time: float, turn: int) -> None:
        """Add a frame that shows both walls; `turn` is `WallFrame.turn` for these walls."""
        self.overlaps, self._moved = False, time
        self._distance = abs(self._line.separation(self.right.rotor, self.left.rotor))
        self._peak = max(self._peak, self._distance)
        if not self.collisions and self._distance < self._closest:
            self._closest, self.when = self._distance, time
            self.site = self._line.midpoint(self.left.rotor, self.right.rotor)
        if turn and self._turn and turn != self._turn:
            self.passed = not self.passed
            self.left.id, self.right.id = self.right.id, self.left.id
        self._turn = turn or self._turn

    def add_overlap(self, time: float, swing: float) -> None:
        """Add a frame in which the walls overlap; `swing` is `WallFrame.swing` at `site`."""
        if not self.overlaps:
            if not self.collisions or self._peak > self._onset + self._line.width / 4:
                self.collisions += 1
            if self.collisions == 1:
                self.when = time
            self._onset, self._peak = self._distance, 0.0
            self._overlapped_since = time
        self.overlaps = True
        if swing > self._settings.lump_share:
            self._moved = time

    def is_over(self) -> bool:
        """Return whether the walls have separated."""
        return self.both_seen and self._distance > self._line.parted

    def outcome(self, time: float) -> EventKind | None:
        """Return the event that has occurred by the given time [s]; None if there is none."""
        if self.is_over():
            nearer = self._initial - self._closest
            if self.breather:
                return EventKind.BREATHER_DECAYED
            if self.collisions or nearer > max(0.2 * self._initial, self._line.width / 2):
                return EventKind.PASSING if self.passed else EventKind.BOUNCE
            return None
        quiet = self._settings.quiet_periods * self._line.period
        if self.overlaps and time - self._moved > quiet:
            return EventKind.BREATHER_DECAYED if self.breather else EventKind.ANNIHILATION
        persistent = self.overlaps and time - self._overlapped_since > 4 * quiet
        if not self.breather and (
            persistent or self.collisions >= self._settings.breather_collisions
        ):
            return EventKind.BREATHER_FORMED
        return None
