# SPDX-License-Identifier: Apache-2.0
"""Measurement model of several walls: before the fit of a wall, all others are subtracted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from soliton_linkage.estimation.frames import rotor_swing
from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.estimation.relocalisation import SCAN_DEVIATION
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.estimation.state_report import FrameState
from soliton_linkage.estimation.wall_shapes import (
    WallShape,
    WallShapes,
    find_domains,
    fit_wall,
    persistence,
    scan_wall,
    set_residuals,
)
from soliton_linkage.estimation.wall_track import LatticeCoordinates, WallMeasurement
from soliton_linkage.linear.bands import couplings
from soliton_linkage.linkage.chain import Array, Motion, staggered

_TAILS = 1.5
"""Largest distance between two walls that influence each other, relative to the range of a
`WallTable` [1]."""
_SCAN_BESIDE = 1.5
"""Range of the scan for the site, on either side of a domain border [rotor spacings]."""
_CORE = 2.5
"""Range on either side of a wall in which the fitted shape must match all rotors [rotor
spacings]."""


class _ShapeFit(NamedTuple):
    shape: WallShape
    charge: int
    site: float
    stretch: float
    site_information: float
    stretch_information: float


class ShapeMeasurementModel:
    """Measurement model that fits the shapes of all walls in a frame."""

    def __init__(
        self, shapes: WallShapes, line: LatticeCoordinates, settings: EstimationSettings
    ) -> None:
        self._shapes, self._line, self._noise = shapes, line, settings.noise
        self._of_charge = {1: shapes.kinks, -1: shapes.anti_kinks}
        self._chain = chain = shapes.chain
        likelihood, swing = settings.likelihood, rotor_swing(chain)
        self._likelihood = FrameLikelihood(swing, likelihood)
        self._evidence = -math.log(likelihood.false_alarms)
        self._largest = (likelihood.field_share * swing) ** 2 + likelihood.largest_noise**2
        self._bound, self._coarse = likelihood.bound, (SCAN_DEVIATION * swing) ** 2
        self._elastic = (likelihood.elastic_share * swing) ** 2
        self._edge = 0 if chain.motion is Motion.SPINNER else 1
        self._domain = settings.walls.domain_bonds
        plus, minus = couplings(chain)
        self._uniform = (plus**2 - minus**2) / (plus**2 + minus**2)
        self._before = np.full(line.rotors, math.nan)
        self.restart()

    def restart(self) -> None:
        """Discard the estimated variance of a rotor and the residuals of the preceding frame."""
        self._variance, self._frames = self._coarse, 0
        self._before[:] = math.nan

    def measure(self, state: FrameState, seen: Array) -> list[WallMeasurement]:
        """Return the measurements of all walls for angles [rad], shape (N,), NaN if unseen."""
        borders = self._borders(state)
        if not borders:
            return []
        spinner = self._chain.motion is Motion.SPINNER
        turned = (state.twists if spinner else state.upright) < 0
        theta = staggered(math.pi - seen if turned else seen)
        walls = [
            _ShapeFit(self._of_charge[charge][0], charge, site, 1.0, 0.0, 0.0)
            for site, charge in borders
        ]
        walls = self._fitted(theta, walls, scanned=True)
        near = any(
            abs(self._line.separation(one.site, other.site)) < self._line.parted
            for one, other in combinations(walls, 2)
        )
        if near:
            # Repeat the fits, because the first ones assumed inaccurate sites of the other walls.
            walls = self._fitted(theta, walls, scanned=False)
        parts = []
        for wall in walls:
            first, own = self._isolated(theta, walls, wall)
            residuals = self._residuals(own, first, wall, wall.site)
            if self._explains(wall, first, residuals):
                parts.append((wall, first, residuals))
        before, self._before = self._before, np.full(len(theta), math.nan)
        if parts:
            self._learn(np.concatenate([residuals for *_, residuals in parts]), len(parts))
        for _, first, residuals in parts:
            self._before[np.arange(first, first + len(residuals)) % len(theta)] = residuals
        return [self._measurement(*part, before) for part in parts]

    def _borders(self, state: FrameState) -> list[tuple[float, int]]:
        first, second = state.first**2, state.second**2
        strength = np.maximum(first + second, np.finfo(np.float64).tiny)
        polarised = (first - second) / (strength * self._uniform)
        find = ring_borders if self._line.periodic else domain_borders
        return find(polarised, self._domain)

    def _explains(self, wall: _ShapeFit, first: int, residuals: Array) -> bool:
        """Return whether a fitted wall matches its rotors better than random angles.

        The rotors in the core of the wall must also match better.
        """
        variance = min(self._variance, self._largest)
        if self._likelihood.over_random(residuals, variance) < self._evidence:
            return False
        if not self._likelihood.fits(residuals, first, wall.site, math.sqrt(variance)):
            return False
        beside = np.abs(np.arange(first, first + len(residuals)) - wall.site)
        return self._likelihood.over_random(residuals[beside < _CORE], self._largest) >= 0

    def _isolated(
        self, theta: Array, walls: Sequence[_ShapeFit], wall: _ShapeFit
    ) -> tuple[int, Array]:
        reach = self._shapes.reach
        ways = [(self._line.separation(each.site, wall.site), each) for each in walls]
        ways = [(way, each) for way, each in ways if each is not wall]
        low = max([-reach, *(way / 2 for way, _ in ways if way < 0)])
        high = min([reach, *(way / 2 for way, _ in ways if way >= 0)])
        rotors = self._line.rotors_between(wall.site + low, wall.site + high, self._edge)
        own = theta[rotors % len(theta)]
        first = int(rotors[0]) if len(rotors) else 0
        for way, other in ways:
            if len(rotors) and abs(way) <= _TAILS * reach:
                far = np.ascontiguousarray(other.shape.sides[:, int(way < 0)][rotors % 2])
                own = own + self._residuals(far, first, other, wall.site + way)
        return first, own

    def _residuals(self, theta: Array, first: int, wall: _ShapeFit, site: float) -> Array:
        residuals = np.empty_like(theta)
        set_residuals(theta, first, wall.shape.table, site, wall.stretch, residuals)
        return residuals

    def _fitted(self, theta: Array, walls: list[_ShapeFit], scanned: bool) -> list[_ShapeFit]:
        found = []
        for wall in walls:
            first, own = self._isolated(theta, walls, wall)
            shape, site = wall.shape, wall.site
            if scanned:
                bound = self._bound**2 * self._coarse
                scans = [
                    (*scan_wall(own, first, each.table, site, _SCAN_BESIDE, bound), each)
                    for each in self._of_charge[wall.charge]
                ]
                _, site, shape = min(scans, key=lambda scan: scan[0])
            fit = fit_wall(
                own,
                first,
                shape.table,
                site,
                wall.stretch,
                self._variance,
                self._bound,
                self._shapes.stretches,
            )
            found.append(_ShapeFit(shape, wall.charge, *fit))
        return found

    def _learn(self, residuals: Array, walls: int) -> None:
        sizes = np.abs(residuals[np.isfinite(residuals)])
        if len(sizes) < 4 * walls:
            return
        self._frames += 1
        gain = 1 / min(self._frames, self._noise.recent_frames)
        seen = robust_deviation(sizes) ** 2 * len(sizes) / (len(sizes) - 2 * walls)
        self._variance += gain * (seen - self._variance)
        self._variance = max(self._variance, self._noise.least_noise**2)

    def _measurement(
        self, wall: _ShapeFit, first: int, residuals: Array, before: Array
    ) -> WallMeasurement:
        line, variance, information = self._line, self._variance, wall.site_information
        width = math.nan, math.nan
        clear = line.edge_distance(wall.site) >= 2 * line.width
        if self._shapes.stretches and clear and wall.stretch_information > 0:
            deviation = math.sqrt(variance / wall.stretch_information)
            width = self._shapes.width * wall.stretch, self._shapes.width * deviation
        earlier = before[np.arange(first, first + len(residuals)) % len(before)]
        product, noise = persistence(
            residuals, earlier, first, wall.shape.table, wall.site, wall.stretch
        )
        scale = 1 / max(information, 1e-12)
        return WallMeasurement(
            rotor=line.wrap(wall.site),
            deviation=math.sqrt(variance / information) if information > 0 else math.nan,
            charge=wall.charge,
            width=width,
            persistent=product * scale,
            noise=noise * (variance * scale) ** 2,
            elastic=self._elastic * scale,
            pinning=self._shapes.pinning_speed if wall.charge < 0 else 0.0,
        )


_CLEAR = 9
"""Preferred number of bonds between the cut of a ring and the nearest wall [1]."""


def domain_borders(polarised: Array, least: float) -> list[tuple[float, int]]:
    """Return sites [rotor spacings] and charges of the borders between domains.

    A domain has at least `least` bonds.
    """
    scores = np.ascontiguousarray(polarised, dtype=np.float64)
    right = np.empty(len(scores), dtype=np.bool_)
    find_domains(scores, least, right)
    borders = []
    for bond in np.flatnonzero(right[1:] != right[:-1]).tolist():
        before, after = float(scores[bond]), float(scores[bond + 1])
        share = before / (before - after) if before * after < 0 else 0.5
        borders.append((bond + 0.5 + share, 1 if right[bond] else -1))
    return borders


def ring_borders(polarised: Array, least: float) -> list[tuple[float, int]]:
    """Return the `domain_borders` of a ring; the ring is cut inside a domain."""
    bonds = len(polarised)
    clear = minimum_filter1d(np.abs(polarised), min(_CLEAR, bonds), mode='wrap')
    cut = int(np.argmax(clear)) + 1
    opened = np.roll(polarised, -cut)[:-1]
    borders = domain_borders(opened, least)
    return sorted(((site + cut) % bonds, charge) for site, charge in borders)
