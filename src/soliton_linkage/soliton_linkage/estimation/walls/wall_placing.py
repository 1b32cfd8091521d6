# SPDX-License-Identifier: Apache-2.0
"""Places the walls of a frame, each by the shape that it has alone, less the tails of the next.

Away from the others a wall is as well placed as one that is alone. What the shapes leave of the
rotors tells the variance with which they count: noise, waves, and what motion does to a shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.loops import wall_loops
from soliton_linkage.estimation.places.frame_view import swing_of
from soliton_linkage.estimation.robust import robust_deviation
from soliton_linkage.estimation.settings import LikelihoodSettings, WallSettings
from soliton_linkage.estimation.state_report import FrameState
from soliton_linkage.estimation.walls.wall_line import WallLine
from soliton_linkage.estimation.walls.wall_shapes import WallShape, WallShapes
from soliton_linkage.estimation.walls.wall_track import SeenWall
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered, wrapped

_TAILS = 1.5
"""Distance in reaches of a table beyond which a wall moves no other [1]: by less than 1e-4 rad."""


class _Fitted(NamedTuple):
    """A wall with the rotors about it."""

    shape: WallShape
    charge: int
    place: float
    stretch: float
    of_place: float
    of_stretch: float


class WallPlacer:
    """Places walls by their shapes, frame after frame."""

    def __init__(
        self,
        shapes: WallShapes,
        chain: Chain,
        line: WallLine,
        settings: WallSettings,
        likelihood: LikelihoodSettings,
    ) -> None:
        """Begin with the shapes that walls of a chain have."""
        self._shapes = shapes
        self._chain, self._line, self._settings = chain, line, settings
        swing = swing_of(chain)
        self._bound, self._coarse = likelihood.bound, (settings.scan_share * swing) ** 2
        self._elastic = (likelihood.elastic_share * swing) ** 2
        self._uniform = chain.uniform_state(1)
        self._edge = 0 if chain.motion is Motion.SPINNER else 1
        self._left = np.full(line.rotors, math.nan)
        self.restart()

    def restart(self) -> None:
        """Forget how well shapes fitted."""
        self._variance, self._frames = self._coarse, 0
        self._left[:] = math.nan

    def placed(
        self, state: FrameState, seen: Array, borders: Sequence[tuple[float, int]]
    ) -> list[SeenWall]:
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
            _Fitted(self._shape(angles, place, charge), charge, place, 1.0, 0.0, 0.0)
            for place, charge in borders
        ]
        walls = self._fitted(theta, walls, scanned=True)
        if self._are_near(walls):
            # Their tails were those of walls at the borders.
            walls = self._fitted(theta, walls, scanned=False)
        parts = self._left_by(theta, walls)
        self._learn(np.concatenate([left for _, left in parts]), len(walls))
        before, self._left = self._left, np.full(len(theta), math.nan)
        for first, left in parts:
            self._left[np.arange(first, first + len(left)) % len(theta)] = left
        return [
            self._seen(wall, first, left, before)
            for wall, (first, left) in zip(walls, parts, strict=True)
        ]

    def _are_near(self, walls: Sequence[_Fitted]) -> bool:
        """Whether any two are so near that the tails of one move the other."""
        return any(
            one is not other and abs(self._line.apart(one.place, other.place)) < self._line.parted
            for one, other in pairwise([walls[-1], *walls])
        )

    def _shape(self, angles: Array, place: float, charge: int) -> WallShape:
        """Shape of a wall, of spinners by the sense in which its rotors turn."""
        if self._chain.motion is not Motion.SPINNER:
            return self._shapes(charge, 0)
        reach = min(self._shapes.reach, self._line.near)
        rotors = self._rotors(place - reach, place + reach)
        turned = (angles - self._uniform)[rotors % len(angles)]
        steps = wrapped(np.diff(turned[np.isfinite(turned)]))
        return self._shapes(charge, 1 if float(steps.sum()) > 0 else -1)

    def _rotors(self, low: float, high: float) -> NDArray[np.int64]:
        """Numbers of the rotors between two places; round a ring they run beyond 0 and N."""
        first, last = math.ceil(low), math.floor(high)
        if not self._line.periodic:
            first = max(first, self._edge)
            last = min(last, self._line.rotors - 1 - self._edge)
        return np.arange(first, last + 1)

    def _window(self, walls: Sequence[_Fitted], index: int) -> NDArray[np.int64]:
        """Rotors about a wall that are nearer to it than to its neighbours."""
        place, reach = walls[index].place, self._shapes.reach
        low, high = place - reach, place + reach
        for other, _, before in self._neighbours(walls, index):
            middle = place + self._line.apart(other.place, place) / 2
            low, high = (max(low, middle), high) if before else (low, min(high, middle))
        return self._rotors(low, high)

    def _neighbours(
        self, walls: Sequence[_Fitted], index: int
    ) -> list[tuple[_Fitted, float, bool]]:
        """Walls on both sides, their place beside this one, and whether they are before it."""
        found = []
        for beside in (-1, 1):
            other = index + beside
            if not self._line.periodic and not 0 <= other < len(walls):
                continue
            wall = walls[other % len(walls)]
            if wall is walls[index]:
                continue
            way = self._line.apart(wall.place, walls[index].place)
            if len(walls) > 2 or way * beside > 0:
                found.append((wall, walls[index].place + way, beside < 0))
        return found

    def _alone(self, theta: Array, walls: Sequence[_Fitted], index: int) -> tuple[int, Array]:
        """First rotor about a wall, and angles without the tails of its neighbours [rad]."""
        rotors = self._window(walls, index)
        own = theta[rotors % len(theta)]
        if not len(rotors):
            return 0, own
        first = int(rotors[0])
        for wall, place, before in self._neighbours(walls, index):
            if abs(place - walls[index].place) > _TAILS * self._shapes.reach:
                continue
            far = wall.shape.sides[:, 1 if before else 0][rotors % 2]
            tails = np.empty_like(own)
            self._leave(np.ascontiguousarray(far), first, wall, place, tails)
            own = own + tails
        return first, own

    def _leave(self, theta: Array, first: int, wall: _Fitted, place: float, left: Array) -> None:
        shapes = self._shapes
        wall_loops.leave(
            theta, first, wall.shape.table, shapes.points, shapes.reach, place, wall.stretch, left
        )

    def _fitted(self, theta: Array, walls: list[_Fitted], scanned: bool) -> list[_Fitted]:
        shapes, found = self._shapes, []
        for index, wall in enumerate(walls):
            first, own = self._alone(theta, walls, index)
            table, place = wall.shape.table, wall.place
            if scanned:
                place = wall_loops.scan(
                    own,
                    first,
                    table,
                    shapes.points,
                    shapes.reach,
                    place,
                    self._settings.scan_beside,
                    self._bound**2 * self._coarse,
                )
            place, stretch, of_place, of_stretch = wall_loops.fit(
                own,
                first,
                table,
                shapes.points,
                shapes.reach,
                place,
                wall.stretch,
                self._variance,
                self._bound,
                shapes.stretches,
            )
            found.append(_Fitted(wall.shape, wall.charge, place, stretch, of_place, of_stretch))
        return found

    def _left_by(self, theta: Array, walls: Sequence[_Fitted]) -> list[tuple[int, Array]]:
        """First rotor about each wall, and what it leaves of their angles [rad]."""
        parts = []
        for index, wall in enumerate(walls):
            first, own = self._alone(theta, walls, index)
            left = np.empty_like(own)
            self._leave(own, first, wall, wall.place, left)
            parts.append((first, left))
        return parts

    def _learn(self, left: Array, walls: int) -> None:
        """Learn the variance of a rotor from what so many walls leave of all of them [rad]."""
        left = np.abs(left[np.isfinite(left)])
        if len(left) < 4 * walls:
            return
        self._frames += 1
        share = 1 / min(self._frames, self._settings.scatter_frames)
        freedom = len(left) / (len(left) - 2 * walls)
        seen = robust_deviation(left) ** 2 * freedom
        self._variance += share * (seen - self._variance)
        self._variance = max(self._variance, self._settings.least_noise**2)

    def _seen(self, wall: _Fitted, first: int, left: Array, before: Array) -> SeenWall:
        """A wall as it is told, with what it leaves of the rotors from a first one on [rad].

        Before is what all walls left of all rotors in the frame before [rad], shape (N,).
        """
        line, variance = self._line, self._variance
        deviation = math.sqrt(variance / wall.of_place) if wall.of_place > 0 else math.nan
        width = width_deviation = math.nan
        clear = line.edge_distance(wall.place) >= 2 * line.width
        if self._shapes.stretches and clear and wall.of_stretch > 0:
            width = self._shapes.width * wall.stretch
            width_deviation = self._shapes.width * math.sqrt(variance / wall.of_stretch)
        earlier = before[np.arange(first, first + len(left)) % len(before)]
        shapes = self._shapes
        product, chance = wall_loops.lasting(
            left,
            earlier,
            first,
            wall.shape.table,
            shapes.points,
            shapes.reach,
            wall.place,
            wall.stretch,
        )
        scale = 1 / max(wall.of_place, 1e-12)
        return SeenWall(
            line.on_it(wall.place),
            deviation,
            wall.charge,
            width,
            width_deviation,
            product * scale,
            chance * (variance * scale) ** 2,
            self._elastic * scale,
        )
