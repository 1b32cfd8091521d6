# SPDX-License-Identifier: Apache-2.0
"""Measurement model of several walls; each wall is fitted after the others are subtracted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from soliton_linkage.estimation.frames import rotor_swing
from soliton_linkage.estimation.measurement import (
    LEAST_INFORMATION,
    FrameLikelihood,
    LinearisedMeasurement,
)
from soliton_linkage.estimation.noise import ResidualVariance
from soliton_linkage.estimation.relocalisation import SCAN_DEVIATION
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.estimation.state_report import polarised_bonds
from soliton_linkage.estimation.wall_shapes import (
    WallShape,
    WallShapes,
    find_domains,
    fit_wall,
    scan_wall,
    set_residuals,
    tangent_of,
)
from soliton_linkage.estimation.wall_track import LatticeCoordinates, WallMeasurement
from soliton_linkage.linkage.chain import Array, Motion, staggered

_SHARE = 0.25
"""Assumed standard deviation of the arc length due to persistent residuals, divided by the rms of
these residuals [1]. In simulations of two and four walls, it is between 0.02 and 0.35.
Sensitivity: at 0.8x, the errors of a flipper in strong waves are 1.5 instead of 1.3 stated
standard deviations."""
_SCAN_BESIDE = 1.5
"""A scan extends this far to either side of a domain border [rotor spacings]."""


class _ShapeFit(NamedTuple):
    """Fit of a wall by the nearest wall at rest, and by a stretched shape."""

    shape: WallShape
    charge: int
    site: float
    """Site of the nearest wall at rest [rotor spacings]."""
    stretched_site: float
    """Site of the best stretched shape [rotor spacings]. It differs from `site` because a fast
    wall is not exactly a stretched wall at rest."""
    stretch: float
    stretch_information: float


class ShapeMeasurementModel:
    """Measurement model that fits the shapes of all walls in a frame."""

    def __init__(
        self,
        shapes: WallShapes,
        line: LatticeCoordinates,
        site_arc: float,
        noise: float | None,
        settings: EstimationSettings,
    ) -> None:
        """Start without frames.

        `noise` is the standard deviation of the noise of an angle [rad]; None if it is unknown.
        """
        self._shapes, self._line, self._arc = shapes, line, site_arc
        self._of_charge = {1: shapes.kinks, -1: shapes.anti_kinks}
        self._pinning = {1: 0.0, -1: shapes.pinning_speed}
        self._rest = {1: math.nan, -1: shapes.rest_site}
        self._chain = chain = shapes.chain
        likelihood, swing = settings.likelihood, rotor_swing(chain)
        self._likelihood = FrameLikelihood(swing, likelihood)
        self._evidence = -math.log(likelihood.false_alarms)
        self._largest = (likelihood.field_share * swing) ** 2 + likelihood.largest_noise**2
        self._bound, self._coarse = likelihood.bound, (SCAN_DEVIATION * swing) ** 2
        self._edge = 0 if chain.motion is Motion.SPINNER else 1
        self._domain = settings.walls.domain_bonds
        # Motion deforms a wall. Therefore, the residuals of kinks that move are no evidence about
        # anti-kinks, which are often at rest.
        self._residual = {charge: ResidualVariance(swing, noise, settings) for charge in (1, -1)}
        self.restart()

    def restart(self) -> None:
        """Discard the estimated noise and the residuals of the preceding frames."""
        for each in self._residual.values():
            each.restart()
            each.way = 0.0

    def measure(self, angles: Array, seen: Array) -> list[WallMeasurement]:
        """Return the measurements of all walls in a frame.

        `angles` [rad], shape (N,), are finite; `seen` are the same angles, but NaN if unseen.
        """
        polarised, turned = polarised_bonds(self._chain, angles)
        find = ring_borders if self._line.periodic else domain_borders
        borders = find(polarised, self._domain)
        if not borders:
            return []
        # The walls at the edges are fitted only so that they can be subtracted.
        reported = len(borders)
        if not self._line.periodic:
            borders += edge_borders(polarised, borders)
        theta = staggered(math.pi - seen if turned else seen)
        walls = [
            _ShapeFit(self._of_charge[charge][0], charge, site, site, 1.0, 0.0)
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
        for wall in walls[:reported]:
            first, view = self._linearise(theta, walls, wall)
            if self._explains(wall, first, view):
                parts.append((wall, first, view))
        for charge, residual in self._residual.items():
            views = [(first, view) for wall, first, view in parts if wall.charge == charge]
            if views:
                self._learn(residual, views)
        return [self._measurement(wall, view) for wall, _, view in parts]

    def _linearise(
        self, theta: Array, walls: Sequence[_ShapeFit], wall: _ShapeFit
    ) -> tuple[int, LinearisedMeasurement]:
        first, own = self._isolated(theta, walls, wall)
        # The contraction of a moving wall is no evidence of waves.
        stretched = wall.shape, wall.stretched_site, wall.stretch
        residuals = self._residuals(own, first, *stretched)
        tangent = tangent_of(first, len(own), wall.shape.table, wall.site, 1.0)
        arc = wall.site * self._arc
        variance = min(self._variance, self._largest)
        return first, self._likelihood.linearise(arc, 0, tangent / self._arc, residuals, variance)

    @property
    def _variance(self) -> float:
        variances = [each.of_rotor() for each in self._residual.values() if each.frames]
        return max(variances, default=self._coarse)

    def _explains(self, wall: _ShapeFit, first: int, view: LinearisedMeasurement) -> bool:
        """Return whether a fitted wall matches the rotors near it better than random angles do."""
        noise = max(each.noise.deviation for each in self._residual.values())
        likelihood = self._likelihood
        return (
            view.likelihood - view.random >= self._evidence
            and likelihood.fits(view.residuals, first, wall.site, noise)
            and likelihood.explains(view, self._largest)
        )

    def _isolated(
        self, theta: Array, walls: Sequence[_ShapeFit], wall: _ShapeFit
    ) -> tuple[int, Array]:
        reach = self._shapes.reach
        ways = [(self._line.separation(each.stretched_site, wall.site), each) for each in walls]
        ways = [(way, each) for way, each in ways if each is not wall]
        low = max([-reach, *(way / 2 for way, _ in ways if way < 0)])
        high = min([reach, *(way / 2 for way, _ in ways if way >= 0)])
        rotors = self._line.rotors_between(wall.site + low, wall.site + high, self._edge)
        own = theta[rotors % len(theta)]
        first = int(rotors[0]) if len(rotors) else 0
        for way, other in ways if len(rotors) else ():
            if abs(way) <= 2 * reach:  # Tails of walls farther away end outside these rotors.
                far = np.ascontiguousarray(other.shape.sides[:, int(way < 0)][rotors % 2])
                site = wall.site + way
                own = own + self._residuals(far, first, other.shape, site, other.stretch)
        return first, own

    def _residuals(
        self, theta: Array, first: int, shape: WallShape, site: float, stretch: float
    ) -> Array:
        residuals = np.empty_like(theta)
        set_residuals(theta, first, shape.table, site, stretch, residuals)
        return residuals

    def _fitted(self, theta: Array, walls: list[_ShapeFit], scanned: bool) -> list[_ShapeFit]:
        found = []
        for wall in walls:
            first, own = self._isolated(theta, walls, wall)
            shape, site, stretched = wall.shape, wall.site, wall.stretched_site
            if scanned:
                bound = self._bound**2 * self._coarse
                scans = [
                    (*scan_wall(own, first, each.table, site, _SCAN_BESIDE, bound), each)
                    for each in self._of_charge[wall.charge]
                ]
                _, site, shape = min(scans, key=lambda scan: scan[0])
                stretched = site
            variance = self._variance
            # Rotors that motion deflects are no outliers.
            deformed = variance + self._residual[wall.charge].elastic
            site, *_ = fit_wall(own, first, shape.table, site, 1.0, deformed, self._bound, False)
            stretch, information = wall.stretch, 0.0
            if self._shapes.stretches:
                stretched, stretch, _, information = fit_wall(
                    own, first, shape.table, stretched, stretch, variance, self._bound, True
                )
            else:
                stretched = site
            found.append(_ShapeFit(shape, wall.charge, site, stretched, stretch, information))
        return found

    def _learn(
        self, residual: ResidualVariance, parts: list[tuple[int, LinearisedMeasurement]]
    ) -> None:
        tangent, inlying = np.zeros((2, self._line.rotors))
        for first, view in parts:
            rotors = np.arange(first, first + len(view.tangent)) % self._line.rotors
            inlying[rotors] = view.inlying
            tangent[rotors] = view.tangent / math.sqrt(
                max(view.full_information, LEAST_INFORMATION)
            )
        views = [view for _, view in parts]
        residual.frames += 1
        residual.noise.update(
            views[0]._replace(
                first=0,
                tangent=tangent,
                inlying=inlying,
                squares=sum(each.squares for each in views),
                degrees_of_freedom=sum(each.degrees_of_freedom for each in views),
            )
        )

    def _measurement(self, wall: _ShapeFit, view: LinearisedMeasurement) -> WallMeasurement:
        line, residual = self._line, self._residual[wall.charge]
        width = math.nan, math.nan
        clear = line.edge_distance(wall.site) >= 2 * line.width
        if self._shapes.stretches and clear and wall.stretch_information > 0:
            deviation = math.sqrt(residual.of_rotor() / wall.stretch_information)
            width = self._shapes.width * wall.stretch, self._shapes.width * deviation
        variance = math.nan
        if view.information > LEAST_INFORMATION:
            variance = residual.of_arc(view._replace(unseen_share=0.0)) / self._arc**2
        return WallMeasurement(
            rotor=line.wrap(wall.site),
            deviation=math.sqrt(variance),
            charge=wall.charge,
            width=width,
            bias=residual.persistent_error(_SHARE) / self._arc**2,
            pinning=self._pinning[wall.charge],
            rest=self._rest[wall.charge],
            residual=residual,
        )


_CLEAR = 9
"""A ring is cut open far from all walls. To find the cut, sections of this number of bonds are
compared [1]. The absolute polarisation of a bond (see `polarised_bonds`) is 1 in a uniform state
and small in a wall. The cut is in the middle of the section whose smallest absolute polarisation
is largest."""


def domain_borders(polarised: Array, least: float) -> list[tuple[float, int]]:
    """Return sites [rotor spacings] and charges of the borders between domains.

    A domain is a range of bonds in which all rotors lean in the same direction. `polarised`
    contains the polarisation of each bond (see `polarised_bonds`). A domain between two others has
    at least `least` bonds.
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


def edge_borders(
    polarised: Array, borders: Sequence[tuple[float, int]]
) -> list[tuple[float, int]]:
    """Return sites and charges of walls that are too near an edge for `domain_borders`.

    Such a wall is where the polarisation changes its sign for the last time before the edge.
    `borders` is the result of `domain_borders`.
    """
    found = []
    for backwards, charge in ((False, borders[-1][1]), (True, borders[0][1])):
        scores = polarised[::-1] if backwards else polarised
        sign = charge if backwards else -charge
        if scores[-1] * sign < 0:
            bond = int(np.flatnonzero(scores * sign > 0)[-1])
            before, after = float(scores[bond]), float(scores[bond + 1])
            site = bond + 0.5 + before / (before - after)
            found.append((len(scores) - site if backwards else site, -charge))
    return found


def ring_borders(polarised: Array, least: float) -> list[tuple[float, int]]:
    """Return the `domain_borders` of a ring, after it has been cut open far from all walls."""
    bonds = len(polarised)
    clear = minimum_filter1d(np.abs(polarised), min(_CLEAR, bonds), mode='wrap')
    cut = int(np.argmax(clear)) + 1
    opened = np.roll(polarised, -cut)[:-1]
    borders = domain_borders(opened, least)
    return sorted(((site + cut) % bonds, charge) for site, charge in borders)
