# SPDX-License-Identifier: Apache-2.0
"""Places the walls of a frame, each by the shape that it has alone, less the tails of the next.

Away from the others a wall is as well placed as one that is alone. What the shapes leave of the
rotors tells the variance with which they count: noise, waves, and what motion does to a shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from soliton_linkage.estimation import wall_loops
from soliton_linkage.estimation.frames import rotor_swing
from soliton_linkage.estimation.lattice import LatticeCoordinates
from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.estimation.state_report import FrameState
from soliton_linkage.estimation.wall_shapes import WallShape, WallShapes
from soliton_linkage.estimation.wall_track import WallMeasurement
from soliton_linkage.linkage.chain import Array, Motion, staggered
from soliton_linkage.orbit.wall_shifts import WallShifts

_TAILS = 1.5
"""Distance in reaches of a table beyond which a wall moves no other [1]: by less than 1e-4 rad."""


class _Fitted(NamedTuple):
    """A wall with the rotors about it."""

    shape: WallShape
    charge: int
    site: float
    stretch: float
    site_information: float
    of_stretch: float


class ShapeMeasurementModel:
    """Places walls by their shapes, frame after frame."""

    def __init__(
        self,
        shapes: WallShapes,
        line: LatticeCoordinates,
        settings: EstimationSettings,
        shifts: WallShifts | None = None,
    ) -> None:
        """Begin with the shapes that walls of a chain have, and what deviations do to its wall."""
        self._shapes, self._line, self._settings = shapes, line, settings.walls
        self._noise = settings.noise
        self._of_charge = {1: shapes.kinks, -1: shapes.anti_kinks}
        self._shifts, self._evenness = shifts, settings.offsets.evenness
        self._chain = chain = shapes.chain
        likelihood, swing = settings.likelihood, rotor_swing(chain)
        self._likelihood = FrameLikelihood(swing, likelihood)
        self._evidence = -math.log(likelihood.false_alarms)
        self._largest = (likelihood.field_share * swing) ** 2 + likelihood.largest_noise**2
        self._bound, self._coarse = likelihood.bound, (settings.scan.deviation * swing) ** 2
        self._elastic = (likelihood.elastic_share * swing) ** 2
        self._edge = 0 if chain.motion is Motion.SPINNER else 1
        self._before = np.full(line.rotors, math.nan)
        self._means, self._counts = np.zeros((2, line.rotors))
        self.restart()

    def restart(self) -> None:
        """Forget how well shapes fitted."""
        self._variance, self._frames = self._coarse, 0
        self._before[:] = math.nan
        self._means[:] = self._counts[:] = 0.0

    def placed(
        self, state: FrameState, seen: Array, borders: Sequence[tuple[float, int]]
    ) -> list[WallMeasurement]:
        """Walls at the borders of domains [rotor spacings] with their charges.

        Angles that were seen [rad] are of shape (N,), NaN where they were not.
        """
        if not borders:
            return []
        angles = seen
        turned = (state.twists if self._chain.motion is Motion.SPINNER else state.upright) < 0
        if turned:
            angles = math.pi - angles
        theta = staggered(angles)
        walls = [
            _Fitted(self._of_charge[charge][0], charge, site, 1.0, 0.0, 0.0)
            for site, charge in borders
        ]
        walls = self._fitted(theta, walls, scanned=True)
        if self._are_near(walls):
            # Their tails were those of walls at the borders.
            walls = self._fitted(theta, walls, scanned=False)
        parts = []
        for wall in walls:
            first, own = self._alone(theta, walls, wall)
            left = self._left(own, first, wall, wall.site)
            if self._explains(wall, first, left):
                parts.append((wall, first, left))
        before, self._before = self._before, np.full(len(theta), math.nan)
        if not parts:
            return []
        self._learn(np.concatenate([left for *_, left in parts]), len(parts))
        for _, first, left in parts:
            self._before[np.arange(first, first + len(left)) % len(theta)] = left
        found = [self._seen(*part, before) for part in parts]
        if len(walls) == 1 and self._shifts is not None:
            found[0] = found[0]._replace(untold=self._untold(*parts[0], self._shifts))
        return found

    def _explains(self, wall: _Fitted, first: int, left: Array) -> bool:
        """Whether rotors from a first one on are likelier with a wall than if each were anything.

        It leaves so much of them [rad]. All together they are so beyond chance, and those of its
        core are so however large noise and field may be.
        """
        variance = min(self._variance, self._largest)
        if self._likelihood.over_nothing(left, variance) < self._evidence:
            return False
        beside = np.abs(np.arange(first, first + len(left)) - wall.site)
        core = left[beside < self._settings.core]
        return self._likelihood.over_nothing(core, self._largest) >= 0

    def _are_near(self, walls: Sequence[_Fitted]) -> bool:
        """Whether any two are so near that the tails of one move the other."""
        return any(
            abs(self._line.apart(one.site, other.site)) < self._line.parted
            for one, other in combinations(walls, 2)
        )

    def _alone(self, theta: Array, walls: Sequence[_Fitted], wall: _Fitted) -> tuple[int, Array]:
        """Rotors about a wall that are nearer to it than to others: the first of them, and angles.

        They are without the tails of the others [rad].
        """
        reach = self._shapes.reach
        ways = [(self._line.apart(each.site, wall.site), each) for each in walls]
        ways = [(way, each) for way, each in ways if each is not wall]
        low = max([-reach, *(way / 2 for way, _ in ways if way < 0)])
        high = min([reach, *(way / 2 for way, _ in ways if way >= 0)])
        rotors = self._line.numbers(wall.site + low, wall.site + high, self._edge)
        own = theta[rotors % len(theta)]
        first = int(rotors[0]) if len(rotors) else 0
        for way, other in ways:
            if len(rotors) and abs(way) <= _TAILS * reach:
                far = other.shape.sides[:, 1 if way < 0 else 0][rotors % 2]
                own = own + self._left(np.ascontiguousarray(far), first, other, wall.site + way)
        return first, own

    def _left(self, theta: Array, first: int, wall: _Fitted, site: float) -> Array:
        left = np.empty_like(theta)
        wall_loops.set_residuals(theta, first, wall.shape.table, site, wall.stretch, left)
        return left

    def _fitted(self, theta: Array, walls: list[_Fitted], scanned: bool) -> list[_Fitted]:
        found = []
        for wall in walls:
            first, own = self._alone(theta, walls, wall)
            shape, site = self._scanned(own, first, wall) if scanned else (wall.shape, wall.site)
            fit = wall_loops.fit(
                own,
                first,
                shape.table,
                site,
                wall.stretch,
                self._variance,
                self._bound,
                self._shapes.stretches,
            )
            found.append(_Fitted(shape, wall.charge, *fit))
        return found

    def _scanned(self, own: Array, first: int, wall: _Fitted) -> tuple[WallShape, float]:
        """Shape and place that leave least of rotors from a first one on [rad], near a wall."""
        bound, beside = self._bound**2 * self._coarse, self._settings.scan_beside
        scans = [
            (*wall_loops.scan(own, first, shape.table, wall.site, beside, bound), shape)
            for shape in self._of_charge[wall.charge]
        ]
        _, site, shape = min(scans, key=lambda scan: scan[0])
        return shape, site

    def _learn(self, left: Array, walls: int) -> None:
        """Learn the variance of a rotor from what so many walls leave of all of them [rad]."""
        left = np.abs(left[np.isfinite(left)])
        if len(left) < 4 * walls:
            return
        self._frames += 1
        share = 1 / min(self._frames, self._noise.recent_frames)
        freedom = len(left) / (len(left) - 2 * walls)
        seen = robust_deviation(left) ** 2 * freedom
        self._variance += share * (seen - self._variance)
        self._variance = max(self._variance, self._noise.least_noise**2)

    def _untold(self, wall: _Fitted, first: int, left: Array, shifts: WallShifts) -> float:
        """Variance of the place of a wall by deviations that nobody told [rotor spacings^2].

        They have most rotors off by as much as lasts of what the wall leaves of them from a first
        one on [rad]. Where they have some off by far more, the wall is off from its shape as well.
        """
        rotors = np.arange(first, first + len(left))[seen := np.isfinite(left)]
        self._counts[rotors] += 1
        shares = 1 / np.minimum(self._counts[rotors], self._noise.recent_frames)
        self._means[rotors] += shares * (left[seen] - self._means[rotors])
        sizes, share = np.abs(self._means[rotors]), float(shares.mean())
        chance = self._variance * share * (1 - share)
        uneven = robust_deviation(sizes.copy()) ** 2 - chance - self._evenness**2
        if uneven <= 0:
            return 0.0
        deformed = sizes[sizes > self._bound * math.sqrt(uneven)]
        of_arc = uneven * shifts.at(wall.site, 0).arc ** 2 + float(deformed @ deformed)
        return of_arc / max(wall.site_information, 1e-12)

    def _seen(self, wall: _Fitted, first: int, left: Array, before: Array) -> WallMeasurement:
        """A wall as it is told, with what it leaves of the rotors from a first one on [rad].

        Before is what all walls left of all rotors in the frame before [rad], shape (N,).
        """
        line, variance = self._line, self._variance
        deviation = (
            math.sqrt(variance / wall.site_information) if wall.site_information > 0 else math.nan
        )
        of_width = math.nan, math.nan
        clear = line.edge_distance(wall.site) >= 2 * line.width
        if self._shapes.stretches and clear and wall.of_stretch > 0:
            unsure = math.sqrt(variance / wall.of_stretch)
            of_width = self._shapes.width * wall.stretch, self._shapes.width * unsure
        earlier = before[np.arange(first, first + len(left)) % len(before)]
        product, chance = wall_loops.persistence(
            left, earlier, first, wall.shape.table, wall.site, wall.stretch
        )
        scale = 1 / max(wall.site_information, 1e-12)
        return WallMeasurement(
            line.on_it(wall.site),
            deviation,
            wall.charge,
            of_width,
            product * scale,
            chance * (variance * scale) ** 2,
            self._elastic * scale,
        )


_CLEAR = 9
"""Bonds about a joint that are to be of one domain [1], where there are so many."""


def domain_borders(polarised: Array, opposite: float) -> list[tuple[float, int]]:
    """Borders of the domains [rotor spacings] with the charges of the walls there.

    By the polarisations of all bonds, shape (springs,). A domain is of more bonds than so many,
    or of half of them at an end, so that rotors that are read wrongly are none. Charges
    alternate.
    """
    scores = np.ascontiguousarray(polarised, dtype=np.float64)
    right = np.empty(len(scores), dtype=np.bool_)
    wall_loops.domains(scores, opposite, right)
    borders = []
    for bond in np.flatnonzero(right[1:] != right[:-1]).tolist():
        before, after = float(scores[bond]), float(scores[bond + 1])
        opposed = before * after < 0
        share = before / (before - after) if opposed else 0.5
        borders.append((bond + 0.5 + share, 1 if right[bond] else -1))
    return borders


def borders_of_ring(polarised: Array, opposite: float) -> list[tuple[float, int]]:
    """The same of a ring, from 0 to the number of its bonds; it is opened within a domain."""
    bonds = len(polarised)
    clear = minimum_filter1d(np.abs(polarised), min(_CLEAR, bonds), mode='wrap')
    joint = int(np.argmax(clear)) + 1
    opened = np.roll(polarised, -joint)[:-1]
    turned = [
        ((site + joint) % bonds, charge) for site, charge in domain_borders(opened, opposite)
    ]
    return sorted(turned)
