# SPDX-License-Identifier: Apache-2.0
"""Path of a wall from rotor to rotor through a chain with deviations of rotors and springs.

The seed is the rotor that moves most at the present position of the wall. Its angle determines the
angles of all other rotors. Bar n joins rotors n and n + 1. Its levers A_n and B_n are the
derivatives of the distance between the two masses with respect to the angles of rotor n and
rotor n + 1. When the levers of the bar between the seed and a neighbour become equal,
|A_n| = |B_n|, both rotors move equally fast, and the neighbour becomes the seed.

For a given angle of rotor n + 1, bar n allows two angles of rotor n, at which A_n has opposite
signs. The rates satisfy A_n dphi_n + B_n dphi_{n+1} = 0. If A_n vanished, all rotors to the right
of rotor n would stand still. Therefore, A_n does not vanish while the seed, which moves most, is
to the right of rotor n. A_n keeps the sign that it had when the seed changed from n to n + 1, and
this sign selects one of the two angles. For a seed to the left of rotor n, the sign of B_{n-1}
selects the angle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.solitons.passage import find_obstacles
from soliton_linkage.solitons.static_wall import (
    angles_from_seed,
    bar_branches,
    neighbour_angle,
    static_wall,
)

Numbers = NDArray[np.int64]
Branches = NDArray[np.int8]

_LONGEST_STEP = 0.1
"""Longest step of the seed, relative to the smaller of the rest angle and 1 rad [1]. The step is
short enough that each seed makes more than one step."""
_SHORTEST_STEP = 1e-10
"""The wall counts as blocked if the bars do not allow a step of the seed longer than this [rad].
The limit exceeds the rounding errors of the bar lengths."""
_CLEAR_LEAD = 1e-9
"""A rotor becomes the seed if its lead (see `_Seed.lead`) exceeds this [1]. The value is larger
than the rounding errors of a lead."""
_NEGLIGIBLE_LEAD = -4.0
"""The search for the rotor with the largest lead (see `_Seed.lead`) ends at a rotor with a lead
below this [1]. It is assumed that no rotor farther out moves more than e^4 times as much as this
rotor, so that none of them leads."""
_MOST_PIECES_A_ROTOR = 20
"""If a path has more than this number of pieces per rotor [1], it does not close. Closed paths
have 4 pieces per rotor in flippers and 2 in spinners."""


class SeedPath(NamedTuple):
    """P successive pieces of the orbit; rotor `seeds[p]` is the seed of piece p."""

    seeds: Numbers
    begins: Array
    """Angle of the seed at the start of each piece [rad], shape (P,)."""
    ends: Array
    """Angle of the seed at the end of each piece [rad], shape (P,). The difference from `begins`
    is less than 2 pi."""
    left_branches: Branches
    """Signs of the levers A of the bars around the seed of each piece, shape (P, 2 beside), where
    `beside` is the argument of the function `seed_path`. The bars have the numbers seed - beside
    to seed + beside - 1."""
    right_branches: Branches
    """Signs of the levers B of the same bars, shape (P, 2 beside)."""

    def take(self, which: Numbers) -> SeedPath:
        """Return a path of the pieces with the given indices."""
        return SeedPath._make(part[which] for part in self)

    def halves(self) -> SeedPath:
        """Return a path in which each piece is split at the mean of its `begins` and `ends`."""
        split = self.take(np.repeat(np.arange(len(self.seeds)), 2))
        middles = (self.begins + self.ends) / 2
        split.ends[::2] = middles
        split.begins[1::2] = middles
        return split


class _Seed:
    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._last = chain.number_of_rotors - 1
        self._lengths: list[float] = chain.rotor_lengths.tolist()
        self._spacings: list[float] = chain.spacings.tolist()
        self._step = _LONGEST_STEP * min(1.0, chain.rest_angle)
        left, right = bar_branches(chain, 0, False)
        self.left_branches = left.astype(np.int8)
        self.right_branches = right.astype(np.int8)
        self.rotor, self.angle, self.sense = self._start(left, right)
        for _ in range(self._last):
            lead, rotor = max(self.lead(towards, self.angle) for towards in (-1, 1))
            if lead <= 0:
                break
            self.move_to(rotor)

    def _start(self, left: Array, right: Array) -> tuple[int, float, float]:
        nominal = replace(self._chain, number_of_rotors=8, deviations=NO_DEVIATIONS)
        rotors = np.arange(1, self._last)
        for rotor in rotors[np.argsort(np.abs(rotors - self._last / 2), kind='stable')].tolist():
            angle = float(static_wall(nominal, 2 + rotor % 2)[2 + rotor % 2])
            try:
                angles = angles_from_seed(self._chain, rotor, angle, left, right)
            except ValueError:
                continue
            mode = mode_towards_last(self._chain, angles)
            return rotor, angle, math.copysign(1.0, float(mode[rotor]))
        raise blocked_wall_error(self._chain, int(self._last // 2))

    @property
    def branches(self) -> tuple[bytes, bytes]:
        left, right = self.left_branches[: self.rotor], self.right_branches[self.rotor :]
        return left.tobytes(), right.tobytes()

    def lead(self, towards: int, angle: float) -> tuple[float, int]:
        """Return the largest lead of the rotors on one side of the seed, and the leading rotor.

        `towards` is -1 for the left side and +1 for the right side. The lead of rotor n is
        log |t_n / t_seed|, where t is the zero mode of the configuration in which the seed has the
        angle `angle` [rad]. The result is -inf if no rotor is on this side.
        """
        rotor, lead = self.rotor, 0.0
        best = -math.inf, rotor
        while lead > _NEGLIGIBLE_LEAD and 0 <= rotor + towards <= self._last:
            angle, near, far = self._bond(rotor, towards, angle)
            if near == 0:
                lead = -math.inf
            else:
                lead += math.log(abs(near / far)) if far else math.inf
            rotor += towards
            best = max(best, (lead, rotor))
        return best

    def _bond(self, rotor: int, towards: int, angle: float) -> tuple[float, float, float]:
        """Return the angle [rad] of the next rotor, and the levers times the bar length [m^2].

        The next rotor is `rotor` + `towards`. The first lever belongs to `rotor`, which has the
        angle `angle` [rad], and the second lever belongs to the next rotor.
        """
        bar, far = min(rotor, rotor + towards), rotor + towards
        branch = (self.right_branches if towards > 0 else self.left_branches)[bar]
        spacing = towards * self._spacings[bar]
        far_angle = neighbour_angle(self._chain, bar, far, angle, -spacing, float(branch))
        h, v = self._lengths[rotor] * math.sin(angle), self._lengths[rotor] * math.cos(angle)
        h_far = self._lengths[far] * math.sin(far_angle)
        v_far = self._lengths[far] * math.cos(far_angle)
        across, up = spacing + h_far - h, v_far - v
        return far_angle, h * up - v * across, v_far * across - h_far * up

    def turn(self, most: float) -> int:
        """Rotate the seed by a step of at most `most` [rad]; return the number of the next seed.

        If another rotor would move faster than the seed before the end of the step, the step ends
        where both rotors move equally fast, and the other rotor is the next seed. Raises
        ArithmeticError if the lengths of the bars do not allow a step.
        """
        step = min(self._step, most)
        while step > _SHORTEST_STEP:
            beyond = self.angle + self.sense * step
            try:
                leads = [(self.lead(towards, beyond)[0], towards) for towards in (-1, 1)]
            except ValueError:
                step /= 2
                continue
            sides = [towards for lead, towards in leads if lead > _CLEAR_LEAD]
            ends = [(abs(self._equal_motion(side, beyond) - self.angle), side) for side in sides]
            if not ends:
                self.angle = beyond
                return self.rotor
            ahead, towards = min(ends)
            self.angle += self.sense * ahead
            return self.lead(towards, self.angle)[1]
        raise ArithmeticError(
            f'the bars of rotor {self.rotor} are too short or too long for a further step'
        )

    def _equal_motion(self, towards: int, beyond: float) -> float:
        def lead(angle: float) -> float:
            return self.lead(towards, angle)[0]

        if lead(self.angle) >= 0:
            return self.angle
        return float(brentq(lead, self.angle, beyond, xtol=1e-14))

    def move_to(self, rotor: int) -> None:
        while self.rotor != rotor:
            towards = 1 if rotor > self.rotor else -1
            self.angle, near, far = self._bond(self.rotor, towards, self.angle)
            branches = self.left_branches if towards > 0 else self.right_branches
            branches[min(self.rotor, self.rotor + towards)] = 1 if near > 0 else -1
            self.sense *= -math.copysign(1.0, near * far)
            self.rotor += towards


def seed_path(chain: Chain, beside: int) -> SeedPath:
    """Return the path of the wall once around the orbit, from the middle of leg 0.

    For each piece, the path contains the signs of the levers A and B of `beside` bars on each side
    of the seed. Raises ValueError if the wall cannot pass through the chain.
    """
    seed = _Seed(chain)
    rotor, angle, branches = seed.rotor, seed.angle, seed.branches
    columns = np.arange(-beside, beside)
    rows: list[tuple[int, float, float, Branches, Branches]] = []
    begin, closed = seed.angle, False
    while not closed:
        to_go = math.inf
        if rows and seed.rotor == rotor and seed.branches == branches:
            to_go = seed.sense * (angle - seed.angle) % (2 * math.pi)
        before = seed.angle
        try:
            following = seed.turn(to_go)
        except ArithmeticError:
            raise blocked_wall_error(chain, seed.rotor) from None
        closed = following == seed.rotor and seed.angle == before + seed.sense * to_go
        if closed or following != seed.rotor:
            bars = np.clip(columns + seed.rotor, 0, chain.number_of_springs - 1)
            near = seed.left_branches[bars], seed.right_branches[bars]
            rows.append((seed.rotor, begin, seed.angle, *near))
            seed.move_to(following)
            begin = seed.angle
        astray = abs(seed.angle - begin) > 2 * math.pi
        if astray or len(rows) > _MOST_PIECES_A_ROTOR * chain.number_of_rotors:
            raise blocked_wall_error(chain, seed.rotor)
    return SeedPath(*map(np.array, zip(*rows, strict=True)))


def blocked_wall_error(chain: Chain, rotor: int) -> ValueError:
    """Return the error for a wall that cannot pass a rotor; it describes the nearest obstacle."""
    remedy = 'lower the deviations of the chain'
    obstacles = find_obstacles(chain)
    if obstacles:
        nearest = min(obstacles, key=lambda each: abs(each.bond + 0.5 - rotor))
        remedy = (
            f'the spring of bond {nearest.bond}, {nearest.rest_length:.6g} m, {nearest.reason}; '
            f'{remedy} there'
        )
    return ValueError(
        f'the wall cannot pass rotor {rotor} of 0 to {chain.number_of_rotors - 1} as it does '
        f'without deviations: {remedy}'
    )
